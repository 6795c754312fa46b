"""Numbers that stand for no value are missing at every entry, and said; what cannot be is named with rows."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from formats import car_file
from test_io_case import case
from test_io_study import DXL, carto_folder

from o3dls.adapters.objects import points_of, surface_of
from o3dls.case import Case, Points
from o3dls.cli.commands import cli
from o3dls.errors import InputError
from o3dls.geometry.surface import Surface
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.io.mapping.imported import Imported
from o3dls.io.mapping.study import read_study
from o3dls.io.matlab import openep
from o3dls.io.points import read_points
from o3dls.io.surfaces import read_surface_file, write_surface
from o3dls.pipeline.new_case import Inputs, make_case
from o3dls.pipeline.pipeline import Pipeline
from o3dls.quantities import QUANTITIES, WORDS_FOR_NONE, quantity_of
from o3dls.runs.conversion import convert
from o3dls.stages.icp import ICP

SINGLE = float(np.finfo(np.float32).max)
WORDS = (-10_000.0, -9_999.0, SINGLE, -SINGLE, float(np.finfo(np.float64).max))
MEASURED = ("bipolar", "unipolar", "lat", "impedance", "force")
N = 24


def columns(name: str, word: float) -> dict[str, np.ndarray]:
    """Points on a ball with values of one quantity, every third of which is a word for none."""
    rng = np.random.default_rng(71_603)
    xyz = rng.normal(size=(N, 3))
    xyz *= 30.0 / np.linalg.norm(xyz, axis=1)[:, None]
    values = np.where(np.arange(N) % 3 == 0, word, 2.5)
    return {**dict(zip("xyz", xyz.T, strict=True)), name: values}


def table(path: Path, cells: dict[str, np.ndarray]) -> Path:
    rows = [
        ",".join(cells),
        *(",".join(map(repr, row)) for row in zip(*map(list, cells.values()), strict=True)),
    ]
    path.write_text("\n".join(rows).replace("np.float64(", "").replace(")", "") + "\n")
    return path


def xyz_of(cells: dict[str, np.ndarray]) -> np.ndarray:
    return np.column_stack([cells[axis] for axis in "xyz"])


def of_csv(name: str, word: float, folder: Path) -> Points:
    return read_points(table(folder / "p.csv", columns(name, word)))


def of_alias(name: str, word: float, folder: Path) -> Points:
    alias = {"bipolar": "bip_mV", "unipolar": "uni_mV", "lat": "lat_ms", "force": "force_g"}.get(
        name, name.upper()
    )
    cells = columns(name, word)
    cells[alias] = cells.pop(name)
    return read_points(table(folder / "p.csv", cells))


def of_mapping(name: str, word: float, folder: Path) -> Points:
    return points_of(columns(name, word))


def of_cloud(name: str, word: float, folder: Path) -> Points:
    import open3d as o3d

    cells = columns(name, word)
    cloud = o3d.t.geometry.PointCloud(xyz_of(cells))
    cloud.point[name] = o3d.core.Tensor(cells[name][:, None])
    return points_of(cloud)


def of_arrays(name: str, word: float, folder: Path) -> Points:
    cells = columns(name, word)
    return Points(xyz_of(cells), np.full(N, "eam"), {name: cells[name]})


ENTRIES = [of_csv, of_alias, of_mapping, of_cloud, of_arrays]


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.__name__)
@pytest.mark.parametrize("name", MEASURED)
def test_words_for_none_are_missing_and_said(entry: Any, name: str, tmp_path: Path) -> None:
    for word in WORDS:
        found = entry(name, word, tmp_path)
        np.testing.assert_array_equal(np.isnan(found.columns[name]), np.arange(N) % 3 == 0)
        assert set(found.columns[name][np.arange(N) % 3 > 0]) == {2.5}
        assert len(found.notes) == 1, found.notes
        assert found.notes[0].startswith(f"8 of 24 values of '{name}' are {word:g}, which stands for none")


@pytest.mark.parametrize("entry", [of_csv, of_mapping, of_cloud], ids=lambda entry: entry.__name__)
@pytest.mark.parametrize(
    ("name", "value"), [("bipolar", -0.3), ("bipolar", 250.0), ("lat", 7e4), ("force", -500.0)]
)
def test_what_cannot_be_is_refused_with_its_rows(entry: Any, name: str, value: float, tmp_path: Path) -> None:
    rows = "line 2.*line 5, line 8" if entry is of_csv else "row 0.*row 3, row 6"
    said = f"{rows}.* and 2 more; leave it empty"
    with pytest.raises(
        InputError, match=rf"column '{name}': .* cannot have been measured: must be within"
    ) as found:
        entry(name, value, tmp_path)
    assert re.search(said, str(found.value)), str(found.value)


def test_a_case_of_arrays_cannot_hold_what_cannot_be() -> None:
    whole = case()
    wrong = np.where(np.arange(len(whole.points)) == 4, -0.1, 1.0)
    with pytest.raises(
        InputError, match=r"case a case: point 4, column 'bipolar': -0.1 cannot have been measured"
    ):
        replace(whole, points=replace(whole.points, columns={**whole.points.columns, "bipolar": wrong}))


def test_a_word_is_one_only_where_it_cannot_be_a_value() -> None:
    lat = np.array([-999.0, 999.0, -9_999.0, 10_000.0])
    found = Points(np.zeros((4, 3)), np.full(4, "eam"), {"lat": lat, "height": lat})
    np.testing.assert_array_equal(found.columns["lat"], [-999.0, 999.0, np.nan, np.nan])
    np.testing.assert_array_equal(found.columns["height"], lat)  # of no quantity that is known
    sigma = Points(np.zeros((3, 3)), np.full(3, "eam"), {"sigma": np.array([-10_000.0, SINGLE, 10_000.0])})
    np.testing.assert_array_equal(sigma.columns["sigma"], [np.nan, np.nan, 10_000.0])  # in um it is 1 cm
    for quantity in QUANTITIES.values():
        assert quantity.can_be((max(quantity.least, 0.0) + min(quantity.most, 1.0)) / 2)
        assert any(quantity.impossible(np.array(WORDS_FOR_NONE)))


@pytest.mark.parametrize(
    "name", ["Bipolar", "bip_mV", "BIPOLAR (mV)", "bipolar_voltage", "Bipolar Voltage [mV]"]
)
def test_a_quantity_is_known_by_its_names(name: str) -> None:
    assert quantity_of(name) is QUANTITIES["bipolar"]
    assert quantity_of(f"my{name}") is None


def test_what_is_missing_stays_said_when_points_are_chosen_joined_and_scaled() -> None:
    from o3dls.io.mapping.imported import joined
    from o3dls.io.points import scaled

    points = points_of(columns("lat", -10_000.0))
    for found in (points.of("eam"), joined(points, points.select([1])), scaled(points, 10.0)):
        assert points.notes[0] in found.notes


@pytest.mark.parametrize("kind", ["ply", "vtk", "vtp", "opencarp"])
def test_fields_of_surfaces_too(kind: str, tmp_path: Path) -> None:
    ball = ball_of({"bipolar": -10_000.0, "height": -10_000.0})
    path = tmp_path / ("a.pts" if kind == "opencarp" else f"a.{kind}")
    write_surface(path, ball)
    file = read_surface_file(path)
    assert np.isnan(file.surface.fields["bipolar"][0])
    assert file.surface.fields["height"][0] == -10_000.0
    assert any("values of 'bipolar' are -10000" in note for note in file.notes)


def ball_of(words: dict[str, float]) -> Surface:
    import trimesh

    ball = trimesh.creation.icosphere(2, 30.0)
    rest = np.arange(len(ball.vertices)) > 5
    return Surface(
        ball.vertices, ball.faces, {name: np.where(rest, 1.5, word) for name, word in words.items()}
    )


def test_a_surface_in_memory_and_values_of_its_faces_before_their_mean() -> None:
    pyvista = pytest.importorskip("pyvista")
    assert np.isnan(surface_of(ball_of({"bipolar": -10_000.0})).fields["bipolar"][:6]).all()
    ball = ball_of({})
    mesh = pyvista.PolyData.from_regular_faces(ball.vertices, ball.faces)
    mesh.cell_data["bipolar"] = np.where(np.arange(len(ball.faces)) < 9, -10_000.0, 1.5)
    found = surface_of(mesh).fields["bipolar"]
    assert np.nanmin(found) == pytest.approx(1.5)


def imported(folder: Path, vendor: str) -> Imported:
    """A study whose first point has a word for none, and whose second has what cannot be."""
    bipolar = [-10_000.0, -3.0, 1.5]
    measured = Points(np.arange(9.0).reshape(3, 3), np.full(3, "eam"), {"bipolar": np.array(bipolar)})
    if vendor == "CARTO":
        carto_folder(folder / "s")
        (folder / "s/1-Map_car.txt").write_bytes(car_file("1-Map", measured))
        return read_study(folder / "s")
    if vendor == "OpenEP":
        electric = {"egmX": measured.xyz, "voltages": {"bipolar": np.array(bipolar)}}
        (folder / "a.mat").write_bytes(openep.save({"electric": electric}))
    else:
        text = DXL.replace("B,4,5,6,9,0,0.7", "B,4,5,6,9,1,-3").replace("9,1,0.5", "9,1,-10000")
        (folder / "a.csv").write_text(text.replace("9,1,0.9,0", "9,1,1.5,1"))
    return read_study(folder)


@pytest.mark.parametrize("vendor", ["CARTO", "EnSite", "OpenEP"])
def test_a_study_is_imported_without_them_and_says_so(vendor: str, tmp_path: Path) -> None:
    found = imported(tmp_path, vendor)
    np.testing.assert_array_equal(found.points.columns["bipolar"][:3], [np.nan, np.nan, 1.5])
    said = "\n".join(found.notes)
    assert "values of 'bipolar' are -10000, which stands for none" in said
    assert (
        "values of 'bipolar' cannot have been measured, and are left empty: point 2; must be within" in said
    )


def sentinel_case(folder: Path) -> Path:
    write_case(folder / "case", Case("c", ball_of({}), points_of(columns("bipolar", 1.0))))
    table(folder / "case" / "points.csv", columns("bipolar", -10_000.0))
    return folder / "case"


def test_a_run_says_it_and_its_result_has_none(tmp_path: Path) -> None:
    case = read_case(sentinel_case(tmp_path), units="mm")
    run = Pipeline([ICP()], folds=0).run(case)
    warned = [one for one in run.estimates["icp"].warnings if one.code == "values-missing"]
    assert [one.sentence[:42] for one in warned] == ["points: 8 of 24 values of 'bipolar' are -1"]
    run.write(tmp_path / "run")
    fields = read_surface_file(tmp_path / "run/estimates/icp/surface.ply").surface.fields
    assert np.nanmin(fields["bipolar"]) == pytest.approx(2.5)
    assert "-10000" not in (tmp_path / "run/points.csv").read_text()


def test_init_and_convert_say_it(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = sentinel_case(tmp_path)
    with caplog.at_level("INFO", logger="o3dls"):
        make_case(tmp_path / "new", Inputs(folder / "prior.ply", folder / "points.csv"), units="mm")
    assert "8 of 24 values of 'bipolar' are -10000" in caplog.text
    done = convert(folder / "points.csv", tmp_path / "out.csv", units="mm")
    assert any("8 of 24 values of 'bipolar' are -10000" in line for line in done)
    assert "-10000" not in (tmp_path / "out.csv").read_text()


def test_the_reported_case(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "reports/01-sentinel-in-points/case"
    if not folder.is_dir():
        pytest.skip(f"no folder {folder}")
    points = read_case(folder).points
    assert len(points.notes) == 2
    assert np.nanmin(points.columns["bipolar"]) >= 0.0
    assert np.nanmin(points.columns["lat"]) > -1000.0
    done = CliRunner().invoke(cli, ["convert", str(folder / "points.csv"), str(tmp_path / "p.csv")])
    assert "30 of 90 values of 'lat' are -10000" in done.output
