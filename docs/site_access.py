"""What the HTML of Sphinx and its theme lacks for people who hear a page, or have no mouse, by axe-core."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

# what is found, and what stands in its place; a second time finds nothing
CHANGES = (
    (re.compile(r'(<p class="caption" role="heading")>'), r'\1 aria-level="2">'),
    (re.compile(r'<aside class="sidebar-drawer">'), '<aside class="sidebar-drawer" aria-label="Pages">'),
    (re.compile(r'<aside class="toc-drawer">'), '<aside class="toc-drawer" aria-label="On this page">'),
    (re.compile(r'<th class="head"><p></p></th>'), "<td></td>"),  # a column without a name
    # what may be wider than the window is scrolled by keys, too
    (re.compile(r"<pre>"), '<pre tabindex="0">'),
    (re.compile(r'<div class="(table-wrapper [\w\- ]+|math)">'), r'<div class="\1" tabindex="0">'),
    (re.compile(r'(<article role="main" id="furo-main-content">)(?=\s*<noscript>)'), r"\1<h1>Search</h1>"),
)
# parameters under each other, within a signature: a list of definitions of nothing
PARAMETERS = re.compile(r"<dl>\n(?P<rows>(?:<dd>.*</dd>\n)+)</dl>")
ROW = re.compile(r"<dd>(.*)</dd>")


def finished(app: Any, exception: Exception | None) -> None:
    """Sphinx's event `build-finished`: change the pages that were written."""
    if exception is None and app.builder.name == "html":
        for path in Path(app.outdir).glob("*.html"):
            path.write_text(accessible(path.read_text(encoding="utf-8")), encoding="utf-8")


def accessible(page: str) -> str:
    """The HTML of a page with what it lacks."""
    for found, instead in CHANGES:
        page = found.sub(instead, page)
    return PARAMETERS.sub(_parameters, page)


def _parameters(found: re.Match[str]) -> str:
    return ROW.sub(r'<span style="display: block; margin-left: 2rem">\1</span>', found["rows"])
