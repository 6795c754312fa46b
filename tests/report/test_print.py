"""The report on paper: a page of summary, pages that cut nothing, and pictures that say what they are."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.pipeline.pipeline import Pipeline
from o3dls.plugins.stage import Stage
from o3dls.report.page import NOTICE
from o3dls.report.writer import compare, write_report
from tests.browser import Visit
from tests.finished import NASTY, Icp, LevelSet, bulged_case, finished, finished_2d, renamed
from tests.viewer import FIXTURES

MOST_PAGES = 8
PAGES = {"A4": 710, "Letter": 733}  # and pixels of their width between margins of 11 mm, 96 to the inch
SUMMARY = (NOTICE, "Valid ", "level_set", "Side by side", "Outcome")
PRINT = "() => window.dispatchEvent(new Event('beforeprint'))"
AFTER = "() => window.dispatchEvent(new Event('afterprint'))"


_, _, launch, browser, _ = FIXTURES


def as_many_as_the_demo() -> list[Stage]:
    """Six estimates with the prior's own, each with its trace, and every set of points."""
    return [Icp(), LevelSet(as_="deform"), LevelSet(as_="topology"), LevelSet(as_="again"), LevelSet()]


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Pages by kind of case: with truth, without, in 2D, and with names that are long and bad."""
    folder = tmp_path_factory.mktemp("print")
    runs = {
        "truth": finished(folder / "truth", folds=3),
        "demo": Pipeline(as_many_as_the_demo(), folds=3).run(bulged_case()).write(folder / "demo"),
        "none": finished(folder / "none", replace(bulged_case(), truth=None), folds=3),
        "plane": finished_2d(folder / "plane"),
        "long": finished(folder / ("W" * 60), renamed(bulged_case(), f"{NASTY} {'W' * 80}")),
    }
    return {kind: write_report([run]) for kind, run in runs.items()}


@pytest.fixture
def visit(browser: Any, reports: dict[str, Path]) -> Iterator[Visit]:
    opened = Visit(browser, reports["truth"])
    yield opened
    opened.page.close()


def printed(visit: Visit, path: Path, size: str) -> Any:
    """The page as a PDF document of pypdfium2."""
    pdfium = pytest.importorskip("pypdfium2", reason="pypdfium2 is not installed: no PDF is read")
    visit.page.pdf(path=path, format=size)
    return pdfium.PdfDocument(path)


def texts(document: Any) -> list[str]:
    return [page.get_textpage().get_text_range() for page in document]


@pytest.mark.parametrize("size", PAGES)
@pytest.mark.parametrize("kind", ["truth", "demo", "none", "plane"])
def test_a_page_of_summary_then_no_more_than_eight(
    browser: Any, reports: dict[str, Path], tmp_path: Path, kind: str, size: str
) -> None:
    visit = Visit(browser, reports[kind], wait=kind != "plane")
    titles = visit.page.locator("h2").all_inner_texts()
    found = texts(printed(visit, tmp_path / "page.pdf", size))
    visit.page.close()
    assert 2 <= len(found) <= MOST_PAGES
    edges = [f"o3dls. {NOTICE} {k} of {len(found)}\r\n" for k in range(1, len(found) + 1)]
    assert all(page.startswith(edge) for page, edge in zip(found, edges, strict=True))
    pages = [page.removeprefix(edge) for page, edge in zip(found, edges, strict=True)]
    assert all(words in pages[0] for words in SUMMARY)
    second = titles[titles.index("Outcome") + 1]
    assert pages[1].startswith(second)
    assert second not in pages[0].splitlines()
    assert not any(page.splitlines()[-1] in titles for page in pages)  # a heading stays with what it heads
    assert not any(word in "".join(pages) for word in ("Save picture", "Translucent", "Auto"))
    assert "[[stage]]" in pages[-1]  # what is folded on the screen is open


def test_the_picture_on_paper_is_fine_and_the_present_view(visit: Visit, tmp_path: Path) -> None:
    visit.page.get_by_role("button", name="PA", exact=True).click()
    visit.settle()
    page = printed(visit, tmp_path / "page.pdf", "A4")[0]
    images = [one for one in page.get_objects() if type(one).__name__ == "PdfImage"]
    large = [one for one in images if one.get_px_size()[1] > 500]  # the others are colour bars
    assert large
    for one in large:
        left, _, right, _ = one.get_bounds()
        assert one.get_px_size()[0] / ((right - left) / 72) > 250  # dots to the inch
        pixels = one.get_bitmap().to_numpy()[..., :3].astype(int)
        assert (np.ptp(pixels, axis=2) > 30).mean() > 0.05  # colours, as on the screen


def test_the_picture_on_paper_says_what_it_is_and_goes_afterwards(visit: Visit) -> None:
    visit.page.get_by_role("button", name="PA", exact=True).click()
    visit.settle()
    before, unfolded = visit.picture(0), visit.page.locator("details[open]").count()
    visit.page.evaluate(PRINT)
    said = visit.page.locator("#printed").get_attribute("aria-label") or ""
    assert re.fullmatch(r"ball · view PA · \d{4}-\d\d-\d\d · o3dls \d+\.\d+\.\d+\S*", said)
    closed = visit.page.locator("details:not([open])")
    assert closed.count() == visit.page.locator("figure details").count()  # numbers that a chart shows
    visit.page.evaluate(AFTER)
    assert visit.page.locator("#printed").count() == 0
    assert visit.page.locator("details[open]").count() == unfolded
    assert visit.errors == []
    assert np.abs(visit.picture(0) - before).mean() < 0.5


def test_four_estimates_stand_in_two_rows_and_a_cut_has_its_legend(
    browser: Any, reports: dict[str, Path], tmp_path: Path
) -> None:
    names = ["start", "icp", "deform", "level_set"]
    page = write_report([reports["demo"].parent], tmp_path / "four.html", compare=names)
    visit = Visit(browser, page)
    size = "(({ width, height }) => [width, height])(document.getElementById('printed'))"
    visit.page.evaluate(PRINT)
    wide, high = visit.page.evaluate(size)
    assert wide == 2 * 1200
    assert high > 2 * 900
    visit.page.evaluate(AFTER)
    visit.page.select_option("#cut", label="axial (z)")
    visit.page.select_option("#ghost", label="prior")
    visit.page.evaluate(PRINT)
    assert visit.page.evaluate(size)[1] > high
    assert "ghost: prior" in (visit.page.locator("#printed").get_attribute("aria-label") or "")
    visit.page.evaluate(AFTER)
    for box in visit.page.locator("#shown input").all():
        box.click()
    visit.page.evaluate(PRINT)  # nothing is shown, so there is nothing to print
    assert visit.page.locator("#printed").count() == 0
    assert visit.errors == []
    visit.page.close()


def test_paper_is_white_where_the_screen_is_dark(browser: Any, reports: dict[str, Path]) -> None:
    visit = Visit(browser, reports["truth"], color_scheme="dark")
    corner = "document.getElementById('printed').getContext('2d').getImageData(0, 0, 1, 1).data"
    visit.page.evaluate(PRINT)
    assert visit.page.evaluate(f"() => [...{corner}]") == [255, 255, 255, 255]
    ink = "() => getComputedStyle(document.body)"
    assert visit.page.evaluate(f"{ink}.backgroundColor") != "rgb(255, 255, 255)"
    visit.page.emulate_media(media="print", color_scheme="dark")
    assert visit.page.evaluate(f"{ink}.backgroundColor") == "rgb(255, 255, 255)"
    assert visit.page.evaluate(f"{ink}.getPropertyValue('--s0')").strip() == "#0072b2"
    visit.page.close()


BEYOND = """() => [...document.querySelectorAll('body *')]
    .filter((one) => one.getClientRects().length && !one.closest('svg svg, svg > *'))
    .filter((one) => one.getBoundingClientRect().right > innerWidth + 0.5
        || (one.scrollWidth > one.clientWidth + 1 && getComputedStyle(one).overflowX !== 'visible'))
    .map((one) => `${one.tagName}.${one.className}: ${one.textContent.slice(0, 40)}`)"""


# of charts and scales: smaller than 6 pt (8 px) nobody reads them, larger than 12 pt they shout
LETTERS = """() => [...document.querySelectorAll('svg text')].filter((one) => one.getClientRects().length)
    .map((one) => [one.textContent, one.getScreenCTM().a * parseFloat(getComputedStyle(one).fontSize)])
    .filter(([text, size]) => size > 0 && (size < 8 || size > 16))"""


@pytest.mark.parametrize("size", PAGES)
@pytest.mark.parametrize("kind", ["truth", "none", "plane", "long"])
def test_nothing_is_clipped_at_the_right(
    browser: Any, reports: dict[str, Path], kind: str, size: str
) -> None:
    visit = Visit(browser, reports[kind], wait=kind != "plane", width=PAGES[size])
    visit.page.evaluate(PRINT)
    visit.page.emulate_media(media="print")
    assert visit.page.evaluate(BEYOND) == []
    assert visit.page.evaluate(LETTERS) == []
    visit.page.close()


@pytest.mark.parametrize("size", PAGES)
def test_a_cohort_is_not_clipped_either(
    browser: Any, reports: dict[str, Path], tmp_path: Path, size: str
) -> None:
    page = compare([one.parent for one in reports.values()], tmp_path / "all.html")
    visit = Visit(browser, page, wait=False, width=PAGES[size])
    visit.page.emulate_media(media="print")
    assert visit.page.evaluate(BEYOND) == []
    assert visit.page.evaluate(LETTERS) == []
    visit.page.close()


def test_no_break_cuts_a_row_a_chart_or_a_picture(visit: Visit) -> None:
    visit.page.evaluate(PRINT)
    visit.page.emulate_media(media="print")
    style = "(list, key) => list.map((one) => getComputedStyle(one).getPropertyValue(key))"
    for selector, key, value in (
        ("section, tr, figure, main svg, #printed", "break-inside", "avoid"),
        ("h1, h2, h3, summary", "break-after", "avoid"),
        ("thead", "display", "table-header-group"),
        (".strip li, svg, #printed", "print-color-adjust", "exact"),
        ("main button, .toolbar, nav, #viewer", "display", "none"),
    ):
        found = visit.page.locator(selector).evaluate_all(style, key)
        assert set(found) == {value}, selector


def test_without_webgl_the_static_picture_is_printed(
    launch: Callable[..., Any], reports: dict[str, Path], tmp_path: Path
) -> None:
    visit = Visit(launch(webgl=False), reports["truth"], wait=False)
    page = printed(visit, tmp_path / "page.pdf", "A4")[0]
    assert [one for one in page.get_objects() if type(one).__name__ == "PdfImage"]
