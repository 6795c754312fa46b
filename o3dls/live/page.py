"""The page of a session: the report's viewer with what is known now beside it.

It is empty when it is sent; all that it shows comes as events.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files

from .. import __version__
from ..report.document import document
from ..report.markup import Html, join, tag
from ..report.page import NOTICE, STYLES
from ..report.page_parts import asset, viewer_code, viewer_started
from ..report.palette import variables

OUTER = ("standing.js", "chart.js", "actions.js", "connection.js")

UNPLACED = (
    "No pose yet: the surface stands in the prior's own frame, and points are not drawn. Name landmarks on "
    "both sides, or go on until there are 10 points."
)
NO_POINTS = "Waiting for points: what is shown is the prior."


@cache
def live_page() -> str:
    """Write the whole page, the same for every session."""
    viewer = f"const startViewer = () => {viewer_started(_read_own('view.js'), 'live')};"
    outer = [viewer, *map(_read_own, OUTER)]
    script = "\n".join(['"use strict";', asset("page.js"), asset("layout.js"), asset("tables.js"), *outer])
    library = viewer_code()[0]
    style = variables() + "".join(map(asset, STYLES)) + _read_own("live.css")
    picture = tag(
        "section",
        tag("h2", "Surface", class_="unseen"),
        tag("p", "Waiting for the first surface.", id="waiting", role="status"),
        tag("p", NO_POINTS, id="no-points", role="status", hidden=True),
        tag("p", UNPLACED, id="unplaced", class_="warnings", hidden=True),
        Html(asset("viewer.html")),
        id="pictures",
    )
    footer = tag("footer", tag("p", f"Made by o3dls {__version__}, an open research tool. {NOTICE}"))
    head = tag(
        "header", tag("h1", "o3dls live", id="title"), tag("p", NOTICE, class_="notice"), class_="title"
    )
    main = tag(
        "main",
        head,
        Html(_read_own("top.html")),
        tag("div", picture, Html(_read_own("side.html")), class_="session"),
    )
    code = join(tag("script", Html(library)), tag("script", Html(script)))
    return document("o3dls live", style, join(main, footer, code), [script, library], connects=True)


def _read_own(name: str) -> str:
    return (files("o3dls.live") / "static" / name).read_text(encoding="utf-8")
