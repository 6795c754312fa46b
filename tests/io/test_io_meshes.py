"""What mesh files of other programs hold beyond triangles with values at their vertices."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from formats import SUFFIX, TOLERANCE, marker, same_body, write_as
from test_io_study import carto_folder

from o3dls.errors import InputError
from o3dls.geometry.face_values import at_vertices
from o3dls.geometry.surface import Surface
from o3dls.io.case_settings import Folder
from o3dls.io.case_surfaces import surface_of
from o3dls.io.mapping.study_import import import_study
from o3dls.io.meshes import vtp_arrays
from o3dls.io.surfaces import read_surface, read_surface_file, write_surface
from o3dls.runs.conversion import convert

ROUNDING = 1e-12  # relative: of a sum of areas


def shoelace(xy: np.ndarray) -> float:
    x, y = xy.T
    return 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def spiral() -> np.ndarray:
    """A band of one and a half turns, (80, 2), counter-clockwise."""
    angle = np.linspace(0.0, 3.0 * np.pi, 40)
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([(10 + angle[:, None]) * along, ((8 + angle[:, None]) * along)[::-1]])


POLYGONS = {
    "star": np.array([(1 + 9 * (k % 2)) * np.array([np.cos(k / 5), np.sin(k / 5)]) for k in range(31)]),
    "comb": np.array(
        [(0, -1), (20, -1), *((20 - k, 0 if k % 2 else 10) for k in range(21))], dtype=np.float64
    ),
    "spiral": spiral(),
    # a square with a square hole, to which a cut leads and back
    "hole": np.array(
        [(0, 0), (9, 0), (9, 9), (0, 9), (0, 0), (3, 3), (3, 6), (6, 6), (6, 3), (3, 3)], dtype=np.float64
    ),
}


@pytest.mark.parametrize("name", list(POLYGONS))
@pytest.mark.parametrize("first", [0, 7])
def test_strongly_concave_polygons_are_cut_inside(name: str, first: int, tmp_path: Path) -> None:
    ring = np.roll(POLYGONS[name], -first, axis=0)
    tilt = np.linalg.qr(np.random.default_rng(88_213).normal(size=(3, 3)))[0]
    places = np.column_stack([ring, np.zeros(len(ring))]) @ tilt
    rows = "".join("{:.17g} {:.17g} {:.17g}\n".format(*place) for place in places)
    path = tmp_path / "polygon.off"
    path.write_text(f"OFF\n{len(ring)} 1 0\n{rows}{len(ring)} {' '.join(map(str, range(len(ring))))}\n")
    surface = read_surface(path)
    assert surface.area == pytest.approx(abs(shoelace(ring)), rel=ROUNDING * len(ring))
    assert len(surface.faces) == len(ring) - 2
    normals = surface.face_normals[surface.face_areas > ROUNDING * surface.area]
    np.testing.assert_allclose(normals, np.broadcast_to(normals[0], normals.shape), atol=1e-9)


def test_a_polygon_that_crosses_itself_stays_the_fold_that_it_is(tmp_path: Path) -> None:
    # one that no triangles fit, from any corner, does not hold up the others
    path = tmp_path / "bow.off"
    path.write_text("OFF\n5 2 0\n0 0 0\n1 0 0\n0 1.5 0\n1 1 0\n5 5 0\n4 0 1 2 3\n3 0 1 4\n")
    assert len(read_surface(path).faces) == 3


def test_polygons_without_any_vertex_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "none.off"
    path.write_text("OFF\n0 2 0\n3 0 1 2\n4 0 1 2 3\n")
    with pytest.raises(
        InputError, match=r"none\.off: holds 0 vertices and 3 triangles; a surface needs both"
    ):
        read_surface(path)


CONTINUED = "# made in C:\\models\\\nv 0 0 0\nv 1 0 \\\n0\nv 1 \\\r\n 1 \\\n0\nv 0 1 0\nf 1 2 \\\n 3 4\n"


def test_obj_lines_go_on_behind_a_backslash(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(CONTINUED)
    surface = read_surface(path)
    assert (len(surface.vertices), surface.area) == (4, 1.0)
    path.write_text(CONTINUED + "f 1 2 \\\nx\n")  # the line that the statement begins in
    with pytest.raises(InputError, match=r"a\.obj: line 11: face 'x' is not a number"):
        read_surface(path)
    path.write_text(CONTINUED + "f 1 2 4\\\n")
    with pytest.raises(InputError, match=r"line 11: ends in a backslash, and no line follows"):
        read_surface(path)


@pytest.mark.parametrize("behind", [b"\0", b"made by a scanner", bytes(428), b"\n\0 \xff" * 40])
def test_stl_may_go_on_behind_its_triangles(behind: bytes, tmp_path: Path) -> None:
    path = write_as("stl", tmp_path)
    path.write_bytes(path.read_bytes() + behind)
    sentences = convert(path, tmp_path / "a.ply", units="mm")
    assert f"{path}: {len(behind)} bytes behind the last triangle are left out" in sentences
    surface = read_surface(tmp_path / "a.ply")
    same_body(surface.vertices, surface.faces, TOLERANCE["stl"])


def test_stl_with_more_triangles_than_it_states_is_refused(tmp_path: Path) -> None:
    path = write_as("stl", tmp_path)
    data = path.read_bytes()
    path.write_bytes(data + data[84:134] + b"end")
    with pytest.raises(InputError, match=r"stl\.stl: states 4 triangles, and another follows"):
        read_surface(path)


def test_other_binary_files_are_not_taken_for_stl(tmp_path: Path) -> None:
    path = tmp_path / "a.stl"
    noise = np.random.default_rng(40_129)
    for _ in range(20):
        path.write_bytes(noise.bytes(80) + np.uint32(3).tobytes() + noise.bytes(500))
        with pytest.raises(InputError, match="not a surface file that o3dls knows"):
            read_surface(path)


PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property list uchar int near
property list uchar float shift
property float bipolar
element face 2
property list uchar int vertex_indices
end_header
0 0 0 2 7 8 2 3 4 0.5
1 0 0 0 2 5 6 0.25
1 1 0 1 9 2 7 8 nan
0 1 0 2 3 4 2 9 1 2
3 0 1 2
3 0 2 3
"""


def binary(ply: str) -> bytes:
    """The file above in binary, little-endian."""
    head, body = ply.split("end_header\n")
    rows = [line.split() for line in body.splitlines()]
    packed = [
        struct.pack(f"<3fB{len(r) - 8}iB3f", *map(float, r[:3]), *map(int, r[3:-3]), *map(float, r[-3:]))
        for r in rows[:4]
    ]
    packed += [struct.pack("<B3i", *map(int, r)) for r in rows[4:]]
    return head.replace("ascii", "binary_little_endian").encode() + b"end_header\n" + b"".join(packed)


@pytest.mark.parametrize("data", [PLY.encode(), binary(PLY)], ids=["ascii", "binary"])
def test_a_list_property_of_ply_does_not_take_the_scalars_with_it(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(data)
    sentences = convert(path, tmp_path / "a.vtp", units="mm")
    said = "list property 'near' of element 'vertex' is left out: its lists differ in length"
    assert f"{path}: {said}" in sentences
    fields = read_surface(tmp_path / "a.vtp").fields
    assert list(fields) == ["shift", "bipolar"]
    np.testing.assert_array_equal(fields["shift"], [[3, 4], [5, 6], [7, 8], [9, 1]])
    np.testing.assert_array_equal(fields["bipolar"], [0.5, 0.25, np.nan, 2])


SCAR = np.array([0.5, np.nan, 2.25, 4.0])
REGION = np.array([7, 7, 3, 12], dtype=np.int32)
FIBRES = np.array([[1.0, 0, 0], [0, 1, 0], [0.6, 0.8, 0], [0, 0, 1]])


def with_cell_data() -> Any:
    """The marker as pyvista's object; VTK orders a vertex and a line before its triangles."""
    pyvista = pytest.importorskip("pyvista")
    faces = np.column_stack([np.full(4, 3), marker().faces]).ravel()
    mesh = pyvista.PolyData(marker().vertices, faces=faces, lines=np.array([2, 0, 1]), verts=np.array([1, 3]))
    assert mesh.n_cells == 6
    mesh.point_data["depth"] = np.arange(4.0)
    mesh.cell_data["scar"] = np.append([100.0, 100.0], SCAR)
    mesh.cell_data["region"] = np.append(np.array([90, 91], dtype=np.int32), REGION)
    mesh.cell_data["fibres"] = np.vstack([np.zeros((2, 3)), FIBRES])
    mesh.cell_data["depth"] = np.arange(6.0)
    return mesh


def saved(mesh: Any, path: Path, form: str) -> Path:
    """A data set as VTK itself writes it."""
    vtk = pytest.importorskip("vtk")
    kind, mode = form.split()
    grid = mesh.GetClassName() == "vtkUnstructuredGrid"
    if kind == "xml":
        writer = vtk.vtkXMLUnstructuredGridWriter() if grid else vtk.vtkXMLPolyDataWriter()
        getattr(writer, f"SetDataModeTo{mode}")()
    else:
        writer = vtk.vtkUnstructuredGridWriter() if grid else vtk.vtkPolyDataWriter()
        writer.SetFileVersion(int(kind))
        getattr(writer, f"SetFileTypeTo{mode}")()
    writer.SetInputData(mesh)
    writer.SetFileName(str(path))
    assert writer.Write() == 1
    return path


FORMS = ["42 ASCII", "42 Binary", "51 ASCII", "51 Binary", "xml Ascii", "xml Binary", "xml Appended"]


@pytest.mark.parametrize("form", FORMS)
def test_cell_data_of_vtk_are_carried_to_the_points(form: str, tmp_path: Path) -> None:
    path = saved(with_cell_data(), tmp_path / "a.vtk", form)
    file = read_surface_file(path)
    expected = {name: at_vertices(marker(), values) for name, values in (("scar", SCAR), ("fibres", FIBRES))}
    for name, values in {**expected, "depth": np.arange(4.0)}.items():
        np.testing.assert_allclose(file.surface.fields[name], values, rtol=1e-6)  # text has so many digits
    np.testing.assert_array_equal(file.surface.fields["region"], at_vertices(marker(), REGION))
    assert set(file.notes) == {
        "2 cells that are points or lines are left out",
        "cell data 'scar' are carried to the points: the mean, weighted by area, of the cells around each",
        "cell data 'region' are carried to the points: the label with the largest area around each",
        "cell data 'fibres' are carried to the points: the mean, weighted by area, of the cells around each",
        "cell data 'depth' are left out: the points have a field of that name",
    }


@pytest.mark.parametrize("form", ["42 ASCII", "xml Binary"])
def test_cell_data_of_strips_and_polygons_belong_to_their_triangles(form: str, tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista")
    places = np.array([(x, y, 0.0) for x in range(4) for y in range(2)])
    mesh = pyvista.PolyData(places, faces=np.array([4, 0, 2, 3, 1]), strips=np.array([4, 2, 4, 3, 5]))
    mesh.cell_data["region"] = np.array([5, 8], dtype=np.int64)
    surface = read_surface(saved(mesh, tmp_path / "a.vtk", form))
    np.testing.assert_array_equal(surface.fields["region"][[0, 1, 4, 5]], [5, 5, 8, 8])
    assert (surface.face_normals[:, 2] > 0).all()


@pytest.mark.parametrize("form", FORMS)
def test_text_at_points_and_cells_is_left_out_and_said(form: str, tmp_path: Path) -> None:
    mesh = with_cell_data()
    mesh.point_data["who"] = np.array(["a", "b c", "", "d"])
    mesh.cell_data["vein"] = np.array(["x", "y", "LSPV", "LIPV", "RSPV", "RIPV"])
    file = read_surface_file(saved(mesh, tmp_path / "a.vtk", form))
    assert {"text 'who' is left out", "text 'vein' is left out"} <= set(file.notes)
    assert set(file.surface.fields) == {"depth", "scar", "region", "fibres"}


def test_fibres_that_oppose_each_other_are_said(tmp_path: Path) -> None:
    mesh = with_cell_data()
    mesh.cell_data["fibres"] = np.vstack([np.zeros((2, 3)), np.eye(3)[[0, 0, 0, 0]] * [[1], [-1], [1], [-1]]])
    said = read_surface_file(saved(mesh, tmp_path / "a.vtp", "xml Binary")).notes
    assert any("cell data 'fibres' oppose each other around" in sentence for sentence in said)


def test_values_per_face_of_ply_are_carried_too(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    faces = "property list uchar int vertex_indices\nproperty uchar region\nproperty float scar\nend_header"
    rows = PLY.replace("property list uchar int vertex_indices\nend_header", faces).replace(
        "\n3 0 1 2\n", "\n4 0 1 2 3 4 0.5\n"
    )
    path.write_text(rows.replace("\n3 0 2 3\n", "\n3 0 2 1 9 1.5\n"))
    fields = read_surface(path).fields
    np.testing.assert_array_equal(fields["region"], [4, 4, 4, 4])
    np.testing.assert_allclose(fields["scar"], [2.5 / 3, 1.0, 2.5 / 3, 0.5])


def test_cell_data_reach_every_door(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = saved(with_cell_data(), tmp_path / "prior.vtp", "xml Binary")
    scar = at_vertices(marker(), SCAR)
    said = "cell data 'scar' are carried to the points: the mean, weighted by area, of the cells around each"
    assert f"{path}: {said}" in convert(path, tmp_path / "a.ply", units="mm")
    np.testing.assert_array_equal(read_surface(tmp_path / "a.ply").fields["scar"], scar)
    with caplog.at_level("INFO", "o3dls"):
        prior = surface_of(Folder(tmp_path, {"units": "mm"}, {}), "prior")
    np.testing.assert_array_equal(prior.surface.fields["scar"], scar)
    assert f"{path}: {said}" in caplog.messages
    found = import_study(carto_folder(tmp_path / "study"), "1-Map", tmp_path / "case", prior=path)
    assert f"{path}: {said}" in found.notes
    np.testing.assert_array_equal(read_surface(tmp_path / "case/prior.ply").fields["scar"], scar)


def test_without_its_package_lz4_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    vtk = pytest.importorskip("vtk")
    writer = vtk.vtkXMLPolyDataWriter()
    writer.SetCompressor(vtk.vtkLZ4DataCompressor())
    writer.SetInputData(with_cell_data())
    writer.SetFileName(str(tmp_path / "a.vtp"))
    writer.Write()
    monkeypatch.setattr(vtp_arrays, "find_spec", lambda name: None)
    with pytest.raises(
        InputError, match=r"a\.vtp: is packed by LZ4, .* pip install lz4, or save it with zlib"
    ):
        read_surface(tmp_path / "a.vtp")
    text = (tmp_path / "a.vtp").read_text().replace("LZ4", "Snappy")
    (tmp_path / "a.vtp").write_text(text)
    with pytest.raises(InputError, match="packed by vtkSnappyDataCompressor: must be zlib, lz4, lzma"):
        read_surface(tmp_path / "a.vtp")


def test_missing_values_survive_opencarp_with_their_masks(tmp_path: Path) -> None:
    fields = {
        "shift_x": np.array([0.5, np.nan, -10_000.0, np.inf]),  # which no quantity is named
        "lat": np.arange(4.0),
        "lat_known": np.array([0.0, 1, 1, 0]),
    }
    surface = Surface(marker().vertices, marker().faces, fields | {"shift": np.zeros((4, 3))})
    assert write_surface(tmp_path / "la.pts", surface) == [
        "2 of 4 vertices have no 'shift_x': they are -10000 there, and 0 in a mask, the .dat file of the "
        "same name with _known",
        "the format has no room for: shift",
    ]
    back = read_surface(tmp_path / "la.pts").fields
    assert set(back) == set(fields)
    np.testing.assert_array_equal(back["shift_x"], [0.5, np.nan, -10_000, np.nan])
    for name in ("lat", "lat_known"):  # which are no field and its mask
        np.testing.assert_array_equal(back[name], fields[name])


def test_a_mask_takes_no_name_that_is_there(tmp_path: Path) -> None:
    fields = {"lat_known": np.array([5.0, 6, 7, 8]), "lat": np.array([1.0, np.nan, 2, 3])}
    write_surface(tmp_path / "la.pts", Surface(marker().vertices, marker().faces, fields))
    back = read_surface(tmp_path / "la.pts").fields
    np.testing.assert_array_equal(back["lat_known"], fields["lat_known"])
    np.testing.assert_array_equal(back["lat_"], fields["lat"])


LOSSES = {
    "ply": "",
    "vtk": "",
    "vtp": "",
    "stl": "bipolar, depth",
    "obj": "bipolar, depth",
    "off": "bipolar, depth",
    "carto_mesh": "depth",
    "dif": "depth",
    "openep": "depth",
    "opencarp": "",
    "carto_vtk": "depth",
}


def test_the_losses_of_every_format_are_tested() -> None:
    assert LOSSES.keys() == TOLERANCE.keys()


@pytest.mark.parametrize("name", list(LOSSES))
def test_conversion_says_what_the_format_does_not_keep(name: str, tmp_path: Path) -> None:
    target = tmp_path / f"out.{SUFFIX.get(name, name)}"
    sentences = convert(write_as("ply", tmp_path), target, format=name)
    said = [sentence for sentence in sentences if "has no room" in sentence]
    assert said == ([f"{target}: the format has no room for: {LOSSES[name]}"] if LOSSES[name] else [])
    missing = [sentence for sentence in sentences if "1 of 4 vertices have no 'bipolar'" in sentence]
    assert len(missing) == (name in ("opencarp", "carto_vtk"))
    left = {word for word in LOSSES[name].split(", ") if word}
    assert not left & read_surface(target).fields.keys()


def test_regions_of_opencarp_are_carried_where_they_differ(tmp_path: Path) -> None:
    path = write_as("opencarp", tmp_path)
    elements = path.with_suffix(".elem")
    whole = elements.read_text()
    assert "tag" not in read_surface(path).fields
    rows = [f"{line[:-1]}{tag}\n" for line, tag in zip(whole.splitlines()[1:], REGION.tolist(), strict=True)]
    elements.write_text("".join(["4\n", *rows]))
    file = read_surface_file(path)
    np.testing.assert_array_equal(file.surface.fields["tag"], at_vertices(marker(), REGION))
    assert (
        "cell data 'tag' are carried to the points: the label with the largest area around each" in file.notes
    )
    elements.write_text(whole.replace("3 1\n", "3 1.5\n"))
    with pytest.raises(InputError, match=r"opencarp\.elem: tag: 1\.5 must be a whole number"):
        read_surface(path)
    elements.write_text(whole.replace(" 1\n", "\n"))  # an element may have none
    assert "tag" not in read_surface(path).fields


def test_the_command_line_says_what_was_carried_and_left(tmp_path: Path) -> None:
    def said(*arguments: object) -> str:
        command = [sys.executable, "-m", "o3dls", *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        return done.stdout + done.stderr

    path = saved(with_cell_data(), tmp_path / "prior.vtp", "xml Binary")
    carried = f"{path}: cell data 'scar' are carried to the points: the mean, weighted by area"
    text = said("convert", path, tmp_path / "a.stl", "--units", "mm")
    assert carried in text
    assert f"{tmp_path / 'a.stl'}: the format has no room for: depth, scar, region, fibres" in text
    text = said(
        "import", carto_folder(tmp_path / "study"), tmp_path / "case", "--map", "1-Map", "--prior", path
    )
    assert carried in text


@pytest.mark.parametrize("lists", [1, 2])
def test_a_ply_of_no_faces_is_refused_however_they_would_be_written(lists: int, tmp_path: Path) -> None:
    """Rows of two lists are polygons one by one, and of none there is nothing to put together."""
    path = tmp_path / "none.ply"
    more = "property list uchar float q\n" * (lists - 1)
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face 0\nproperty list uchar int vertex_indices\n{more}end_header\n0 0 0\n"
    )
    with pytest.raises(InputError, match="holds 1 vertices and 0 triangles"):
        read_surface(path)
