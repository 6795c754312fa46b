"""Where things stand on a page: the first screen, the contents, tables and what axe-core says of it all."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from o3dls.report.subject import SETS
from o3dls.report.writer import write_report
from tests.browser import Visit, chromium, violations
from tests.finished import finished, finished_2d

WIDE, TABLET, PHONE = (1440, 900), (768, 1024), (390, 844)
NARROW_HEADS = "nav.contents summary"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as launch:
        yield launch()


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with checks that are amber, and warnings."""
    return write_report([finished(tmp_path_factory.mktemp("layout") / "run")])


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report([finished_2d(tmp_path_factory.mktemp("flat") / "run")])


def opened(browser: Any, page: Path, size: tuple[int, int], **options: Any) -> Visit:
    wait = 'id="viewer"' in page.read_text(encoding="utf-8")
    return Visit(browser, page, width=size[0], height=size[1], wait=wait, **options)


def shown(visit: Visit, selector: str) -> list[float]:
    """The share of the height of each element that the window shows."""
    return list(
        visit.page.evaluate(
            """(selector) => [...document.querySelectorAll(selector)].map((one) => {
                const { top, bottom, height } = one.getBoundingClientRect();
                return Math.max(0, Math.min(bottom, innerHeight) - Math.max(top, 0)) / height;
            })""",
            selector,
        )
    )


@pytest.mark.parametrize(("size", "pictures"), [(WIDE, [0.6, 0.6]), (PHONE, [0.4])])
def test_pictures_and_verdict_are_in_the_first_screen(
    browser: Any, report: Path, size: tuple[int, int], pictures: list[float]
) -> None:
    visit = opened(browser, report, size)
    seen = shown(visit, "#panels canvas")
    assert all(share >= least for share, least in zip(seen, pictures, strict=False)), seen
    for what in ("h1", ".notice", ".overall", ".answers dd", *([".strip li"] if size == WIDE else [])):
        assert min(shown(visit, what)) == 1, what
    said = visit.page.locator(".overall").inner_text()
    assert said.startswith("CHECK Look at this before you use the surface: Converged: 1 stage (OK up to ")
    assert ". 1 note: icp: the rotation about the long axis" in said
    assert said.endswith(".")  # whole, not cut in the middle
    visit.page.close()


def test_the_outcome_has_whole_what_the_strip_has_in_short(browser: Any, report: Path) -> None:
    visit = opened(browser, report, WIDE)
    short = visit.page.locator(".strip li")
    whole = visit.page.locator("#outcome .checks li")
    count = short.count()
    assert count == whole.count() > 9
    for k in range(count):
        said = whole.nth(k).locator("span").last.inner_text()
        assert short.nth(k).get_attribute("title") == said
        assert said
    rows = {round(box["y"]) for k in range(count) if (box := short.nth(k).bounding_box())}
    assert len(rows) == 2
    assert visit.page.locator("#outcome .notes li").count() == 1
    visit.page.close()


def test_more_controls_are_folded_on_narrow_screens_alone(browser: Any, report: Path) -> None:
    visit = opened(browser, report, WIDE)
    assert visit.page.is_visible("#translucent")
    assert not visit.page.is_visible("#viewer summary")
    visit.page.set_viewport_size({"width": 390, "height": 844})
    visit.page.wait_for_selector("#viewer details.folds:not([open])", state="attached")
    assert not visit.page.is_visible("#translucent")
    visit.page.click("#viewer summary")
    assert visit.page.is_visible("#translucent")
    visit.page.close()


PLACES = """() => ['#panels', '.panel'].map((one) => {
    const { left, right, top, bottom } = document.querySelector(one).getBoundingClientRect();
    return { left, right, top, bottom };
})"""


@pytest.mark.parametrize("size", [WIDE, (1100, 800), TABLET, PHONE])
def test_the_controls_stand_at_the_side_of_the_pictures_or_below_them(
    browser: Any, report: Path, size: tuple[int, int]
) -> None:
    """Two pictures stay beside each other, and keys reach them before the controls."""
    visit = opened(browser, report, size)
    pictures, controls = visit.page.evaluate(PLACES)
    if size[0] >= 1100:
        assert controls["left"] >= pictures["right"]
        assert controls["top"] == pytest.approx(pictures["top"], abs=1)
        assert controls["bottom"] - controls["top"] < 760
    else:
        assert controls["top"] >= pictures["bottom"]
    tops = [box["y"] for one in visit.page.locator("#panels canvas").all() if (box := one.bounding_box())]
    assert (len(set(tops)) == 1) == (size != PHONE)
    order = (
        "document.querySelector('#panels canvas').compareDocumentPosition(document.getElementById('field'))"
    )
    assert visit.page.evaluate(order) == 4  # follows
    visit.page.close()


@pytest.mark.parametrize("size", [WIDE, PHONE])
def test_contents_stay_in_reach_and_mark_the_section_in_sight(
    browser: Any, report: Path, size: tuple[int, int]
) -> None:
    visit = opened(browser, report, size)
    ids = visit.page.evaluate("[...document.querySelectorAll('main section')].map((one) => one.id)")
    links = visit.page.locator("nav.contents a")
    assert links.evaluate_all("all => all.map((one) => one.hash.slice(1))") == ids
    for section in ("validity", ids[-1], "outcome"):
        if size == PHONE:
            visit.page.click("nav.contents summary")
        visit.page.click(f"nav.contents a[href='#{section}']")
        visit.page.wait_for_selector(
            f"nav.contents a[aria-current=location][href='#{section}']", state="attached"
        )
        assert visit.page.locator("[aria-current]").count() == 1
        assert min(shown(visit, NARROW_HEADS if size == PHONE else "nav.contents a")) == 1
        if size == PHONE:
            heading = visit.page.locator(f"#{section} h2")
            assert visit.page.locator("nav.contents small").inner_text() == heading.inner_text()
            bar = visit.page.locator("nav.contents").bounding_box()
            assert section == ids[-1] or heading.bounding_box()["y"] >= bar["y"] + bar["height"] - 1
    visit.page.emulate_media(media="print")
    assert not visit.page.is_visible("nav.contents")
    assert visit.errors == []
    visit.page.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [WIDE, PHONE])
def test_axe_finds_nothing_wrong_in_reports(
    browser: Any, report: Path, flat: Path, size: tuple[int, int], scheme: str
) -> None:
    for page in (report, flat):
        visit = opened(browser, page, size, color_scheme=scheme)
        assert violations(visit) == []
        visit.page.close()


def test_axe_finds_nothing_wrong_where_runs_are_compared(browser: Any, report: Path, tmp_path: Path) -> None:
    """Two runs in one report: every name of a table and of a button stands there twice."""
    again = Path(shutil.copytree(report.parent, tmp_path / "again"))
    visit = opened(browser, write_report([report.parent, again], tmp_path / "both.html"), WIDE)
    assert violations(visit) == []
    visit.page.close()


@pytest.mark.parametrize("size", [WIDE, TABLET, PHONE])
def test_no_table_is_wider_than_its_place(
    browser: Any, report: Path, flat: Path, size: tuple[int, int]
) -> None:
    """Nothing has to be scrolled to; where columns do not fit, every value stands behind its heading."""
    for page in (report, flat):
        visit = opened(browser, page, size)
        assert violations(visit) == []
        visit.page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        visit.settle()
        assert visit.page.evaluate(WIDER) == []
        labels = visit.page.evaluate(LABELS)
        assert (len(labels) > 3) == (size == PHONE) or size == TABLET
        assert all(labels)
        visit.page.close()


WIDER = """() => [...document.querySelectorAll('.scroll')].filter((one) => one.clientWidth)
    .filter((one) => one.scrollWidth > one.clientWidth + 1).map((one) => one.textContent.slice(0, 40))"""
LABELS = """() => [...document.querySelectorAll('.cards tbody td')]
    .filter((one) => !one.querySelector('button')).map((one) => one.dataset.label)"""


def test_a_card_has_the_words_of_its_row(browser: Any, report: Path) -> None:
    """What a wide screen shows in a column a narrow one shows behind its heading."""
    said = []
    for size in (WIDE, PHONE):
        visit = opened(browser, report, size)
        table = visit.page.locator("#scores table").first
        table.scroll_into_view_if_needed()
        rows = table.locator("tbody tr").all()
        said.append([[cell.inner_text().strip() for cell in row.locator("th, td").all()] for row in rows])
        heads = [one.strip() for one in table.locator("thead th").all_text_contents()]
        visit.page.close()
    assert said[0] == said[1]
    assert len(said[0][0]) == len(heads)


@pytest.mark.parametrize("size", [WIDE, TABLET, PHONE])
def test_tables_scroll_in_their_own_box_and_cut_nothing(
    browser: Any, report: Path, flat: Path, size: tuple[int, int]
) -> None:
    for page in (report, flat):
        visit = opened(browser, page, size)
        visit.page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        assert visit.page.evaluate("document.scrollingElement.scrollWidth - innerWidth") <= 0
        assert visit.page.evaluate("document.querySelectorAll('table').length") > 5
        assert visit.page.evaluate(CUT) == []
        visit.page.close()


def test_the_longest_word_of_a_heading_stays_in_its_column(browser: Any, report: Path) -> None:
    visit = opened(browser, report, WIDE)
    heading = visit.page.locator("#scores thead th").nth(1)
    heading.evaluate("one => { one.textContent = 'true correspondence'; }")  # of `subject.SETS`
    assert "true correspondence" in SETS.values()
    assert heading.evaluate("one => one.scrollWidth <= one.clientWidth")
    visit.page.close()


CUT = """() => [...document.querySelectorAll('table')].flatMap((table) => {
    const box = table.closest('.scroll');
    if (!box) return ['no box: ' + table.textContent.slice(0, 40)];
    box.scrollLeft = 1e6;
    const seen = (one) => !one.closest('.cards thead'); // whose words stand in every card
    const over = [...table.rows].filter(seen).map((row) => row.lastElementChild.getBoundingClientRect().right)
        .some((right) => right > box.getBoundingClientRect().right + 1);
    const cells = [...table.querySelectorAll('th, td')].filter(seen)
        .filter((one) => one.scrollWidth > one.clientWidth);
    const all = over ? [table.textContent.slice(0, 40)] : [];
    return [...all, ...cells.map((one) => one.textContent)];
})"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_shadow_shows_where_more_of_a_table_is(browser: Any, report: Path, scheme: str) -> None:
    """Where no script makes cards of it: at the right edge while there is more, and no longer at the end."""
    visit = Visit(browser, report, width=390, height=844, wait=False, java_script_enabled=False)
    visit.page.emulate_media(color_scheme=scheme)
    box = visit.page.locator("#validity .scroll")
    box.scroll_into_view_if_needed()
    edge = []
    for left in (0, 100_000):
        box.evaluate("(one, left) => { one.scrollLeft = left; }", left)
        visit.page.wait_for_timeout(100)  # without scripts no frame can be awaited
        edge.append(right_edge(box.screenshot()))
    assert abs(edge[0] - edge[1]) > SHADOW
    visit.page.close()


SHADOW = 0.1  # of full brightness: seen at a glance


def right_edge(png: bytes) -> float:
    """The median brightness of the last columns of a picture."""
    picture = imread(io.BytesIO(png))
    return float(np.median(picture[:, -4:-1, :3]))


MENU = """() => {
    const menu = document.getElementById('field');
    const room = menu.offsetWidth;
    const alone = menu.cloneNode();
    alone.style.cssText = 'position: absolute; flex: none; width: auto';
    menu.parentElement.append(alone);
    return [...menu.options].filter((one) => {
        alone.replaceChildren(one.cloneNode(true));
        return alone.offsetWidth > room;
    }).map((one) => one.text);
}"""


@pytest.mark.parametrize("size", [WIDE, PHONE])
def test_the_menu_of_colours_cuts_no_name(browser: Any, report: Path, size: tuple[int, int]) -> None:
    visit = opened(browser, report, size)
    assert visit.page.locator("#field option").count() > 4
    assert visit.page.evaluate(MENU) == []
    visit.page.close()
