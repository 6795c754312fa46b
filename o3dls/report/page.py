"""The report as one file that needs no network: head, sections, and the scripts and styles they use."""

from __future__ import annotations

from collections.abc import Sequence

from .. import __version__
from .checks import strip
from .document import document
from .markup import Html, join, tag
from .page_parts import asset, viewer_code
from .palette import variables
from .sections.methods import AUTHORS, RELEASED
from .sections.order import SECTIONS
from .sections.section import Section, plugin_sections
from .subject import Subject
from .verdict import verdict, warnings
from .wall_parts import parts_table

NOTICE = "Research use only. Not for clinical use."


def report_page(subject: Subject) -> str:
    """The whole page of one subject."""
    found = [section for make in (*SECTIONS, *plugin_sections()) if (section := make(subject))]
    return page(
        f"{subject.case.name}: {subject.last.name}",
        join(_head(subject), _links(found), *(section.html() for section in found)),
    )


def page(title: str, body: Html, *scripts: str) -> str:
    """A complete HTML document with the styles and the notice that every page of ours carries, and with these
    files of scripts.
    """
    script = "\n".join(['"use strict";', *map(asset, ("page.js", *scripts))])
    maker = f"Made by o3dls {__version__} ({AUTHORS}, {RELEASED[:4]}), an open research tool. {NOTICE}"
    footer = tag("footer", tag("p", maker))
    whole = join(tag("main", body), footer, tag("script", Html(script)))
    style = variables() + asset("report.css") + asset("print.css")
    return document(title, style, whole, [script, *viewer_code()])


def _head(subject: Subject) -> Html:
    case = subject.case
    kinds = ", ".join(
        f"{int((case.points.type == kind).sum())} {kind}" for kind in dict.fromkeys(case.points.type.tolist())
    )
    names = {"start": "before registration"}
    steps = " → ".join(names.get(key, key) for key in subject.last.run.estimates)
    said = warnings(subject)
    return tag(
        "header",
        tag("h1", case.name),
        tag(
            "p",
            f"{subject.date}. {steps}. Fused surface: {subject.last.name}. Points: {kinds}. "
            f"Prior: {len(case.prior.faces)} faces.",
            class_="soft",
        ),
        tag("p", NOTICE, class_="notice"),
        strip(subject),
        tag("p", verdict(subject), class_="verdict"),
        parts_table(subject),
        tag("ul", *(tag("li", text) for text in said), class_="warnings", aria_label="Warnings")
        if said
        else None,
    )


def _links(sections: Sequence[Section]) -> Html:
    return tag(
        "nav",
        *(tag("a", section.title, href=f"#{section.anchor}") for section in sections),
        aria_label="Sections",
    )
