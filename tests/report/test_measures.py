"""`o3dls measure`: the numbers of a run on the terminal, as JSON and as a table, or why there are none."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from o3dls import Case, Deform, Pipeline, read_run
from o3dls.cli.commands import cli
from o3dls.io.table import read_table
from tests.chamber import chamber, measured
from tests.finished import finished, finished_2d

SIX_DIGITS = 1e-4  # relative: what a folder keeps of a surface


def stretched() -> Case:
    """A chamber that was stretched since it was imaged, with low voltages at its back."""
    case = measured(chamber(20), np.diag([1.0, 1.15, 0.95, 1.0]), 80, noise=1.0)
    voltage = np.where(case.points.xyz[:, 1] > 0.0, 0.3, 2.0)
    points = replace(case.points, columns={**case.points.columns, "bipolar": voltage})
    return replace(case, points=points, frame="LPS")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = Pipeline([Deform()], folds=0).run(stretched())
    return run.write(tmp_path_factory.mktemp("runs") / "run")


def said(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["measure", *map(str, arguments)])


def test_json_table_and_terminal_have_the_same_numbers(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "numbers.csv"
    done = said(folder, "--samples", 30, "--json", "--out", out)
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    records = found["measures"]
    table = read_table(out, ("what", "where", "unit"))
    assert list(table.columns["what"]) == [one["what"] for one in records]
    assert table.numbers("naive") == pytest.approx([one["naive"] for one in records])
    text = said(folder, "--samples", 30).stdout
    assert all(one["what"] in text and one["where"] in text for one in records)
    volume = records[0]
    assert f"{volume['low']:.1f}" in text
    assert f"{volume['high']:.1f}" in text
    assert "not a measurement for a patient's record" in text


def test_the_numbers_are_those_of_the_surface(folder: Path) -> None:
    surface = read_run(folder).estimates["deform"].surface
    records = json.loads(said(folder, "--samples", 30, "--json").stdout)["measures"]
    found = {(one["what"], one["where"]): one for one in records}
    assert found["volume", "wall"]["naive"] == pytest.approx(surface.volume / 1000.0, rel=SIX_DIGITS)
    assert found["area", "wall"]["naive"] == pytest.approx(surface.area / 100.0, rel=SIX_DIGITS)
    # half of the points have 0.3 mV
    assert 30.0 < found["share below 0.5 mV", "wall"]["naive"] < 70.0
    assert found["share below 1.5 mV", "wall"]["naive"] > found["share below 0.5 mV", "wall"]["naive"]
    assert found["distance", "LSPV to LIPV"]["low"] < found["distance", "LSPV to LIPV"]["high"]
    assert any(what == "section diameter" for what, _ in found)
    assert any(where == "posterior" for _, where in found)  # of a frame and landmarks that are known
    below = json.loads(said(folder, "--samples", 30, "--json", "--below", 1.0).stdout)["measures"]
    assert {one["what"] for one in below if "below" in one["what"]} == {"area below 1 mV", "share below 1 mV"}


def test_a_seed_gives_equal_intervals_and_another_others(folder: Path) -> None:
    first, again, other = (said(folder, "--samples", 30, "--seed", seed).stdout for seed in (5, 5, 6))
    assert first == again
    assert first != other


def test_what_cannot_be_measured_is_refused(folder: Path, tmp_path: Path) -> None:
    flat, without = finished_2d(tmp_path / "flat"), finished(tmp_path / "without")
    refused = {
        (flat,): "must be in 3D and mm",
        (without,): "no posterior in space; run a pipeline with the stage 'deform' again",
        (folder, "--column", "unipolr", "--below", "1"): "no column 'unipolr': did you mean 'unipolar'?",
        (folder, "--column", "lat", "--below", "1"): "its points have no column 'lat'",
        (folder, "--out", folder / "scores.csv"): "belongs to the run",
    }
    for arguments, why in refused.items():
        done = said(*arguments)
        assert done.exit_code != 0
        assert why in str(done.exception)
