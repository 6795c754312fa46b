"""The documentation as a site: `./dev docs` builds it into build/docs, from the pages that the
host shows too.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from docutils.nodes import SkipNode
from docutils.utils.math import latex2mathml

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS), str(DOCS.parent)]

import site_access  # noqa: E402  # they stand beside this file
import site_pages  # noqa: E402
import site_search  # noqa: E402

import o3dls  # noqa: E402  # of this clone

project, author, copyright = "o3dls", "The o3dls authors", "The o3dls authors, MIT licence"
version = release = o3dls.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
exclude_patterns = ["__pycache__"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
suppress_warnings = ["myst.header"]  # pages of the host begin where they like

default_role = "literal"  # what docstrings put between single backticks is code
napoleon_google_docstring = False  # docstrings have blocks as those of numpy
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
toc_object_entries = False  # a heading stands over each
python_maximum_signature_line_length = 88

BIG = re.compile(r"\\([bB]ig)(?![A-Za-z])")  # docutils knows the sides of \big alone

html_theme = "furo"
html_title = f"o3dls {release}"
html_show_sphinx = False
html_show_sourcelink = False
html_copy_source = False
html_show_search_summary = False  # it would be fetched, which browsers refuse to a page that is a file:
html_static_path = [site_search.SCRIPT]  # this has it from a script instead
html_math_renderer = "mathml"


def _math(translator: Any, node: Any, *, block: bool) -> None:
    """An equation as MathML, which browsers draw without a script from elsewhere."""
    text = BIG.sub(r"\\\1l", node.astext())
    found = latex2mathml.tex2mathml(text, as_block=block)
    translator.body.append(f'<div class="math">{found}</div>' if block else found)
    raise SkipNode


def setup(app: Any) -> None:
    app.add_config_value("demo_report", str(DOCS.parent / "o3dls_demo" / "report.html"), "env")
    app.connect("source-read", site_pages.read)
    app.connect("build-finished", site_access.finished)
    app.connect("build-finished", site_pages.add_demo)
    app.connect("build-finished", site_search.write_texts)
    app.connect("html-page-context", site_search.add_script)
    inline, block = (lambda t, n: _math(t, n, block=False)), (lambda t, n: _math(t, n, block=True))
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
