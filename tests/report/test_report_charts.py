"""Charts can be read: contrast, letters at every width, one unit per axis, and their values as tables."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.report.drawing.charts import Axis, Series, values
from o3dls.report.page_parts import asset
from o3dls.report.palette import DARK, LIGHT
from o3dls.report.sections.course import course_section
from o3dls.report.subject import Subject, read_subject
from o3dls.report.writer import write_report
from tests.browser import Visit, chromium
from tests.finished import finished

SEEN = 3.0  # contrast of marks and lines, WCAG 2.1, 1.4.11
FAINTEST = 0.55  # opacity of the truth's line
SMALLEST = 12.0 - 0.1  # pixels of a letter; browsers round


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("charts") / "run")


@pytest.fixture(scope="module")
def subject(run: Path) -> Subject:
    return read_subject([run])


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as launch:
        yield launch(webgl=False)


def channels(colour: str) -> np.ndarray:
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255


def contrast(a: np.ndarray, b: np.ndarray) -> float:
    """Of two sRGB colours, as WCAG has it."""
    linear = [np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) for c in (a, b)]
    low, high = sorted(float(c @ [0.2126, 0.7152, 0.0722]) for c in linear)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize(("scheme", "palette"), [(0, LIGHT), (1, DARK)])
def test_marks_and_lines_stand_out(scheme: int, palette: tuple[str, ...]) -> None:
    blocks = re.findall(r":root[^{]*\{([^}]*)\}", asset("report.css"))
    css = {name: channels(value) for name, value in re.findall(r"--(\w+): (#\w{6})", blocks[scheme])}
    for behind in (css["page"], css["panel"]):
        lines = [*map(channels, palette), css["ink"], css["soft"]]
        lines.append(FAINTEST * css["ink"] + (1 - FAINTEST) * behind)
        assert min(contrast(line, behind) for line in lines) >= SEEN
    assert f"svg .truth {{ stroke: var(--ink); stroke-width: 3; opacity: {FAINTEST:.2f}".replace(
        "0.", "."
    ) in asset("report.css")


@pytest.mark.parametrize("width", [1440, 1100, 768, 390, 320])
def test_letters_of_charts_stay_large(browser: Any, run: Path, width: int) -> None:
    visit = Visit(browser, write_report([run]), wait=False, width=width)
    found = visit.page.evaluate(LETTERS)
    assert len(found) > 50
    for text, size, over in found:
        assert size >= SMALLEST, text
        assert over <= 1, text
    visit.page.close()


LETTERS = """() => [...document.querySelectorAll('svg.chart text')].map((one) => {
    const svg = one.ownerSVGElement, box = one.getBoundingClientRect(), all = svg.getBoundingClientRect();
    const size = parseFloat(getComputedStyle(one).fontSize) * all.width / svg.viewBox.baseVal.width;
    const over = Math.max(all.left - box.left, box.right - all.right, box.bottom - all.bottom);
    return [one.textContent, size, over];
})"""


def test_every_chart_has_a_name_and_its_values_as_a_table(browser: Any, run: Path) -> None:
    visit = Visit(browser, write_report([run]), wait=False)
    charts = visit.page.evaluate(
        """() => [...document.querySelectorAll('svg.chart:not(.slice)')].map((one) =>
            [one.getAttribute('aria-label'), one.getAttribute('role'),
             ['figure', '.charts'].some((place) => one.closest(place)?.querySelector('table'))])"""
    )
    assert len(charts) >= 6
    assert all(name and role == "img" and table for name, role, table in charts)
    slices = visit.page.evaluate(
        "() => [...document.querySelectorAll('svg.slice')].map((one) => one.getAttribute('aria-label'))"
    )
    assert all("truth, icp, level_set" in name and name.endswith(" points") for name in slices)
    visit.page.close()


def cells(html: str) -> list[list[str]]:
    return [re.findall(r"<t[hd][^>]*>([^<]*)</t[hd]>", row) for row in re.findall("<tr>(.*?)</tr>", html)]


def test_values_are_those_of_the_lines_and_none_is_invented() -> None:
    x = np.arange(4.0)
    lines = [
        Series("a", 0, x, np.array([1.0, np.nan, 3.0, 4.0])),
        Series("b", 1, x[:2], np.array([5.0, 7.0])),
    ]
    axes = Axis("iteration", 0.0, 3.0), Axis("length, mm", 0.0, 7.0)
    wanted = [["iteration", "a", "b"], ["0", "1", "5"], ["1", "–", "7"], ["2", "3", "–"], ["3", "4", "–"]]
    assert cells(values("Steps", lines, *axes)) == wanted
    between = cells(values("Steps", lines[1:], *axes, at=np.array([0.5, 2.0])))
    assert between[1:] == [["0.5", "6"], ["2", "–"]]
    long = Series("c", 0, np.arange(500.0), np.arange(500.0))
    found = values("Long", [long], *axes)
    assert "60 of 500" in found
    assert [cells(found)[k][0] for k in (1, -1)] == ["0", "499"]


def test_a_trace_has_one_unit_per_chart(subject: Subject) -> None:
    trace = tuple(
        {"iteration": k, "energy": 600.0 - k, "misfit": 90.0 + k, "rms": 2.0 / k, "step": 1.0 / k,
         "outlier_fraction": 0.01 * k, "pairs": 90 - k, "grip": 3.0 * k}
        for k in range(1, 5)
    )  # fmt: skip
    result = subject.results["icp"]
    traced = {**result.run.estimates, "icp": replace(result.estimate, trace=trace)}
    result = replace(result, run=replace(result.run, estimates=traced))
    section = course_section(replace(subject, results={**subject.results, "icp": result}))
    assert section
    charts = [
        (re.findall(r"<text[^>]*>([^<]*)</text>", chart)[-2:], cells(chart)[0][1:])
        for chart in re.findall('<figure class="plot">.*?</figure>', section.body)
        if "<h3>icp" in chart
    ]
    assert charts == [
        (["iteration", "energy, without unit"], ["energy", "misfit"]),
        (["iteration", "length, mm"], ["rms", "step"]),
        (["iteration", "share of outliers"], ["share of outliers"]),
        (["iteration", "pairs kept"], ["pairs kept"]),
        (["iteration", "grip"], ["grip"]),
    ]
