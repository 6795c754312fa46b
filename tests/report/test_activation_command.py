"""`o3dls activation`: a run's times and velocities on the terminal, as JSON and as a folder, or why not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from o3dls import Case, Deform, Pipeline, read_surface
from o3dls.cli.commands import cli
from o3dls.io.table import read_table
from tests.chamber import chamber, measured
from tests.finished import finished, finished_2d

SPEED, CYCLE = 0.7, 200.0  # m/s, ms
PRIOR = chamber(20)


def mapped(seed: int, *, circular: bool) -> Case:
    """A chamber with a wave from its top, or one that goes round it."""
    case = measured(PRIOR, np.diag([1.0, 1.05, 0.95, 1.0]), 160, noise=0.5, seed=seed)
    rng = np.random.default_rng(seed)
    at = case.points.xyz
    if circular:
        times = np.arctan2(at[:, 1], at[:, 0]) / (2.0 * np.pi) * CYCLE % CYCLE
    else:
        times = (at[:, 2].max() - at[:, 2]) / SPEED
    times = times + 3.0 * rng.normal(size=len(at))
    points = replace(case.points, columns={**case.points.columns, "lat": times})
    return replace(case, name=f"map_{seed}", points=points, frame="LPS")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("runs")
    cases = mapped(40_911, circular=False), mapped(40_912, circular=True)
    first, second = (Pipeline([Deform()], folds=0).run(case).write(folder / case.name) for case in cases)
    return first, second


def said(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["activation", *map(str, arguments)])


def test_times_and_speeds_are_in_the_table_the_json_and_the_folder(
    runs: tuple[Path, Path], tmp_path: Path
) -> None:
    out = tmp_path / "activation"
    done = said(runs[0], "--samples", 30, "--json", "--out", out)
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    rows = {(one["what"], one["where"]): one for one in found["activation"]}
    for what in ("earliest", "latest", "activation time", "speed, median"):
        row = rows[what, "wall"]
        assert row["low"] <= row["high"]
        assert row["naive"] is not None
    assert rows["latest", "wall"]["value"] > rows["earliest", "wall"]["value"]
    assert rows["earliest site within", "wall"]["value"] >= 0.0
    assert 0.0 < rows["area with a velocity", "wall"]["value"] <= rows["area mapped", "wall"]["value"]
    assert found["cycle_ms"] is None

    table = read_table(out / "activation.csv", ("what", "where", "unit"))
    assert table.numbers("value") == pytest.approx([one["value"] for one in found["activation"]])
    assert json.loads((out / "activation.json").read_text(encoding="utf-8")) == found
    surface = read_surface(out / "surface.vtp")
    fields = surface.fields
    true = (surface.vertices[:, 2].max() - surface.vertices[:, 2]) / SPEED
    assert np.nanmedian(np.abs(fields["lat"] - true)) < 4.0
    assert np.nanmedian(fields["lat_sd"]) < 4.0
    told = np.isfinite(fields["speed"])
    assert (told == (fields["untold"] == 0.0)).all()
    assert (fields["speed_low"][told] < fields["speed"][told]).all()
    assert np.median(fields["velocity"][told][:, 2]) < 0.0  # away from the top
    assert np.linalg.norm(fields["velocity"][told], axis=1) == pytest.approx(fields["speed"][told], rel=1e-4)
    assert (out / "surface.ply").is_file()

    text = said(runs[0], "--samples", 30).stdout
    assert all(one["what"] in text and one["unit"] in text for one in found["activation"])
    assert max(map(len, text.splitlines())) <= 80
    assert "name another folder" in str(said(runs[0], "--out", out).exception)


def test_early_beside_late_is_said_and_taken_in_with_a_cycle(runs: tuple[Path, Path]) -> None:
    without = json.loads(said(runs[1], "--samples", 30, "--json").stdout)
    assert any("--cycle" in one for one in without["remarks"])
    with_cycle = json.loads(said(runs[1], "--samples", 30, "--json", "--cycle", CYCLE).stdout)
    assert with_cycle["cycle_ms"] == CYCLE
    assert not any("--cycle" in one for one in with_cycle["remarks"])
    assert "earliest" not in [one["what"] for one in with_cycle["activation"]]  # it starts nowhere
    first = json.loads(said(runs[0], "--samples", 30, "--json").stdout)
    assert not any("--cycle" in one for one in first["remarks"])


def test_runs_without_an_activation_are_refused(runs: tuple[Path, Path], tmp_path: Path) -> None:
    assert "no column 'lat'" in str(said(finished(tmp_path / "plain")).exception)
    assert "must be in 3D and mm" in str(said(finished_2d(tmp_path / "flat")).exception)
    assert "must be more than 0" in str(said(runs[0], "--cycle", -5).exception)
