"""The cohort's page in a browser: tables are put in order by mouse and keyboard and say so, nothing is cut
off on a narrow or a wide screen, and the policy lets all of it run.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from test_cohort import THRICE, entry
from test_report_page import CONTRASTS

from o3dls.report.cohort import tables
from o3dls.report.cohort.entries import read_entries
from o3dls.report.cohort.page import cohort_page
from o3dls.report.writer import write_report
from tests.browser import Visit, chromium, violations
from tests.finished import finished

LONG = "a_case_whose_name_is_as_long_as_those_that_a_hospital_gives_" * 2
READABLE = 4.5  # contrast of text, WCAG 2 level AA
SMALLEST_LETTERS = 12.0 - 0.1  # rounding  # pixels on the screen
COLUMN = (
    "([id, k]) => [...document.querySelectorAll(`#${id} tbody tr`)].map((row) => row.cells[k].textContent)"
)
ORDER = (
    "(id) => [...document.querySelectorAll(`#${id} thead th`)].map((one) => one.getAttribute('aria-sort'))"
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as launch:
        yield launch()


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    runs = [
        *THRICE,
        entry("c", icp=12.0),
        entry("d", icp=10.0, level_set=9.0),
        entry(LONG, icp=4.0, tps=3.5),
        replace(entry("flat", icp=4.0, level_set=3.0), unit="px"),
    ]
    path = tmp_path_factory.mktemp("cohort") / "cohort.html"
    path.write_text(cohort_page(runs, path, {"broken": "no prior surface"}), encoding="utf-8")
    return path


@pytest.fixture
def visit(browser: Any, page: Path) -> Iterator[Visit]:
    opened = Visit(browser, page, wait=False)
    yield opened
    assert opened.errors == []  # also of the content security policy
    opened.page.close()


def column(visit: Visit, name: str, k: int) -> list[str]:
    return list(visit.page.evaluate(COLUMN, [name, k]))


def test_a_press_of_a_heading_puts_numbers_in_order_and_what_has_none_last(visit: Visit) -> None:
    def means() -> list[str]:
        return [text.split(" ")[0] for text in column(visit, "means-0", 4)]

    assert visit.page.evaluate(ORDER, "means-0") == [None, None, None, None, "descending"]
    assert means() == ["9.00", "2.00", "1.20", "–", "–"]
    visit.page.click("#means-0 th:nth-child(1) button")  # rows without a value stand among the others
    visit.page.click("#means-0 th:nth-child(5) button")
    assert visit.page.evaluate(ORDER, "means-0") == [None, None, None, None, "ascending"]
    assert means() == ["1.20", "2.00", "9.00", "–", "–"]
    visit.page.click("#means-0 th:nth-child(5) button")
    assert means() == ["9.00", "2.00", "1.20", "–", "–"]
    visit.page.click("#means-0 th:nth-child(3) button")
    assert visit.page.evaluate(ORDER, "means-0") == [None, None, "ascending", None, None]
    assert column(visit, "means-0", 2)[-2:] == ["10.00", "12.00"]  # as numbers: not before 2.00


def test_a_table_is_put_in_order_from_the_keyboard(visit: Visit) -> None:
    visit.page.focus("#means-0 th:nth-child(1) button")
    visit.page.keyboard.press("Enter")
    assert column(visit, "means-0", 0) == ["a", LONG, "b", "c", "d"]
    visit.page.keyboard.press("Space")
    assert column(visit, "means-0", 0) == ["d", "c", "b", LONG, "a"]
    assert visit.page.evaluate(ORDER, "means-0")[0] == "descending"
    visit.page.keyboard.press("Tab")
    assert visit.page.evaluate("document.activeElement.textContent") == "runs"
    outlined = "getComputedStyle(document.activeElement).outlineStyle"
    assert visit.page.evaluate(outlined) == "solid"  # who uses the keyboard sees where


def test_headings_stand_on_paper_too(visit: Visit) -> None:
    visit.page.emulate_media(media="print")
    assert visit.page.is_visible("#means-0 th:nth-child(4) button")


def test_without_scripts_the_tables_have_no_dead_buttons(browser: Any, page: Path) -> None:
    visit = Visit(browser, page, wait=False, java_script_enabled=False)
    assert visit.page.locator("#means-0 button").count() == 0
    assert visit.page.is_visible("#means-0 th:nth-child(4)")
    visit.page.close()


FITS = """() => [document.documentElement.scrollWidth - innerWidth,
    ...[...document.querySelectorAll('main p, main h2, main li, main figure, .scroll')].map((one) => {
        const box = one.getBoundingClientRect();
        return Math.max(-box.left, box.right - innerWidth);
    })]"""
REACHED = """() => [...document.querySelectorAll('.scroll')].map((box) => {
    box.scrollLeft = 1e6;
    const last = box.querySelector('tbody tr').lastElementChild.getBoundingClientRect();
    return last.right - box.getBoundingClientRect().right;
})"""
LETTERS = """() => [...document.querySelectorAll('svg text')].map((one) => {
    const svg = one.ownerSVGElement, box = one.getBoundingClientRect(), all = svg.getBoundingClientRect();
    const size = parseFloat(getComputedStyle(one).fontSize) * all.width / svg.viewBox.baseVal.width;
    return [size, Math.max(all.left - box.left, box.right - all.right, box.bottom - all.bottom)];
})"""


@pytest.mark.parametrize("width", [390, 1440])
def test_nothing_is_cut_off(width: int, browser: Any, page: Path) -> None:
    visit = Visit(browser, page, wait=False, width=width)
    assert max(visit.page.evaluate(FITS)) <= 0
    assert (
        max(visit.page.evaluate(REACHED)) <= 1
    )  # pixel: browsers round; each table scrolls to its last column
    for size, over in visit.page.evaluate(LETTERS):
        assert size >= SMALLEST_LETTERS
        assert over <= 0
    visit.page.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_words_stand_out_in_light_and_dark(scheme: str, browser: Any, page: Path) -> None:
    visit = Visit(browser, page, wait=False, color_scheme=scheme)
    found = visit.page.evaluate(CONTRASTS)
    assert len(found) > 50
    assert [one for one in found if one[1] < READABLE] == []
    visit.page.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1440, 390])
def test_axe_finds_nothing_wrong(width: int, scheme: str, browser: Any, page: Path) -> None:
    visit = Visit(browser, page, wait=False, width=width, color_scheme=scheme)
    assert violations(visit) == []
    visit.page.close()


def test_a_run_has_its_picture_and_its_mark_opens_its_report(browser: Any, tmp_path: Path) -> None:
    run = finished(tmp_path / "ball")
    report = write_report([run])
    (drawn,) = read_entries([run])
    assert 500 < len(drawn.picture) < 6000
    path = tmp_path / "cohort.html"
    path.write_text(cohort_page([drawn, entry("c", icp=12.0, level_set=11.0)], path), encoding="utf-8")
    visit = Visit(browser, path, wait=False)
    picture = visit.page.locator("img.thumbnail")
    picture.scroll_into_view_if_needed()
    visit.page.wait_for_function("() => document.querySelector('img.thumbnail').naturalWidth === 160")
    assert picture.count() == 1  # the other has none
    assert picture.get_attribute("loading") == "lazy"
    assert violations(visit) == []
    marks = visit.page.locator("svg.strips a")
    assert [marks.nth(k).get_attribute("tabindex") for k in range(marks.count())] == ["-1", None]
    marks.last.locator("circle").click()
    visit.page.wait_for_url(report.resolve().as_uri())
    visit.page.close()


def test_a_strip_of_each_metric_has_a_dot_for_each_run_that_opens_its_report(
    browser: Any, tmp_path: Path
) -> None:
    """By its grade in colour and shape, with name and value when it is pointed at or reached by key."""
    run = finished(tmp_path / "ball")
    report = write_report([run])
    (drawn,) = read_entries([run])
    others = [
        replace(entry("c", icp=1.5, level_set=0.01), grade="bad"),
        replace(entry("d", icp=2.0, level_set=6.0), grade="amber"),
        replace(entry("e", icp=2.0, level_set=7.0), grade="good"),
    ]
    path = tmp_path / "cohort.html"
    path.write_text(cohort_page([drawn, *others], path), encoding="utf-8")
    visit = Visit(browser, path, wait=False)
    strips = visit.page.locator("svg.metric")
    titles = strips.locator("> text:first-child").all_text_contents()
    assert titles[:2] == ["mean distance, held out, mm", "result less baseline, mm"]
    assert titles[-1] == "time of the run, s"
    assert "true error, mm" in titles
    rows = column(visit, "metrics-0", 1)
    assert rows[:2] == ["7.00", "6.00"]  # the worst first
    assert strips.nth(titles.index("true error, mm")).locator(".of-run").count() == 1  # who else knows it?
    dots = strips.first.locator(".of-run")
    places = [box["x"] for k in range(4) if (box := dots.nth(k).locator("g, path").last.bounding_box())]
    assert places == sorted(places)
    looks = [
        dots.nth(k).locator("path").evaluate("one => getComputedStyle(one).fill + one.getAttribute('d')")
        for k in (0, 2, 3)
    ]
    assert len(set(looks)) == 3
    seen = "one => getComputedStyle(one).visibility"
    visit.page.locator("svg.metric").first.locator("[tabindex='0']").focus()
    assert strips.first.locator("[tabindex='0']").count() == 1  # of a strip Tab reaches one
    visit.page.keyboard.press("Home")
    said = [one.text_content() for one in dots.locator("text").all() if one.evaluate(seen) == "visible"]
    assert said == ["c: 0.01 mm"]
    visit.page.keyboard.press("ArrowRight")
    said = [one.text_content() for one in dots.locator("text").all() if one.evaluate(seen) == "visible"]
    assert said == [f"ball: {drawn.measured[drawn.last][1].mean():.2f} mm"]
    assert violations(visit) == []
    visit.page.keyboard.press("Enter")
    visit.page.wait_for_url(report.resolve().as_uri())
    visit.page.close()


def test_of_many_runs_the_worst_have_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "MOST_DRAWN", 2)
    runs = [
        replace(entry(name, icp=4.0, level_set=mean), picture=b"webp")
        for name, mean in zip("abc", (1, 3, 2), strict=True)
    ]
    page = cohort_page(runs, Path("all.html"))
    (rows,) = re.findall(r'<table[^>]*id="runs-0".*?</table>', page)
    assert re.findall(r'<th scope="row">(<img[^>]*>)?(\w)</th>', rows)[2] == ("", "a")
    assert rows.count("<img ") == 2
