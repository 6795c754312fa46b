"""Headings of tables: what is meant is taken, in its unit; what is not is kept and said, and never lost."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from said import said_by
from tiny import ball_case

import o3dls
from o3dls.adapters.objects import points_of
from o3dls.columns import ALIASES, NAMES, described, meaning_of, moments_of
from o3dls.errors import InputError
from o3dls.io.points import describe_columns, read_points_table
from o3dls.io.surfaces import write_surface

CASE = ball_case(points=40)
XYZ = CASE.points.of("eam").xyz
BIPOLAR = np.round(np.linspace(0.1, 4.0, len(XYZ)), 3)
LAT = np.round(np.linspace(-80.0, 90.0, len(XYZ)), 1)


def table(path: Path, headings: str, *columns: object, comment: str = "# units=mm") -> Path:
    rows = zip(*columns, strict=True)
    lines = [*([comment] if comment else []), headings, *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    "headings",
    [
        "x,y,z,bipolar,lat",
        "X,Y,Z,Bi,LAT",
        "Pos-X (mm),Pos-Y (mm),Pos-Z (mm),Bipolar [mV],LAT [ms]",
        "pos_x,pos_y,pos_z,BIPOLAR_MV,lat_ms",
        "X Position,Y Position,Z Position,Bip,Activation Time",
        "X Coordinate,Y Coordinate,Z Coordinate,Bipolar Voltage (mV),Local Activation Time (ms)",
    ],
)
def test_one_table_under_the_headings_of_many_programs(headings: str, tmp_path: Path) -> None:
    points = o3dls.read_points(table(tmp_path / "p.csv", headings, *XYZ.T, BIPOLAR, LAT))
    np.testing.assert_array_equal(points.xyz, XYZ)
    np.testing.assert_array_equal(points.columns["bipolar"], BIPOLAR)
    np.testing.assert_array_equal(points.columns["lat"], LAT)
    assert set(points.columns) == {"bipolar", "lat"}


@pytest.mark.parametrize(
    ("heading", "name", "factor"),
    [
        ("Bipolar [µV]", "bipolar", 1e-3),
        ("bip_uV", "bipolar", 1e-3),
        ("Unipolar (V)", "unipolar", 1e3),
        ("LAT [s]", "lat", 1e3),
        ("Uni", "unipolar", 1.0),
    ],
)
def test_values_come_in_the_unit_of_the_column_at_every_door(
    heading: str, name: str, factor: float, tmp_path: Path
) -> None:
    given = np.where(np.arange(len(XYZ)) == 3, -10_000.0, BIPOLAR / factor)
    path = table(tmp_path / "p.csv", f"x,y,z,{heading}", *XYZ.T, given)
    want = np.where(np.arange(len(XYZ)) == 3, np.nan, BIPOLAR)
    for points in (
        o3dls.read_points(path),
        points_of({**dict(zip("xyz", XYZ.T, strict=True)), heading: given}),
    ):
        np.testing.assert_allclose(points.columns[name], want, rtol=1e-9)


@pytest.mark.parametrize("heading", ["Bipolar [dB]", "Bipolar (min)", "LAT (mm)", "mybipolar", "bipolars"])
def test_a_heading_of_another_unit_or_word_is_kept_as_it_is(heading: str, tmp_path: Path) -> None:
    path = table(tmp_path / "p.csv", f"x,y,z,{heading}", *XYZ.T, BIPOLAR)
    assert meaning_of(heading) is None
    np.testing.assert_array_equal(o3dls.read_points(path).columns[heading], BIPOLAR)
    assert describe_columns(read_points_table(path))[heading] == "kept as numbers, and not used"


def test_a_heading_that_is_the_name_comes_before_others_that_mean_it(tmp_path: Path) -> None:
    path = table(tmp_path / "p.csv", "x,y,z,Bi,bipolar", *XYZ.T, BIPOLAR + 1, BIPOLAR)
    points = o3dls.read_points(path)
    np.testing.assert_array_equal(points.columns["bipolar"], BIPOLAR)
    np.testing.assert_array_equal(points.columns["Bi"], BIPOLAR + 1)
    path = table(tmp_path / "q.csv", "x,y,z,Bi,Bip", *XYZ.T, LAT, BIPOLAR)
    with pytest.raises(InputError, match="'bipolar' is meant by Bi and Bip; say --columns bipolar=HEADING"):
        o3dls.read_points(path)
    found = read_points_table(path, columns="bipolar=Bip")
    assert found.columns["bipolar"] == [str(value) for value in BIPOLAR]
    assert "Bi" in found.columns


def test_columns_that_are_said_come_before_what_headings_mean(tmp_path: Path) -> None:
    path = table(tmp_path / "p.csv", "East,y,z,V1,bipolar", *XYZ.T, BIPOLAR, LAT)
    found = read_points_table(path, columns="x=East, bipolar=V1")
    assert found.headings["bipolar"] == "V1"
    assert describe_columns(found)["bipolar"] == "kept as numbers, and not used"
    for wrong, sentence in (
        ("x=West", "no column 'x'; there are: East, y"),
        ("x=East,lat=V9", "'lat=v9': no such column; there are: East, y"),
        ("q=East", "must be NAME=HEADING, with a name of x, y, z"),
        ("East", "must be NAME=HEADING"),
    ):
        with pytest.raises(InputError, match=sentence):
            read_points_table(path, columns=wrong)


def test_units_of_headings_and_comment_must_agree(tmp_path: Path) -> None:
    path = table(tmp_path / "p.csv", "Pos-X (mm),Pos-Y (mm),Pos-Z (mm)", *XYZ.T, comment="# units=cm")
    with pytest.raises(InputError, match="states units=cm, and the headings of its coordinates say mm"):
        o3dls.read_points(path)
    path = table(tmp_path / "p.csv", "Pos-X (mm),Pos-Y (mm),Pos-Z (mm)", *XYZ.T, comment="")
    assert read_points_table(path).notes["units"] == "mm"


def test_init_ends_with_what_became_of_each_column_and_the_run_records_it(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "o3dls")
    write_surface(tmp_path / "prior.ply", CASE.prior, units="mm")
    notes = ["ok"] * len(XYZ)
    path = table(tmp_path / "p.csv", "Pos-X,Pos-Y,Pos-Z,Bi,Voltage,Comment", *XYZ.T, BIPOLAR, LAT, notes)
    make = ("init", tmp_path / "case", "--prior", tmp_path / "prior.ply", "--points", path)
    code, said = said_by(*make)
    assert code == 0, said
    for sentence in (
        "column of the points  became",
        "Pos-X                 taken as x",
        "Bi                    taken as bipolar",
        "Comment               kept as text, and not used",
        "Voltage               kept as numbers, and not used; if it is bipolar or unipolar, say --columns",
    ):
        assert sentence in caplog.text
    assert [record.getMessage()[:8] for record in caplog.records][-7::6] == [
        "column o",
        "Comment ",
    ]  # at the end
    code, said = said_by(*make, "--columns", "unipolar=Voltage", "--force")
    assert code == 0, said
    case = o3dls.read_case(tmp_path / "case")
    assert case.columns["Voltage"] == "taken as unipolar"
    np.testing.assert_array_equal(case.points.columns["unipolar"], LAT)
    o3dls.Pipeline([o3dls.ICP()], folds=0).run(case).write(tmp_path / "run")
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert record["case"]["columns"] == dict(case.columns)


def test_a_table_given_to_import_is_told_to_init(tmp_path: Path) -> None:
    path = table(tmp_path / "p.csv", "x,y,z", *XYZ.T)
    code, said = said_by("import", path, tmp_path / "case")
    assert code == 2
    assert f"is a table and no study: use o3dls init DIR --prior PRIOR --points {path}" in said


def test_every_alias_means_one_column() -> None:
    every = [alias for aliases in ALIASES.values() for alias in aliases]
    assert len(every) == len(set(every))
    assert not set(every) & ALIASES.keys()
    assert all(NAMES[alias] == name for name, aliases in ALIASES.items() for alias in aliases)


@pytest.mark.parametrize("heading", ["time", "Time"])
def test_a_time_is_said_to_be_the_order_and_may_be_a_lat_on_demand(
    heading: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "o3dls")
    path = table(tmp_path / "p.csv", f"x,y,z,{heading}", *XYZ.T, np.arange(len(XYZ))[::-1])
    write_surface(tmp_path / "prior.ply", CASE.prior, units="mm")
    make = ("init", tmp_path / "case", "--prior", tmp_path / "prior.ply", "--points", path)
    code, said = said_by(*make)
    assert code == 0, said
    found = re.search(
        rf"{heading}\s+taken as the order of the points; if it is a lat, say (--.*)", caplog.text
    )
    assert found, caplog.text
    assert o3dls.read_case(tmp_path / "case").points.taken.tolist() == [*range(len(XYZ))][::-1]
    code, said = said_by(*make, *found[1].split(), "--force")
    assert code == 0, said
    assert "taken as lat" in caplog.text
    points = o3dls.read_case(tmp_path / "case").points
    assert points.columns["lat"].tolist() == [*range(len(XYZ))][::-1]
    assert points.taken.tolist() == [*range(len(XYZ))]


@pytest.mark.parametrize(
    "values",
    [np.array([7.0, 7.0, 3.0, np.nan, np.nan]), np.array(["b", "b", "a", "", ""])],
)
def test_points_of_a_group_share_their_moment(values: NDArray[Any]) -> None:
    kinds = np.array(["eam", "eam", "eam", "eam", "landmark"])
    found = moments_of({" Group": values}, kinds)
    assert found is not None
    assert found[0] == found[1]
    assert len(np.unique(found)) == 4
    assert moments_of({"grouping": values}, kinds) is None


def test_a_group_of_more_points_than_a_catheter_has_electrodes_is_of_something_else() -> None:
    kinds = np.full(130, "eam")
    assert moments_of({"group": np.repeat([1.0, 2.0], 65)}, kinds) is None
    assert moments_of({"group": np.repeat([1.0, 2.0, 3.0], [64, 64, 2])}, kinds) is not None
    kinds[:2] = "landmark"  # which belong to no moment
    assert moments_of({"group": np.repeat([1.0, 2.0], [66, 64])}, kinds) is not None


def test_a_column_of_groups_is_said_to_be_used() -> None:
    said = described("Group", "group", "i")
    assert said == "says which points were taken at one moment; not used if more than 64 share a value"
