"""`o3dls cohort --mean`: the mean of a value over the hearts of a cohort, as a table and on a surface."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from o3dls import ICP, Pipeline, read_surface
from o3dls.cli.commands import cli
from tests.chamber import measured
from tests.evaluation.test_segments import atrium, divided
from tests.finished import finished_2d


def said(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["cohort", *map(str, arguments)])


def run_of(folder: Path, stretch: float, voltage: float, name: str = "bipolar") -> Path:
    """A heart whose voltage is the same everywhere."""
    case = measured(atrium(stretch), np.diag([1.0, 1.0, 1.0, 1.0]), 300)
    values = np.where(case.points.type == "eam", voltage, np.nan)
    points = replace(case.points, columns={**case.points.columns, name: values})
    marks = divided(stretch)[0].landmarks()
    case = replace(case, points=points, frame="LPS", prior_landmarks=marks)
    return Pipeline([ICP()], folds=0).run(case).write(folder)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    for name, stretch, voltage in (("one", 1.0, 1.0), ("three", 1.2, 2.5), ("two", 1.1, 1.6)):
        run_of(folder / name, stretch, voltage)
    return folder


def test_the_mean_and_the_spread_of_three_hearts(runs: Path, tmp_path: Path) -> None:
    out = tmp_path / "mean.vtp"
    done = said(runs, "--mean", "bipolar", "--out", out, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["hearts"] == ["one", "three", "two"]
    assert found["unit"] == "mV"
    for row in found["segments"]:
        assert row["mean"] == pytest.approx(1.7)
        assert row["spread"] == pytest.approx(np.std([1.0, 2.5, 1.6], ddof=1))
        assert row["low"] < 1.7 < row["high"]
    surface = read_surface(out)
    known = surface.fields["hearts"] == 3
    assert known.mean() > 0.8
    assert np.allclose(surface.fields["bipolar_mean"][known], 1.7, atol=1e-4)
    middle = float(atrium(1.1).vertex_areas.sum())  # of the three, the one of middle size
    assert surface.vertex_areas.sum() == pytest.approx(middle, rel=0.01)
    assert not (runs / "cohort.csv").exists()
    text = said(runs, "--mean", "bipolar").stdout
    assert "bipolar (mV) of 3 hearts, on chamber: icp" in text
    assert "not a measurement for a patient's record" in text
    assert max(map(len, text.splitlines())) <= 80


def test_it_is_laid_on_the_atrium_that_is_named(runs: Path, tmp_path: Path) -> None:
    out = tmp_path / "mean.vtp"
    done = said(runs, "--mean", "bipolar", "--on", runs / "one", "--out", out)
    assert done.exit_code == 0, done.output
    assert read_surface(out).vertex_areas.sum() == pytest.approx(atrium().vertex_areas.sum(), rel=0.01)


def test_a_run_that_cannot_be_averaged_is_named(runs: Path, tmp_path: Path) -> None:
    more = tmp_path / "runs"
    more.mkdir()
    for path in runs.iterdir():
        (more / path.name).symlink_to(path)
    finished_2d(more / "flat")
    run_of(more / "untold", 1.0, 3.0, name="unipolar")
    done = said(more, "--mean", "bipolar")
    assert done.exit_code == 0, done.output
    assert "of 3 hearts" in done.stdout
    assert "flat: is in 2D" in done.stderr or "flat: its points have no column" in done.stderr
    assert "untold: its points have no column 'bipolar'; they have unipolar" in done.stderr


def test_what_cannot_be_averaged_is_refused(runs: Path, tmp_path: Path) -> None:
    single = tmp_path / "single"
    single.mkdir()
    (single / "one").symlink_to(runs / "one")
    refused = {
        (runs, "--mean", "bipolr"): "no column 'bipolr': did you mean 'bipolar'?",
        (runs, "--mean", "lat"): "each map counts times from a moment of its own",
        (runs, "--mean", "force"): "0 of 3 runs can be averaged: must be at least two",
        (single, "--mean", "bipolar"): "1 of 1 runs can be averaged: must be at least two",
        (runs, "--mean", "bipolar", "--out", runs / "one/estimates/x.vtp"): "belongs to the run",
        (runs, "--on", runs / "one"): "--on and --out go with --mean",
        (runs, "--mean", "bipolar", "--out", tmp_path / "x.foo"): "cannot write surfaces as '.foo'",
    }
    for arguments, why in refused.items():
        done = said(*arguments)
        assert done.exit_code != 0
        assert why in f"{done.exception}{done.output}", arguments
