"""The report as one file that needs no network: head, sections, and the scripts and styles they use."""

from __future__ import annotations

from collections.abc import Sequence

from .markup import Html, join, tag
from .page_parts import asset
from .sections.order import SECTIONS
from .sections.section import Section, plugin_sections
from .subject import Subject
from .verdict import verdict, warnings

# nothing is ever fetched
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
NOTICE = "Research use only. Not for clinical use."


def report_page(subject: Subject) -> str:
    """The whole page of one subject."""
    found = [section for make in (*SECTIONS, *plugin_sections()) if (section := make(subject))]
    return page(
        f"{subject.case.name}: {subject.last.name}",
        join(_head(subject), _links(found), *(section.html() for section in found)),
    )


def page(title: str, body: Html) -> str:
    """A complete HTML document with the styles and the notice that every page of ours carries."""
    head = join(
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", http_equiv="Content-Security-Policy", content=POLICY),
        tag("title", title),
        tag("style", Html(asset("report.css"))),
    )
    script = tag("script", Html(f'"use strict";\n{asset("page.js")}'))
    footer = tag("footer", tag("p", f"Made by o3dls, an open research tool. {NOTICE}"))
    page = tag("html", tag("head", head), tag("body", tag("main", body), footer, script), lang="en")
    return f"<!doctype html>\n{page}\n"


def _head(subject: Subject) -> Html:
    case = subject.case
    kinds = ", ".join(
        f"{int((case.points.type == kind).sum())} {kind}" for kind in dict.fromkeys(case.points.type.tolist())
    )
    steps = " → ".join(key for key in subject.last.run.estimates)
    said = warnings(subject)
    return tag(
        "header",
        tag("h1", case.name),
        tag(
            "p",
            f"{subject.date}. {steps}. Points: {kinds}. Prior: {len(case.prior.faces)} faces.",
            class_="soft",
        ),
        tag("p", NOTICE, class_="notice"),
        tag("ul", *(tag("li", text) for text in said), class_="warnings", aria_label="Warnings")
        if said
        else None,
        tag("p", verdict(subject), class_="verdict"),
    )


def _links(sections: Sequence[Section]) -> Html:
    return tag(
        "nav",
        *(tag("a", section.title, href=f"#{section.anchor}") for section in sections),
        aria_label="Sections",
    )
