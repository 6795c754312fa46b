"""The gain is credited to the stage that brought it, and the chart carries its values as a table."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import ClassVar

import pytest

from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.pipeline.pipeline import Pipeline
from o3dls.report.contribution import steps
from o3dls.report.sections.contribution import contribution_section
from o3dls.report.subject import read_subject
from o3dls.report.verdict import verdict
from tests.finished import Icp, LevelSet, bulged_case, finished


class Deform(LevelSet):
    name: ClassVar[str] = "deform"


class Idle(LevelSet):
    """Hands on what the stage before it did."""

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        return start


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("contribution") / "run"
    return Pipeline([Icp(), Deform(), Idle()], folds=0).run(bulged_case()).write(folder)


def test_steps_are_those_of_run_json(run: Path) -> None:
    estimates = json.loads((run / "run.json").read_text())["estimates"]
    means = {name: one["scores"]["held_out"]["mean_mm"] for name, one in estimates.items()}
    found = steps(read_subject([run]))
    names = list(estimates)
    assert [one.stage for one in found] == names[1:]
    for before, one in zip(names, found, strict=False):
        assert (one.before, one.after) == (means[before], means[one.stage])


def test_the_stage_that_brought_the_gain_is_named(run: Path, tmp_path: Path) -> None:
    said = verdict(read_subject([run]))
    assert re.search(r"The largest gain is that of deform \(-\d\.\d\d mm\); level_set itself", said)
    assert "changed the mean by +0.00 mm" in said
    assert "The largest gain" not in verdict(read_subject([finished(tmp_path / "own")]))


def test_a_branch_follows_what_it_began_from(tmp_path: Path) -> None:
    stages = [Icp(), Deform(), LevelSet(after="icp")]
    folder = Pipeline(stages, folds=0).run(bulged_case()).write(tmp_path / "run")
    assert [one.stage for one in steps(read_subject([folder]))] == ["icp", "level_set"]


def test_the_chart_has_its_values_as_text_and_as_a_table(run: Path) -> None:
    subject = read_subject([run])
    section = contribution_section(subject)
    assert section is not None
    assert section.body.count("<rect") == len(steps(subject))
    label = re.findall('aria-label="Change by stage: ([^"]+)"', section.body)[0]
    cells = re.findall(r'<th scope="row">([^<]+)</th>.*?<td>([^<]+)</td></tr>', section.body)
    assert label == ", ".join(f"{name} {change} mm" for name, change in cells)
