"""The electrical section: how much of the chamber is below the thresholds, by part and as a histogram."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from o3dls.report.sections.electrical import electrical_section
from o3dls.report.subject import Subject, read_subject
from tests.finished import bulged_case, finished


@pytest.fixture(scope="module")
def subject(tmp_path_factory: pytest.TempPathFactory) -> Subject:
    """A ball of radius 20 whose voltage rises from below: z / 10 + 2 mV."""
    case = bulged_case(points=400, noise=0.01)
    return read_subject([finished(tmp_path_factory.mktemp("electrical") / "run", case)])


def rows_of(subject: Subject) -> dict[str, list[str]]:
    section = electrical_section(subject)
    assert section is not None
    areas = section.body[section.body.index("part of the chamber") :]
    rows = re.findall(r"<tr><th scope=\"row\">(.*?)</th>(.*?)</tr>", areas[: areas.index("</table>")])
    return {name: re.findall(r"<td[^>]*>(.*?)</td>", row) for name, row in rows}


def test_areas_below_the_thresholds_are_those_of_the_caps_of_a_ball(subject: Subject) -> None:
    """Caps of heights 5 and 15 mm, of 2 pi r h: 6.3 and 18.8 cm²; no place is named below."""
    area, scar, scar_share, low, low_share = map(float, rows_of(subject)["wall"])
    assert scar == pytest.approx(6.3, abs=1.5)
    assert low == pytest.approx(18.8, abs=2.5)
    assert scar_share == pytest.approx(100 * scar / area, abs=3)
    assert scar_share < low_share


def test_parts_add_up_to_the_wall_without_veins(subject: Subject) -> None:
    rows = rows_of(subject)
    whole = rows.pop("wall")
    assert {"floor", "anterior", "posterior"} <= set(rows)
    assert not [name for name in rows if "ostium" in name or "annulus" in name]
    for k in (0, 1, 3):
        assert sum(float(row[k]) for row in rows.values()) == pytest.approx(float(whole[k]), abs=0.4)
    assert float(whole[0]) < subject.last.estimate.surface.area / 100 - 5.0
    assert float(rows["floor"][1]) > 0.8 * float(whole[1])


def test_the_histogram_holds_the_area(subject: Subject) -> None:
    section = electrical_section(subject)
    assert section is not None
    values = section.body[section.body.index("Area of the wall at a voltage: cm²") :]
    cells = re.findall(r"<th scope=\"row\">([\d.]+)</th><td[^>]*>([\d.]+)</td>", values)
    total = sum(float(area) for _, area in cells)
    assert len(cells) == 24
    assert total == pytest.approx(float(rows_of(subject)["wall"][0]), rel=0.05)


def test_without_landmarks_the_whole_wall_has_a_row(tmp_path: Path) -> None:
    case = bulged_case(points=200)
    case = replace(case, prior_landmarks={}, points=case.points.of("eam", "ablation"), frame="unknown")
    assert list(rows_of(read_subject([finished(tmp_path / "run", case)]))) == ["wall"]


def test_activation_times_have_no_thresholds(tmp_path: Path) -> None:
    case = bulged_case(points=120)
    columns = {k: v for k, v in case.points.columns.items() if k != "bipolar"}
    columns["lat"] = np.linspace(-50.0, 50.0, len(case.points))
    run = finished(tmp_path / "run", replace(case, points=replace(case.points, columns=columns)))
    section = electrical_section(read_subject([run]))
    assert section is not None
    assert "part of the chamber" not in section.body
