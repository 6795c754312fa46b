"""`o3dls change`: two runs of one heart on the terminal, as JSON and as a folder, or why that is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from o3dls import Case, Deform, Pipeline, read_surface
from o3dls.case import Points
from o3dls.cli.commands import cli
from o3dls.io.table import read_table
from tests.chamber import chamber, measured
from tests.finished import finished, finished_2d

LOW = 0.3  # mV
PRIOR = chamber(20)
SCAR = 12.0  # mm: farther back there is one in the second map


def mapped(seed: int, stretch: float, *, scar: bool) -> Case:
    """A chamber that was stretched since it was imaged, mapped with voltages."""
    case = measured(PRIOR, np.diag([1.0, stretch, 2.0 - stretch, 1.0]), 160, noise=0.5, seed=seed)
    rng = np.random.default_rng(seed)
    at = case.points.xyz
    voltage = 2.0 * np.exp(0.2 * np.sin(at[:, 0] / 9.0) + 0.1 * rng.normal(size=len(at)))
    voltage[scar & (at[:, 1] > SCAR)] *= LOW / 2.0
    points = replace(case.points, columns={**case.points.columns, "bipolar": voltage})
    return replace(case, name=f"map_{seed}", points=points, frame="LPS")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("runs")
    cases = mapped(40_811, 1.3, scar=False), mapped(40_812, 1.25, scar=True)
    first, second = (Pipeline([Deform()], folds=0).run(case).write(folder / case.name) for case in cases)
    return first, second


def said(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["change", *map(str, arguments)])


def test_a_new_scar_is_in_the_table_the_json_and_the_folder(runs: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "change"
    done = said(*runs, "--samples", 30, "--json", "--out", out)
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    rows = {(one["what"], one["where"].split(",")[0]): one for one in found["changes"]}
    assert rows["ratio everywhere", "wall"]["low"] < 1.0 < rows["ratio everywhere", "wall"]["high"]
    assert rows["bipolar after", "change 1"]["value"] == pytest.approx(LOW, rel=0.5)
    assert rows["change of bipolar", "change 1"]["high"] < 0.0
    assert rows["area changed", "wall"]["low"] <= rows["area changed", "wall"]["value"]
    assert rows["change of volume", "wall"]["low"] < rows["change of volume", "wall"]["high"]
    assert found["priors_apart_mm"] is None

    table = read_table(out / "change.csv", ("what", "where", "unit"))
    assert table.numbers("value") == pytest.approx([one["value"] for one in found["changes"]])
    assert json.loads((out / "change.json").read_text(encoding="utf-8")) == found
    for name in ("surface.ply", "surface.vtp"):
        surface = read_surface(out / name)
        fields = surface.fields
        assert {"change_bipolar", "change_low", "change_high", "changed", "displacement_mm"} <= set(fields)
        back = surface.vertices[:, 1] > SCAR + 3.0
        area = surface.vertex_areas / 100.0
        assert rows["area compared", "wall"]["value"] == pytest.approx(
            float(area @ np.isfinite(fields["changed"])), rel=1e-4
        )
        marked = float(area @ (fields["changed"] == 1.0))  # whole vertices, up to the area
        assert 0.0 <= rows["area", "change 1"]["value"] - marked <= area.max()
        assert np.nanmedian(fields["changed"][back]) == 1.0
        assert np.nanmedian(fields["changed"][~back]) == 0.0

    text = said(*runs, "--samples", 30).stdout
    assert all(one["what"] in text and one["unit"] in text for one in found["changes"])
    assert max(map(len, text.splitlines())) <= 80
    assert "name another folder" in str(said(*runs, "--out", out).exception)


def test_a_prior_of_its_own_is_registered_and_that_is_said(runs: tuple[Path, Path], tmp_path: Path) -> None:
    """The second map's prior is the same heart, meshed more finely, with landmarks of its own."""
    case = mapped(40_813, 1.1, scar=True)
    other = Pipeline([Deform()], folds=0).run(replace(case, prior=chamber(23))).write(tmp_path / "other")
    done = said(runs[0], other, "--samples", 30, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert 0.0 < found["priors_apart_mm"] < 2.0
    assert "two priors" in found["notice"]
    whats = [one["what"] for one in found["changes"]]
    assert "bipolar after" in whats
    assert "area displaced" not in whats


def test_what_cannot_be_compared_is_refused(runs: tuple[Path, Path], tmp_path: Path) -> None:
    first, _ = runs
    flat, without = finished_2d(tmp_path / "flat"), finished(tmp_path / "without")
    case = mapped(40_814, 1.1, scar=True)
    written = {
        name: Pipeline([Deform()], folds=0).run(one).write(tmp_path / name)
        for name, one in {
            "right": replace(case, frame="RAS"),
            "timed": replace(case, points=with_column(case.points, "lat")),
            "few": replace(case, points=with_few(case.points, 8)),
        }.items()
    }
    refused = {
        (first, flat): "must be in 3D and mm",
        (first, without): "no posterior in space; run a pipeline with the stage 'deform' again",
        (first, first): "has the points of",
        (first, written["right"]): "must be in one frame",
        (first, written["timed"]): "its points have no column 'bipolar'; they have lat",
        (first, written["few"]): "must be at least 20",
        (first, written["right"], "--column", "unipolr"): "must be in one frame",
    }
    for arguments, why in refused.items():
        done = said(*arguments)
        assert done.exit_code != 0
        assert why in str(done.exception)
    assert "did you mean 'unipolar'" in str(said(*runs, "--column", "unipolr").exception)


def with_column(points: Points, name: str) -> Points:
    columns = dict(points.columns)
    columns[name] = columns.pop("bipolar")
    return replace(points, columns=columns)


def with_few(points: Points, count: int) -> Points:
    values = points.columns["bipolar"].copy()
    values[count:] = np.nan
    return replace(points, columns={**points.columns, "bipolar": values})
