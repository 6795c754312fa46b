"""The text of every page beside the search page, so that a result has an excerpt also where the site is a
folder of files: browsers let no script read another file there, but a page may load it as a script.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

SCRIPT = "search_excerpts.js"  # stands beside this file, and loads the other
TEXTS = "page_texts.js"


def add_script(app: Any, name: str, template: str, context: Any, doctree: Any) -> None:
    """Sphinx's event `html-page-context`: the search page alone has excerpts."""
    if name == "search":
        app.add_js_file(SCRIPT)


def write_texts(app: Any, exception: Exception | None) -> None:
    """Sphinx's event `build-finished`: write the text of every page as a script."""
    if exception is None and app.builder.name == "html":
        texts = {name: " ".join(app.env.get_doctree(name).astext().split()) for name in app.env.found_docs}
        script = f"window.pageTexts = {json.dumps(texts, ensure_ascii=False)};\n"
        (Path(app.outdir) / "_static" / TEXTS).write_text(script, encoding="utf-8")
