"""What the page is made of, and the two languages it is written in."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass

from ..report.markup import Html, join, table, tag


@dataclass(frozen=True)
class Heading:
    text: str
    level: int = 2

    @property
    def anchor(self) -> str:
        """Name the heading in links, as viewers of Markdown do."""
        return re.sub(r"[^\w-]", "", self.text.lower().replace(" ", "-"))

    def html(self) -> Html:
        return tag(f"h{self.level}", self.text, id=self.anchor)

    def markdown(self) -> str:
        return f"{'#' * self.level} {self.text}"


@dataclass(frozen=True)
class Text:
    text: str

    def html(self) -> Html:
        return tag("p", coded(self.text))

    def markdown(self) -> str:
        return self.text


@dataclass(frozen=True)
class Command:
    """A command is a line for a shell that makes what stands above."""

    line: str

    def html(self) -> Html:
        return tag("pre", self.line)

    def markdown(self) -> str:
        return f"```sh\n{self.line}\n```"


@dataclass(frozen=True)
class Table:
    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def html(self) -> Html:
        return table(self.head, self.rows, self.caption)

    def markdown(self) -> str:
        lines = [self.head, ["---", *["---:"] * (len(self.head) - 1)], *self.rows]
        return f"{self.caption}\n\n" + "\n".join(
            "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines
        )


@dataclass(frozen=True)
class Figure:
    """A figure is a PNG with its file name, what it shows, and the heading of its section."""

    name: str
    caption: str
    png: bytes
    section: Heading | None = None

    @property
    def file(self) -> str:
        return f"figures/{self.name}.png"

    def html(self) -> Html:
        data = base64.b64encode(self.png).decode("ascii")
        picture = tag("img", src=f"data:image/png;base64,{data}", alt=self.caption)
        return tag(
            "figure",
            tag("div", picture, class_="scroll", tabindex="0", role="region", aria_label=self.name),
            tag("figcaption", self.caption, self._link_section()),
        )

    def _link_section(self) -> Html | None:
        at = self.section
        return None if at is None else join(" Numbers: ", tag("a", at.text, href=f"#{at.anchor}"), ".")

    def markdown(self) -> str:
        at = self.section
        link = f" Numbers: [{at.text}](#{at.anchor})." if at else ""
        return f"![{self.caption}]({self.file})\n\n*{self.caption}*{link}"


def coded(text: str) -> Html:
    """Return a text as HTML, in which parts between backticks are code."""
    return join(*(tag("code", part) if k % 2 else part for k, part in enumerate(text.split("`"))))


Block = Heading | Text | Command | Table | Figure
