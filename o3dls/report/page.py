"""The report as one file that needs no network: head, sections, and the scripts and styles they use."""

from __future__ import annotations

from .. import __version__
from .checks import checks
from .document import document
from .grading.remarks import remarks
from .markup import Html, join, tag
from .page_parts import asset, viewer_code
from .palette import variables
from .section import plugin_sections
from .sections.answers import answers
from .sections.contents import contents
from .sections.methods import AUTHORS, RELEASED
from .sections.order import SECTIONS
from .sections.outcome import overall, strip
from .shape_words import words_of
from .subject import Subject
from .surfaces.given import before_stages

STYLES = ("report.css", "layout.css", "charts.css", "print.css")
NOTICE = "Research use only. Not for clinical use."


def report_page(subject: Subject) -> str:
    """Write the whole page of one subject."""
    found = [section for make in (*SECTIONS, *plugin_sections()) if (section := make(subject))]
    return page(
        f"{subject.case.name}: {subject.last.name}",
        join(_page_head(subject), *(section.html() for section in found)),
        *(script for section in found for script in section.scripts),
        links=contents(found),
        styles=tuple(style for section in found for style in section.styles),
    )


def page(
    title: str, body: Html, *scripts: str, links: Html | None = None, styles: tuple[str, ...] = ()
) -> str:
    """Write a complete HTML document with the styles and the notice that every page of ours carries, with
    these files of scripts and of further styles, and with links to its sections beside it.
    """
    script = "\n".join(['"use strict";', *map(asset, ("page.js", "layout.js", "tables.js", *scripts))])
    maker = f"Made by o3dls {__version__} ({AUTHORS}, {RELEASED[:4]}), an open research tool. {NOTICE}"
    footer = tag("footer", tag("p", maker))
    style = variables() + "".join(map(asset, (*STYLES, *styles)))
    columns = tag("div", links, tag("main", body), class_="columns" if links else None)
    whole = join(columns, footer, tag("script", Html(script)))
    return document(title, style, whole, [script, *viewer_code()])


def _page_head(subject: Subject) -> Html:
    case = subject.case
    kinds = ", ".join(
        f"{int((case.points.type == kind).sum())} {kind}" for kind in dict.fromkeys(case.points.type.tolist())
    )
    names = before_stages(subject.last.run)
    steps = " → ".join(names.get(key, key) for key in subject.last.run.estimates)
    found, words = checks(subject), words_of(subject)
    line = (
        f"{subject.date}. {steps}. Fused {words.shape}: {subject.last.name}. Points: {kinds}. "
        f"Prior: {len(case.prior.faces)} {words.pieces}."
    )
    more = tag(
        "details",
        tag("summary", "Checks, run and points"),
        strip(found, f"{words.shape}, {subject.last.name}"),
        tag("p", line, class_="soft"),
        class_="folds",
        open=True,
    )
    return tag(
        "header",
        tag("div", tag("h1", case.name), tag("p", NOTICE, class_="notice"), class_="title"),
        overall(found, remarks(subject)),
        answers(subject, found),
        more,
    )
