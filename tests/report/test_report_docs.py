"""docs/report.md explains what stands on the page: checks with their thresholds, controls, sections."""

from __future__ import annotations

import ast
import inspect
import re
import runpy
import textwrap
from collections.abc import Mapping
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from o3dls.evaluation.interpolation import REACH
from o3dls.report import checks as module
from o3dls.report.drawing.fields import known_fields
from o3dls.report.expected import DUE, OFF
from o3dls.report.grading import convergence, expected_error, landmarks, size, wall
from o3dls.report.grading.check import WORDS
from o3dls.report.page_parts import asset
from o3dls.report.section import Maker
from o3dls.report.sections.order import SECTIONS
from o3dls.report.subject import read_subject
from o3dls.runs import far_points
from tests.finished import finished

DOCS = ROOT / "docs"
PAGE = (DOCS / "report.md").read_text(encoding="utf-8")
PICTURES = re.findall(r"!\[[^\]]+\]\((report_\w+\.png)\)", PAGE)
MOST_BYTES, MOST_PIXELS, MOST_LETTERS = 150_000, 1200, 140


def rows(first: str) -> list[list[str]]:
    """The cells of the table whose first heading is this."""
    lines = PAGE.split(f"\n| {first} |", 1)[1].splitlines()[2:]
    table = lines[: next(k for k, line in enumerate(lines) if not line.startswith("|"))]
    return [[cell.strip() for cell in line.strip("|").split(" |")] for line in table]


def chapter(title: str) -> str:
    return PAGE.split(f"\n## {title}\n", 1)[1].split("\n## ", 1)[0]


ENTRIES = {row[0]: row[1:] for row in rows("entry")}
# each entry, the function that grades it, and the thresholds of that, as they are written
GRADED: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "Valid surface": ("_check_validity", ()),
    "Converged": ("check_convergence", (f"more than {100 * convergence.STILL:g} % of the noise",)),
    "Against icp": ("_against_baseline", (f"more than {module.FARTHER:g} mm",)),
    "Expected error": (
        "check_expected_error",
        (
            f"more than {expected_error.NARROW:g} times as far off",
            f"a region's by a chance below {100 * expected_error.UNLIKELY:g} %",
        ),
    ),
    "Calibration": ("_check_calibration", (f"{100 * OFF:g} percentage points", f"{100 * DUE[0]:g} %")),
    "Landmarks": (
        "check_landmarks",
        (
            f"more than {landmarks.LANDMARKS_RMS:g} mm rms",
            f"more than {landmarks.FAR_LANDMARK:g} mm from its place",
        ),
    ),
    "Size": ("check_size", (f"more than {100 * size.SIZE:g} %",)),
    "Far points": (
        "_far_points",
        (
            f"more than {100 * far_points.FEW_FAR:g} %",
            f"beyond {far_points.FAR:g} mm",
            f"more than {100 * far_points.FEW_OFF:g} %",
            f"beyond {far_points.OFF:g} mm",
        ),
    ),
    "Share of outliers": ("_check_outliers", (f"more than {100 * module.MANY_OUTLIERS:g} %",)),
    "Removed wall": ("removed_wall", (f"{100 * wall.REMOVED:g} % of the wall",)),
    "Prior-only area": ("prior_only", (f"more than {100 * wall.HALF:g} %", f"over {REACH:g} mm")),
    "Farthest part": ("farthest", (f"{100 * wall.FAR_SHARE:g} %", f"beyond {wall.FAR_REACH:g} mm")),
    "Volume change": ("volume", (f"{100 * wall.LARGE_CHANGE:.0f} %",)),
    "Warnings": ("_check_warnings", ()),
}


def test_the_table_of_the_strip_has_its_entries_in_their_order(tmp_path: Path) -> None:
    found = module.checks(read_subject([finished(tmp_path / "run")]))
    assert [one.name for one in found] == list(ENTRIES) == list(GRADED)


@pytest.mark.parametrize("name", GRADED)
def test_the_table_has_a_condition_for_each_grade_that_an_entry_can_have_and_for_no_other(name: str) -> None:
    source = inspect.getsource(getattr(module, GRADED[name][0]))
    told = [cell != "–" for cell in ENTRIES[name]]
    assert told == [f'"{grade}"' in source for grade in ("amber", "bad", "none")]


@pytest.mark.parametrize("name", GRADED)
def test_the_thresholds_are_those_of_the_code(name: str) -> None:
    for threshold in GRADED[name][1]:
        assert threshold in ENTRIES[name][0]


@pytest.mark.parametrize("name", GRADED)
def test_every_entry_is_explained_and_told_what_to_do_about(name: str) -> None:
    said = next(part for part in chapter("The strip").split("\n- ") if part.startswith(f"**{name}**"))
    can_fail = ENTRIES[name][:2] != ["–", "–"]
    assert bool(re.search(r"\*If\s+(?:not OK|amber)\*", said)) == can_fail


@pytest.mark.parametrize("grade", WORDS.values())
def test_every_grade_is_explained(grade: str) -> None:
    assert f"- **{grade}** (" in chapter("The strip")


class Controls(HTMLParser):
    """What a reader sees of each control: the words of labels, buttons and folds, else the name for screen
    readers.
    """

    def __init__(self) -> None:
        super().__init__()
        self.names: list[str] = []
        self._inside: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        name = dict(attrs).get("aria-label")
        if tag in ("button", "label", "summary"):
            self._inside.append(tag)
            self.names.append("")
        elif tag in ("input", "select") and name:
            self.names.append(name)

    def handle_endtag(self, tag: str) -> None:
        if tag in self._inside:
            self._inside.remove(tag)

    def handle_data(self, data: str) -> None:
        if self._inside and data.strip() and not self.names[-1]:
            self.names[-1] = data.strip()


def controls() -> list[str]:
    read = Controls()
    read.feed(re.sub(r"<option.*?</option>", "", asset("viewer.html")))
    return read.names


def test_every_control_of_the_viewer_is_explained() -> None:
    names = controls()
    assert len(names) > 20
    explained = {name for row in rows("no.") for name in re.findall(r"\*\*(.+?)\*\*", row[1]) if row[2]}
    assert set(names) - explained == {"More controls"}  # the fold on a telephone, which holds the others


def test_what_scripts_add_to_the_controls_is_explained_too() -> None:
    explained = {name for row in rows("no.") for name in re.findall(r"\*\*(.+?)\*\*", row[1])}
    assert {"Reset", "next places", "do not rely on", "outliers", "AP"} <= explained
    assert 'button($("reset"), "Reset"' in asset("start.js")
    assert '"next places"' in asset("next.js")
    assert '"do not rely on"' in asset("labels.js")


def test_every_colour_is_explained() -> None:
    labels = re.findall(r'Field\(f?"[^"]+", "([^",]+)', inspect.getsource(known_fields))
    assert len(labels) == 7
    said = PAGE.split("\n### Colours\n", 1)[1].split("\n### ", 1)[0]
    assert [label for label in labels if f"- **{label[0].upper()}{label[1:]}** " not in said] == []


def title_of(maker: Maker) -> re.Pattern[str]:
    """The title of the section that a function makes, whatever it takes from the run."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(maker)))
    calls = (node for node in ast.walk(tree) if isinstance(node, ast.Call))
    title = next(
        call.args[1] for call in calls if isinstance(call.func, ast.Name) and call.func.id == "Section"
    )
    parts = title.values if isinstance(title, ast.JoinedStr) else [title]
    return re.compile(
        "".join(re.escape(part.value) if isinstance(part, ast.Constant) else ".+" for part in parts)
    )


def test_every_section_has_a_heading_in_the_order_of_the_page() -> None:
    headings = re.findall(r"^### (.+)$", chapter("The sections"), re.MULTILINE)
    titles = list(dict.fromkeys(map(title_of, SECTIONS)))  # the pictures in 2D have the title of those in 3D
    assert len(headings) == len(titles)
    assert [
        title.pattern for title, heading in zip(titles, headings, strict=True) if not title.fullmatch(heading)
    ] == []


def test_the_tool_draws_the_pictures_of_the_page() -> None:
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed: the tool needs it")
    tool = runpy.run_path(str(ROOT / "tools" / "report_pictures.py"))
    assert sorted(PICTURES) == sorted(f"report_{name}.png" for name in (*tool["PICTURES"], "cohort"))
    assert len(tool["FIRST_SCREEN"]) == len(re.findall(r"^\d\. ", chapter("The first screen"), re.MULTILINE))
    assert [str(k) for k in range(1, len(tool["VIEWER"]) + 1)] == [row[0] for row in rows("no.") if row[0]]


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_are_small(name: str) -> None:
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    path = DOCS / name
    assert path.stat().st_size < MOST_BYTES
    with image.open(path) as picture:
        assert picture.mode == "P"
        assert picture.width <= MOST_PIXELS


def test_pictures_have_no_bands_of_colour_and_the_page_stays_white(tmp_path: Path) -> None:
    """Of a smooth change of colours, the mean of each place is kept, whatever the palette has."""
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed: the tool needs it")
    across, down = np.meshgrid(np.arange(240.0), np.arange(240.0))
    smooth = np.dstack([across, down, 240.0 - across])
    page = np.full((300, 300, 3), 255.0)
    page[30:270, 30:270] = smooth
    runpy.run_path(str(ROOT / "tools" / "report_pictures.py"))["write"](
        image.fromarray(page.astype(np.uint8)), tmp_path / "written.png"
    )
    found = np.asarray(image.open(tmp_path / "written.png").convert("RGB"), dtype=float)
    assert (found[:28] == 255.0).all()
    means = [
        part[30:270, 30:270].reshape(20, 12, 20, 12, 3).mean(axis=(1, 3))[1:-1, 1:-1]
        for part in (found, page)
    ]
    assert np.abs(means[0] - means[1]).max() < 3.0


def test_links_lead_to_headings_that_are_there() -> None:
    links = re.findall(r"(?<!!)\[[^\]]+\]\(([\w.]*)(?:#([\w-]+))?\)", PAGE)
    assert len(links) > 15
    for file, anchor in links:
        text = (DOCS / (file or "report.md")).read_text(encoding="utf-8")
        headings = (
            re.sub(r"[^\w -]", "", one).lower().replace(" ", "-")
            for one in re.findall(r"^#+ (.+)$", text, re.M)
        )
        assert not anchor or anchor in set(headings), (file, anchor)


def test_lines_are_short_enough_to_be_read_as_text() -> None:
    assert [line for line in PAGE.splitlines() if len(line) > MOST_LETTERS] == []
