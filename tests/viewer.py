"""What tests of the report's viewer do again and again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from o3dls.report.writer import write_report
from tests.browser import Visit, chromium
from tests.finished import finished

SAME = 0.5  # mean difference of two pictures of one state (of 255): edges of triangles are not drawn alike


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("state") / "run")


@pytest.fixture(scope="module")
def report(run: Path) -> Path:
    return write_report([run])


@pytest.fixture(scope="module")
def launch() -> Iterator[Callable[..., Any]]:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def browser(launch: Callable[..., Any]) -> Any:
    return launch()


@pytest.fixture
def visit(browser: Any, report: Path) -> Iterator[Visit]:
    opened = Visit(browser, report)
    yield opened
    assert [text for text in opened.errors if "willReadFrequently" not in text] == []  # said of these tests
    assert opened.requests == [report.resolve().as_uri()]
    opened.page.close()


FIXTURES = run, report, launch, browser, visit


def press(visit: Visit, name: str) -> None:
    visit.page.get_by_role("button", name=name, exact=True).click()
    visit.settle()


def rest(visit: Visit) -> None:
    """Wait until the pictures stay as they are: after 150 ms the page looks for what the wall hides."""
    for _ in range(20):
        shown = visit.picture(0)
        visit.page.wait_for_timeout(400)
        if (visit.picture(0) == shown).all():
            return


def type_range(visit: Visit, low: str, high: str, bar: str = "#surface-bar") -> None:
    for end, value in ((".low", low), (".high", high)):
        visit.page.locator(f"{bar} {end}").fill(value)
    visit.page.dispatch_event(f"{bar} .high", "change")
    visit.settle()
