"""Links to the sections of a page: beside it on wide screens, folded above it on narrow ones."""

from __future__ import annotations

from collections.abc import Sequence

from ..markup import Html, tag
from ..section import Section


def contents(sections: Sequence[Section]) -> Html:
    """Link to the sections; the page's script folds the links on narrow screens and marks the section in
    sight.
    """
    links = (tag("a", section.title, href=f"#{section.anchor}") for section in sections)
    summary = tag("summary", "Contents ", tag("small", id="section-in-sight"))
    folded = tag("details", summary, tag("div", *links), class_="folds", open=True)
    return tag("nav", folded, class_="contents", aria_label="Contents")
