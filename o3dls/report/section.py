"""A report is a list of sections; one without data drops out, and a plugin can add one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ..plugins.plugin import registered
from .markup import Html, tag
from .subject import Subject

GROUP = "o3dls.report_sections"


@dataclass(frozen=True)
class Section:
    """A section is a heading with what stands under it; `anchor` is its name in links and must be unique in
    the page.

    scripts and styles: files of the report's folder static that only a page with this section has. The page's
    policy runs no scripts but those of o3dls and has no `style` attributes: draw in SVG with its
    own attributes, and use the classes of report.css.
    """

    anchor: str
    title: str
    body: Html
    scripts: tuple[str, ...] = ()
    styles: tuple[str, ...] = ()

    def html(self) -> Html:
        return tag("section", tag("h2", self.title), self.body, id=self.anchor)


Maker = Callable[[Subject], Section | None]  # None: nothing to say on this subject


def plugin_sections() -> Iterator[Maker]:
    """Yield the sections that other packages register under `o3dls.report_sections`, by name."""
    for _, entry in sorted(registered(GROUP).items()):
        maker: Maker = entry.load()
        yield maker
