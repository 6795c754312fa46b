"""Points and landmarks in the files that people's tools write: clouds, tables with an index, units in the
headings, with decimal commas, of spreadsheets, without a header; and what cannot be told is refused.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from formats import marker
from hypothesis import given, settings
from hypothesis import strategies as st

from o3dls.errors import Doubt, InputError
from o3dls.geometry.surface import Surface
from o3dls.io.case_reader import read_case
from o3dls.io.clouds import pcd
from o3dls.io.markups import read_markups
from o3dls.io.points import points_of, read_points, read_points_table
from o3dls.io.surfaces import is_surface, write_surface
from o3dls.live.sources.watch import Watch
from o3dls.runs.conversion import convert

RNG = np.random.default_rng(634_117)
XYZ = RNG.normal(size=(20, 3)).round(3) * 30
BIPOLAR = np.where(np.arange(20) == 3, np.nan, np.arange(20) / 8)


def in_float32(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float32).astype(np.float64)


def of_open3d(path: Path) -> None:
    import open3d as o3d

    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor.from_numpy(XYZ.astype(np.float32)))
    cloud.point["bipolar"] = o3d.core.Tensor.from_numpy(BIPOLAR.astype(np.float32)[:, None])
    ascii_text, packed = "ascii" in path.stem, "packed" in path.stem
    assert o3d.t.io.write_point_cloud(str(path), cloud, write_ascii=ascii_text, compressed=packed)


def of_pyvista(path: Path) -> None:
    pyvista = pytest.importorskip("pyvista")
    cloud = pyvista.PolyData(XYZ)
    cloud["Bipolar"] = BIPOLAR
    cloud.save(path, binary="ascii" not in path.stem)


def of_a_grid(path: Path) -> None:
    pyvista = pytest.importorskip("pyvista")
    cloud = pyvista.PolyData(XYZ).cast_to_unstructured_grid()
    cloud["bip_mV"] = BIPOLAR
    cloud.save(path)


@pytest.mark.parametrize(
    ("name", "write", "digits"),
    [
        ("binary.ply", of_open3d, "float32"),
        ("ascii.ply", of_open3d, "float32"),
        ("binary.pcd", of_open3d, "float32"),
        ("packed.pcd", of_open3d, "float32"),
        ("ascii.pcd", of_open3d, "text"),
        ("binary.vtk", of_pyvista, "float64"),
        ("ascii.vtk", of_pyvista, "text"),
        ("binary.vtp", of_pyvista, "float64"),
        ("grid.vtu", of_a_grid, "float64"),
    ],
)
def test_clouds_of_other_programs_are_points(
    name: str, write: Callable[[Path], None], digits: str, tmp_path: Path
) -> None:
    write(tmp_path / name)
    points = read_points(tmp_path / name)
    close = {"float32": 0.0, "float64": 0.0, "text": 1e-5}[digits]
    exact = in_float32 if digits == "float32" else np.asarray
    np.testing.assert_allclose(points.xyz, exact(XYZ), atol=close)
    np.testing.assert_allclose(points.columns["bipolar"], exact(BIPOLAR), atol=close)
    assert set(points.type) == {"eam"}
    assert not is_surface(tmp_path / name)
    convert(tmp_path / name, tmp_path / "table.csv", units="mm")
    np.testing.assert_array_equal(read_points(tmp_path / "table.csv").xyz, points.xyz)


def test_clouds_of_text_are_points(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "a.xyz", XYZ, fmt="%.3f")
    np.savetxt(tmp_path / "a.xyzn", np.hstack([XYZ, XYZ]), fmt="%.3f")
    np.savetxt(tmp_path / "a.xyzrgb", np.hstack([XYZ, XYZ]), fmt="%.3f")
    np.savetxt(tmp_path / "a.pts", 1000 * XYZ, fmt="%.1f", header="20", comments="")
    (tmp_path / "a_bipolar.dat").write_text("\n".join(map(str, BIPOLAR)))
    for suffix in ("xyz", "xyzn", "xyzrgb"):
        np.testing.assert_allclose(read_points(tmp_path / f"a.{suffix}").xyz, XYZ, atol=1e-3)
    table = read_points_table(tmp_path / "a.pts")
    assert table.notes["units"] == "um"
    np.testing.assert_array_equal(table.numbers("bipolar", missing=True), BIPOLAR)
    np.savetxt(tmp_path / "b.xyz", np.column_stack([np.arange(20), XYZ]), fmt="%.3f")
    with pytest.raises(
        InputError, match=r"b\.xyz: line 1: has numbers where the names .* such as x,y,z,bipolar"
    ):
        read_points(tmp_path / "b.xyz")


@pytest.mark.parametrize("suffix", ["ply", "vtk", "vtp"])
def test_a_surface_is_no_cloud(suffix: str, tmp_path: Path) -> None:
    write_surface(tmp_path / f"s.{suffix}", Surface(marker().vertices, marker().faces))
    with pytest.raises(InputError, match="is a surface, and points are measured places"):
        read_points(tmp_path / f"s.{suffix}")
    assert is_surface(tmp_path / f"s.{suffix}")


def written(header: list[str], rows: np.ndarray, **form: str) -> str:
    """A table as a program writes it: `delimiter`, `decimal`, `missing` and what ends each line."""
    delimiter, decimal = form.get("delimiter", ","), form.get("decimal", ".")
    missing, end = form.get("missing", ""), form.get("end", "")
    lines = [delimiter.join(header) + end]
    for row in rows:
        cells = [missing if value != value else f"{value:.6g}".replace(".", decimal) for value in row]
        lines.append(delimiter.join(cells) + end)
    return "\r\n".join(lines) + "\r\n"


PLAIN = ["x", "y", "z", "bipolar"]
ROWS = np.column_stack([XYZ, BIPOLAR])
COUNTED = np.column_stack([np.arange(20), ROWS])
FROM_ONE = np.column_stack([np.arange(1, 21), ROWS])


@pytest.mark.parametrize(
    "text",
    [
        written(["", *PLAIN], COUNTED),  # pandas
        written(['""', *PLAIN], FROM_ONE),  # R
        written(PLAIN, FROM_ONE, delimiter=" ", missing="NA"),  # write.table of R
        written(["Points:0", "Points:1", "Points:2", "bipolar"], ROWS),  # ParaView
        written(["Points_0", "Points_1", "Points_2", "Bipolar"], ROWS),
        written(['"Points:0"', '"Points:1"', '"Points:2"', '"bip_mV"'], ROWS),
        written(["x (mm)", "y (mm)", "z (mm)", "bipolar"], ROWS),
        written(["X [mm]", "Y [mm]", "Z [mm]", "bipolar"], ROWS),
        written(["x_mm", "y_mm", "z_mm", "bipolar"], ROWS),
        written(PLAIN, ROWS, missing="NA"),
        written(PLAIN, ROWS, missing="n/a"),
        written(PLAIN, ROWS, missing="#NV"),
        written(PLAIN, ROWS, missing="-nan(ind)"),
        written(PLAIN, ROWS, missing="1.#QNAN"),
        written(PLAIN, ROWS, end=","),
        written(PLAIN, ROWS, end=",,,"),
        written([*PLAIN, "", ""], ROWS, end=",,"),
        written(PLAIN, ROWS, delimiter=";", decimal=","),
        written(PLAIN, ROWS, delimiter="\t", decimal=",", missing="NaN"),
        written(PLAIN, ROWS, delimiter=";", decimal=",", end=";"),
        written(PLAIN, ROWS, delimiter="  ", missing="nan"),
        "# units=mm\n" + written(PLAIN, ROWS, delimiter=" ", missing="nan"),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_tables_of_other_programs_are_the_same_points(text: str, encoding: str, tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_bytes(text.encode(encoding))
    points = read_points(tmp_path / "points.csv")
    np.testing.assert_allclose(points.xyz, XYZ, rtol=1e-5)
    np.testing.assert_allclose(points.columns["bipolar"], BIPOLAR, rtol=1e-5)
    assert set(points.columns) == {"bipolar"}


def test_units_in_the_headings_are_those_of_the_table(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    for unit, stated in (("cm", "cm"), ("µm", "um"), ("m", "m"), ("MM", "mm")):
        path.write_text(written([f"{axis} [{unit}]" for axis in "xyz"], XYZ), encoding="utf-8")
        assert read_points_table(path).notes["units"] == stated
    path.write_text(written(["x (mm)", "y (cm)", "z (mm)"], XYZ))
    with pytest.raises(
        InputError, match=r"p\.csv: line 1: columns x \(mm\), y \(cm\), z \(mm\) differ in their units"
    ):
        read_points(path)
    path.write_text("# units=cm\n" + written(["x (mm)", "y (mm)", "z (mm)"], XYZ))
    with pytest.raises(InputError, match="states units=cm, and its columns are in mm"):
        read_points(path)


def test_an_axis_that_is_named_comes_before_one_that_is_guessed(tmp_path: Path) -> None:
    other = np.column_stack([XYZ, XYZ + 1])
    (tmp_path / "p.csv").write_text(written([*"xyz", "Points:0", "Points:1", "Points:2"], other))
    np.testing.assert_allclose(read_points(tmp_path / "p.csv").xyz, XYZ, rtol=1e-5)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("x;y;z\n1.234,5;2;3\n", "line 2, column 'x': '1.234,5' is not a number"),
        ("x;y;z\n1,234;2.5;3\n", "line 2, column 'x': '1,234' has a decimal comma"),  # or thousands
        ("x,y,z\n1,5,2,3\n2,5,2,3\n", "has 4 cells, the header has 3; decimal commas"),
        ("x,y,z\n2,1,1,1\n1,1,1,1\n", "has 4 cells, the header has 3"),  # does not count up
        (",x,y,z\na,1,2,3\n", "column name '' is empty"),  # no row numbers
        ("x,y,z,\n1,2,3,4\n", "column name '' is empty"),
        ("x,y,z\n1,2,NA\n", "column 'z': 'NA' is not a number"),
        ("1,2,3,4,5\n1,2,3,4,5\n", "line 1: has numbers where the names of the columns should be"),
        ("1,2,3,LSPV\n", "line 1: has numbers where the names"),
        ("1\n2\n", "line 1: has numbers where the names"),
        ("u,v,w\n1,2,3\n", "no column 'x'; there are: u, v, w"),
    ],
)
def test_what_is_not_clear_is_refused(text: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(InputError, match=sentence):
        read_points(tmp_path / "p.csv")


@settings(max_examples=200, deadline=None)
@given(
    st.lists(
        st.lists(st.floats(-500, 500).map(lambda v: round(v, 4)), min_size=3, max_size=3),
        min_size=1,
        max_size=6,
    ),
    st.sampled_from([(",", "."), (";", ","), (";", "."), ("\t", ","), ("\t", "."), (" ", ".")]),
    st.booleans(),
    st.booleans(),
)
def test_whatever_the_numbers_a_table_gives_them_back(
    rows: list[list[float]], form: tuple[str, str], index: bool, header: bool
) -> None:
    """Every mark and row number that is understood is understood for all numbers, or refused for them."""
    from o3dls.io.points import points_of, points_table_of

    delimiter, decimal = form
    names = ["", *"xyz"] if index else [*"xyz"]
    if delimiter == " " and index:
        names = names[1:]
    lines = [names] if header else []
    for k, row in enumerate(rows):
        lines.append([*([str(k)] if index else []), *(repr(v).replace(".", decimal) for v in row)])
    text = "".join(delimiter.join(line) + "\n" for line in lines)
    try:
        found = points_of(points_table_of(text.encode(), Path("p.csv")), 3).xyz
    except InputError:
        assert (index and not header) or any("e" in repr(v) for row in rows for v in row)
        return
    np.testing.assert_array_equal(found, rows)


def workbook(path: Path, sheets: dict[str, list[list[object]]]) -> Path:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in sheets.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append([None if value != value else value for value in row])
    book.save(path)
    return path


def test_points_come_from_a_workbook(tmp_path: Path) -> None:
    rows = [["X (mm)", "Y (mm)", "Z (mm)", "Bipolar", "name"], *[[*row, "p"] for row in ROWS.tolist()]]
    path = workbook(tmp_path / "p.xlsx", {"notes": [["taken on Monday"]], "points": rows, "empty": []})
    points = read_points(path)
    np.testing.assert_allclose(points.xyz, XYZ, rtol=1e-15)
    np.testing.assert_array_equal(points.columns["bipolar"], BIPOLAR)
    rows[5][1] = "far"
    workbook(path, {"points": rows})
    with pytest.raises(InputError, match=r"p\.xlsx: row 6, column 'y': 'far' is not a number"):
        read_points(path)
    workbook(path, {"one": rows, "two": rows})
    with pytest.raises(InputError, match="2 of its sheets have the columns x, y, z: there are one, two"):
        read_points(path)
    workbook(path, {"one": ROWS[:, :3].tolist()})
    np.testing.assert_allclose(read_points(path).xyz, XYZ, rtol=1e-15)  # without a header


def test_columns_of_numbers_are_offered_where_headings_say_no_axis(tmp_path: Path) -> None:
    rows = "\n".join(f"{k};{x};{y};{z};0.5" for k, (x, y, z) in enumerate(XYZ.tolist(), 1))
    (tmp_path / "p.csv").write_text(f"Nr;Ost;Nord;Höhe;Bipolar (mV)\n{rows}\n")
    with pytest.raises(Doubt, match="no column 'x'; there are: Nr, Ost, Nord") as asked:
        read_points(tmp_path / "p.csv")
    (answer,) = asked.value.answers  # numbers of rows and voltages are no coordinates
    assert answer.words == "x, y, z are Ost, Nord, Höhe"
    table = read_points_table(tmp_path / "p.csv", 3, str(answer.settings["columns"]))
    np.testing.assert_array_equal(points_of(table, 3).xyz, XYZ)
    (tmp_path / "p.csv").write_text("a;b\n1;2\n3;4.5\n")
    with pytest.raises(Doubt, match="no column 'x'") as asked:
        read_points(tmp_path / "p.csv")
    assert asked.value.answers == ()


def test_other_files_of_offices_are_named(tmp_path: Path) -> None:
    import zipfile

    (tmp_path / "p.xls").write_bytes(bytes.fromhex("d0cf11e0a1b11ae1") + bytes(600))
    with pytest.raises(InputError, match=r"older Excel or Word \(\.xls\); save it as \.xlsx or CSV"):
        read_points(tmp_path / "p.xls")
    with zipfile.ZipFile(tmp_path / "p.ods", "w") as file:
        file.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
    with pytest.raises(InputError, match=r"is an OpenDocument file \(\.ods\), no table"):
        read_points(tmp_path / "p.ods")
    whole = workbook(tmp_path / "p.xlsx", {"one": ROWS.tolist()}).read_bytes()
    for cut in (whole[:-30], whole[:200], whole.replace(b"xl/workbook.xml", b"xl/workbork.xml")):
        (tmp_path / "p.xlsx").write_bytes(cut)
        with pytest.raises(InputError, match=r"p\.xlsx: is "):
            read_points(tmp_path / "p.xlsx")


def test_a_case_and_a_live_session_take_a_cloud(tmp_path: Path) -> None:
    of_open3d(tmp_path / "points.ply")
    write_surface(tmp_path / "prior.vtp", Surface(marker().vertices, marker().faces))
    np.testing.assert_array_equal(read_case(tmp_path).points.xyz, in_float32(XYZ))
    watch = Watch(tmp_path / "points.ply", "unknown")
    np.testing.assert_array_equal(
        watch._read_points((tmp_path / "points.ply").read_bytes()).xyz, in_float32(XYZ)
    )


def test_damaged_clouds_are_the_same_or_refused(tmp_path: Path) -> None:
    """Every packed file whose length changes, or whose head contradicts its data, is refused."""
    for name in ("binary.pcd", "packed.pcd", "ascii.pcd"):
        of_open3d(tmp_path / name)
        data = (tmp_path / name).read_bytes()
        for cut in (data[:-3], data[:-40], data + b"1 2 3 4\n", data.replace(b"POINTS 20", b"POINTS 21")):
            if name == "ascii.pcd" and cut == data[:-3]:
                continue  # the last number is shorter, and no checksum tells
            with pytest.raises(InputError, match=r"\.pcd: "):
                pcd.read_cloud(Path(name), cut)
        with pytest.raises(InputError, match="no line 'DATA"):
            pcd.read_cloud(Path(name), data.replace(b"DATA ", b"DITA "))
        with pytest.raises(InputError, match="has no field 'z'"):
            pcd.read_cloud(Path(name), data.replace(b"FIELDS x y z", b"FIELDS x y w"))


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=80), st.integers(0, 300))
def test_no_packed_bytes_unpack_to_another_length(packed: bytes, size: int) -> None:
    with contextlib.suppress(IndexError, ValueError):
        assert len(pcd.unpack_lzf(packed, size)) == size


PLACES = {"LSPV": [25.429, 25.307, 21.161], "LIPV": [26.0, 2.301, -23.5]}


@pytest.mark.parametrize(
    "tree",
    [
        [{"id": name, "coordinates": at} for name, at in PLACES.items()],
        [
            {"name": name, "position": at, "uncertainty": {"stddevs": [1, 1, 1]}}
            for name, at in PLACES.items()
        ],
        [{"label": name, "xyz": at} for name, at in PLACES.items()],
        PLACES,
    ],
)
def test_places_in_plain_json_are_read(tree: object, tmp_path: Path) -> None:
    (tmp_path / "m.json").write_text(json.dumps(tree))
    marks = read_markups(tmp_path / "m.json")
    assert (marks.names, marks.space) == (("LSPV", "LIPV"), "unknown")
    np.testing.assert_array_equal(marks.xyz, list(PLACES.values()))
    convert(tmp_path / "m.json", tmp_path / "m.mrk.json", frame="RAS", to="LPS")
    turned = read_markups(tmp_path / "m.mrk.json")
    np.testing.assert_array_equal(turned.xyz, np.array(list(PLACES.values())) * [-1, -1, 1])
    with pytest.raises(InputError, match="Slicer must know the frame"):
        convert(tmp_path / "m.json", tmp_path / "n.mrk.json")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[]", "is JSON, but no named places"),
        ("[1, 2]", "is JSON, but no named places"),
        ('[{"id": "A"}]', "'A' has None"),
        ('{"A": [1, 2]}', r"'A' has \[1, 2\]"),
        ('{"A": [1, 2, "3"]}', "'A' has"),
        ('{"markups": []}', "has no list 'markups'"),
        ("LSPV 1 2 3", "is not JSON"),
        ("", "is empty"),
    ],
)
def test_other_json_is_named(text: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "m.json").write_text(text)
    with pytest.raises(InputError, match=sentence):
        read_markups(tmp_path / "m.json")


def test_named_places_need_no_header(tmp_path: Path) -> None:
    buffer = io.StringIO()
    csv.writer(buffer).writerows([[name, *at] for name, at in PLACES.items()])
    (tmp_path / "m.csv").write_text(buffer.getvalue())
    convert(tmp_path / "m.csv", tmp_path / "m.mrk.json", frame="LPS", units="mm")
    marks = read_markups(tmp_path / "m.mrk.json")
    assert marks.names == ("LSPV", "LIPV")
    np.testing.assert_array_equal(marks.xyz, list(PLACES.values()))


REPORTS = ["cloud.ply", "cloud.vtp", "cloud.xyz", "index.csv", "na.csv", "paraview.csv", "units.csv"]


@pytest.mark.parametrize("name", REPORTS)
def test_the_reported_points_are_read(name: str, shared_data: Path) -> None:
    folder = shared_data / "reports/11-points-only-as-one-kind-of-csv"
    np.testing.assert_allclose(read_points(folder / name).xyz[0], [26.51, -10.119, 27.098], atol=6e-4)


def test_the_reported_table_in_utf16_is_read(shared_data: Path) -> None:
    assert read_points(shared_data / "reports/15-utf16/points.csv").xyz.shape[1] == 3
