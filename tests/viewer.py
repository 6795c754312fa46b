"""What tests of the report's viewer do again and again."""

from __future__ import annotations

from tests.browser import Visit

SAME = 0.5  # mean difference of two pictures of one state (of 255): edges of triangles are not drawn alike


def press(visit: Visit, name: str) -> None:
    visit.page.get_by_role("button", name=name, exact=True).click()
    visit.settle()


def type_range(visit: Visit, low: str, high: str, bar: str = "#surface-bar") -> None:
    for end, value in ((".low", low), (".high", high)):
        visit.page.locator(f"{bar} {end}").fill(value)
    visit.page.dispatch_event(f"{bar} .high", "change")
    visit.settle()
