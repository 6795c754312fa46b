"""HTML that cannot be broken by what users write: text is escaped unless it is `Html` already."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from html import escape, unescape
from typing import Any

LINKS = ("href", "src")
GAPS = re.compile("[\x00-\x20]")  # browsers drop these from an address, so they could hide `javascript:`
# addresses without a scheme, or with one that runs no code
SAFE = re.compile(r"[^:]*$|[^:/?#]*[/?#]|https?:|data:image/(png|jpeg|webp);", re.IGNORECASE)


class Html(str):
    """This piece of HTML is safe to place in a page as it is."""


Child = str | float | int | None


def tag(name: str, /, *children: Child, **attributes: Child) -> Html:
    """Write an element: plain text children and attribute values are escaped, None is left out.

    A trailing underscore is dropped from attribute names (`class_`), other underscores become hyphens; True
    gives a bare attribute.
    """
    written = "".join(
        _write_attribute(key.rstrip("_").replace("_", "-"), value) for key, value in attributes.items()
    )
    if name in ("meta", "img", "input", "br"):
        return Html(f"<{name}{written}>")
    return Html(f"<{name}{written}>{join(*children)}</{name}>")


def join(*children: Child) -> Html:
    """Join children one after the other, text escaped."""
    return Html(
        "".join(
            child if isinstance(child, Html) else escape(str(child))
            for child in children
            if child is not None
        )
    )


def _write_attribute(key: str, value: Child) -> str:
    if value is None or value is False:
        return ""
    if key in LINKS and not SAFE.match(GAPS.sub("", str(value))):
        raise ValueError(f"{key} = {str(value)[:60]!r}: must be relative, begin with # or lead to https")
    return f" {key}" if value is True else f' {key}="{escape(str(value))}"'


def data_block(identifier: str, value: Any) -> Html:
    """Write a value as JSON for scripts to read; no text in it can end the element."""
    text = (
        json.dumps(value, allow_nan=False, separators=(",", ":"))
        .replace("<", "\\u003c")
        .replace("\u2028", "\\u2028")
    )
    return Html(f'<script type="application/json" id="{escape(identifier)}">{text}</script>')


def table(head: Sequence[Child], rows: Sequence[Sequence[Child]], caption: str = "") -> Html:
    """Write a table whose first column is text and whose others are numbers; it scrolls by itself where the
    page is narrow, and its name for screen readers is the caption, or what the heading of its first column
    says.
    """
    top = tag("tr", *(tag("th", cell, scope="col") for cell in head))
    body = [tag("tr", tag("th", row[0], scope="row"), *(tag("td", cell) for cell in row[1:])) for row in rows]
    whole = tag("table", tag("thead", top), tag("tbody", *body))
    said = tag("p", caption, class_="soft") if caption else None
    name = caption or f"Table: {_strip_tags(head[0])}"
    return join(said, tag("div", whole, class_="scroll", tabindex="0", role="group", aria_label=name))


def _strip_tags(cell: Child) -> str:
    text = unescape(re.sub("<[^>]*>", " ", cell)) if isinstance(cell, Html) else str(cell)
    return " ".join(text.split())


def signed(value: float, digits: int = 2) -> str:
    """Write a number with its sign; nothing is written as minus zero."""
    return f"{round(value, digits) + 0.0:+.{digits}f}"


def millimetres(value: float | None, digits: int = 2) -> str:
    """Write a length for a table; a dash where there is none."""
    return "–" if value is None else f"{value:.{digits}f}"
