"""What the site makes of a page of the host: navigation, and links out of docs/.

On the site, what stands between `<!-- site: README.md -->` and `<!-- end -->` gives way to that page,
or to what `site_reference.py` has by that word.
"""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path
from typing import Any

import site_reference

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
# pages outside of docs/ that the site has too, under these names
OUTSIDE = {
    "README.md": "readme.md",
    "CHANGELOG.md": "changelog.md",
    ".github/CONTRIBUTING.md": "contributing.md",
    ".github/CODE_OF_CONDUCT.md": "conduct.md",
}
DEMO = "_static/demo_report.html"
LARGE = 'style="width: 100%; height: 44rem; border: 1px solid"'
LINK = re.compile(r"\]\((?P<path>[^)#:\s]+)(?P<anchor>#[\w-]+)?\)")
PART = re.compile(r"<!-- site: (?P<name>\S+) -->.*?<!-- end -->", re.DOTALL)
ENTRY = re.compile(r"^- \[([^]]+)\]\(([^)]+)\)", re.MULTILINE)
SECTION = re.compile(r"^## (?P<caption>.+)\n(?P<body>(?:(?!## ).*\n?)*)", re.MULTILINE)


def read(app: Any, name: str, source: list[str]) -> None:
    """Sphinx's event `source-read`: change the text of a page in place."""
    text = linked(source[0], DOCS)
    if name == "index":
        text += navigation(text)
    source[0] = PART.sub(lambda found: frame(app) if found["name"] == "demo" else part(found["name"]), text)


def frame(app: Any) -> str:
    """The report of the demo in a frame, where the demo was run before the site is built."""
    if not Path(app.config.demo_report).is_file():
        return ""
    link = f'<a href="{DEMO}">on a page of its own</a>'
    inside = (
        f'<iframe src="{DEMO}" title="The report of the demo" loading="lazy" class="demo" {LARGE}></iframe>'
    )
    return f"```{{raw}} html\n{inside}\n<p>The report of the demo, {link}.</p>\n```"


def add_demo(app: Any, error: Exception | None) -> None:
    """Sphinx's event `build-finished`: put the report of the demo beside the pages."""
    if error is None and Path(app.config.demo_report).is_file():
        shutil.copyfile(app.config.demo_report, Path(app.outdir) / DEMO)


def part(name: str) -> str:
    """The Markdown that stands for a word: a page outside of docs/, or what the code tells."""
    if name not in OUTSIDE:
        return site_reference.PARTS[name]()
    page = ROOT / name
    return linked(page.read_text(encoding="utf-8"), page.parent)


def linked(text: str, folder: Path) -> str:
    """The text of a page of a folder, its links to files as docs/ sees them."""

    def seen(found: re.Match[str]) -> str:
        target = (folder / found["path"]).resolve()
        if not target.exists():
            return found[0]
        inside = target.relative_to(ROOT).as_posix()
        path = OUTSIDE.get(inside) or Path(os.path.relpath(target, DOCS)).as_posix()
        return f"]({path}{found['anchor'] or ''})"

    return LINK.sub(seen, text)


def navigation(index: str) -> str:
    """Sphinx's tables of contents for the sections of the index: each entry's page by its title there."""
    trees = []
    for section in SECTION.finditer(index):
        pages = [f"{title} <{path}>" for title, path in ENTRY.findall(section["body"])]
        head = f":hidden:\n:caption: {section['caption']}\n"
        trees.append("\n".join(["", "```{toctree}", head, *pages, "```", ""]))
    return "\n".join(trees)
