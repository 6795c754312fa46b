"""`o3dls activation`: a run's times and velocities on the terminal, as JSON and as a folder, or why not; and
in the report.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from o3dls import Case, Deform, Pipeline, read_surface
from o3dls.cli.commands import cli
from o3dls.io.table import read_table
from o3dls.report.drawing.fields import known_fields
from o3dls.report.drawing.painting import paint_field
from o3dls.report.drawing.raster import Canvas, View
from o3dls.report.drawing.scene import scene
from o3dls.report.mapping.activation import SHOWN, TIME, shown_activation, with_activation
from o3dls.report.sections.electrical import activation_section
from o3dls.report.subject import read_subject
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


def test_the_report_shows_times_with_their_sd_and_speed_where_it_is_told(runs: tuple[Path, Path]) -> None:
    subject = replace(read_subject([runs[0]]), activation=True)
    found = shown_activation(subject)
    assert found is not None
    section = activation_section(subject)
    assert section is not None
    assert section.body.count("<img") == 6  # three fields, from the front and from behind
    rows = {(row.where, row.what): row for row in found.rows}
    cells = re.findall(r"<td>(.*?)</td>", section.body[section.body.index('<th scope="row">wall') :])
    for cell, what, digits in ((3, "activation time", 0), (5, "speed, median", 2)):
        row = rows["wall", what]
        interval = f"({row.low:.{digits}f} to {row.high:.{digits}f})"
        assert cells[cell].replace("\N{NO-BREAK SPACE}", " ") == f"{row.value:.{digits}f} {interval}"
    share = rows["wall", "area with a velocity"].value / rows["wall", "area mapped"].value
    assert float(cells[4]) == pytest.approx(100.0 * share, abs=0.5)

    fields = {one["key"]: one for one in scene(subject)["fields"]}
    assert fields[TIME]["step"] == 10.0  # ms between isochrones
    assert fields[TIME]["map"] == "mapping"
    drawn = with_activation(subject, {subject.last.name: subject.last.estimate.surface})
    shown = drawn[subject.last.name].fields
    assert set(SHOWN) <= set(shown)
    told = found.surface.fields["untold"] == 0.0
    assert np.array_equal(np.isfinite(shown["conduction_speed"]), told)
    assert 0.0 < told.mean() < 1.0


def test_the_report_says_where_early_wall_lies_beside_late_wall(runs: tuple[Path, Path]) -> None:
    section = activation_section(replace(read_subject([runs[1]]), activation=True))
    assert section is not None
    assert "give its cycle length" in section.body


def test_a_report_without_times_has_no_activation(tmp_path: Path) -> None:
    for folder in (finished(tmp_path / "plain"), finished_2d(tmp_path / "flat")):
        assert activation_section(replace(read_subject([folder]), activation=True)) is None


def test_a_report_has_an_activation_where_it_is_asked_for(runs: tuple[Path, Path], tmp_path: Path) -> None:
    for options, there in (((), False), (("--activation",), True)):
        page = tmp_path / f"{there}.html"
        CliRunner().invoke(
            cli, ["report", str(runs[0]), "--out", str(page), *options], catch_exceptions=False
        )
        assert ('id="activation"' in page.read_text(encoding="utf-8")) == there


def test_a_picture_of_times_has_one_colour_from_isochrone_to_isochrone() -> None:
    surface = replace(PRIOR, fields={TIME: PRIOR.vertices[:, 2] - PRIOR.vertices[:, 2].min()})
    field = next(one for one in known_fields([surface], "mm") if one.key == TIME)
    view = View(np.eye(3), PRIOR.vertices.mean(axis=0), 80.0)

    def hues(step: float) -> int:
        canvas = Canvas(view, 200, 200, (1.0, 1.0, 1.0))
        seen: list[np.ndarray] = []
        paint = paint_field(surface, replace(field, step=step))
        canvas.surface(surface, lambda pixels: seen.append(paint(pixels)) or seen[-1])
        return len(np.unique(np.concatenate(seen), axis=0))

    assert hues(10.0) <= np.ptp(surface.fields[TIME]) / 10.0 + 2
    assert hues(0.0) > 50
