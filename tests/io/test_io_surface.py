"""Surfaces from and to files: nothing that a format can carry is lost, nothing broken is read."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from o3dls.errors import InputError
from o3dls.geometry.surface import Surface, outline
from o3dls.io.meshes.carto.import_vtk import encode, map_field
from o3dls.io.surfaces import FORMATS, read_surface, read_surface_file, write_surface

TEXT_DIGITS = 1e-8  # relative: text formats keep nine digits
FLOAT32 = 1e-6
WITH_FIELDS = ("ply", "vtk", "vtp")
STATES_UNITS = ("ply", "vtk", "vtp", "off", "stl", "obj")
VTK_POINTS = b"# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 3 float\n"
PLY_VERTICES = b"ply\nformat ascii 1.0\ncomment VTK generated PLY File\nelement vertex 3\n" + b"".join(
    b"property float %c\n" % c for c in b"xyz"
)
PLY_ROWS = b"property list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
TOLERANCE = {
    "ply": 0.0,
    "vtk": 0.0,
    "vtp": 0.0,
    "off": TEXT_DIGITS,
    "obj": TEXT_DIGITS,
    "stl": FLOAT32,
    "carto_vtk": 1e-6,
}
WRITTEN = [f.name for f in FORMATS if f.write and f.name in TOLERANCE]


def marker() -> Surface:
    """A tetrahedron without any symmetry, so that a swapped axis, a flip or a scale shows."""
    vertices = np.array(
        [[10.0, -20.0, 30.0], [47.25, -18.5, 33.0], [12.0, 3.75, 35.5], [14.5, -15.0, 91.125]]
    )
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    fields = {"bipolar": np.array([0.1, np.nan, 2.5, 1.25]), "shift": np.arange(12.0).reshape(4, 3)}
    return Surface(vertices, faces, fields)


def by_position(surface: Surface) -> np.ndarray:
    """Corners of the triangles in an order that does not depend on the numbering, (m, 9)."""
    corners = surface.vertices[surface.faces]
    first = np.lexsort(np.round(corners, 3).transpose(2, 0, 1)[::-1], axis=-1)[:, 0]
    turned = corners[np.arange(len(corners))[:, None], (first[:, None] + np.arange(3)) % 3]
    flat = turned.reshape(-1, 9)
    return flat[np.lexsort(np.round(flat, 3).T[::-1])]


def written(name: str, surface: Surface, folder: Path, **notes: str) -> Path:
    path = folder / f"surface.{'vtk' if name == 'carto_vtk' else name}"
    write_surface(path, surface, format=name, **notes)
    return path


@pytest.mark.parametrize("name", WRITTEN)
def test_what_is_written_is_read_back(name: str, tmp_path: Path) -> None:
    file = read_surface_file(written(name, marker(), tmp_path, space="LPS", units="mm"))
    scale = np.abs(marker().vertices).max()
    np.testing.assert_allclose(
        by_position(file.surface), by_position(marker()), rtol=0, atol=max(TOLERANCE[name] * scale, 1e-12)
    )
    assert file.surface.watertight
    assert file.surface.volume > 0
    assert (file.space, file.units) == (("LPS", "mm") if name in STATES_UNITS else ("unknown", "unknown"))


def test_frame_and_units_in_a_header_are_read_in_any_case(tmp_path: Path) -> None:
    path = written("ply", marker(), tmp_path, space="RAS", units="mm")
    path.write_bytes(path.read_bytes().replace(b"SPACE=RAS", b"SPACE=ras").replace(b"UNITS=mm", b"UNITS=MM"))
    assert (read_surface_file(path).space, read_surface_file(path).units) == ("RAS", "mm")


@pytest.mark.parametrize("name", WITH_FIELDS)
def test_fields_survive_with_their_missing_values(name: str, tmp_path: Path) -> None:
    fields = read_surface(written(name, marker(), tmp_path)).fields
    for key, values in marker().fields.items():
        np.testing.assert_array_equal(fields[key], values)


@pytest.mark.parametrize("name", WRITTEN)
def test_equal_surfaces_give_equal_bytes(name: str, tmp_path: Path) -> None:
    first = written(name, marker(), tmp_path).read_bytes()
    assert written(name, marker(), tmp_path).read_bytes() == first


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    name=st.sampled_from(WITH_FIELDS),
    vertices=arrays(np.float64, (6, 3), elements=st.floats(-1e6, 1e6)),
    values=arrays(np.float64, 6, elements=st.floats(allow_nan=True, allow_infinity=False, width=32)),
    key=st.text("abcXYZ_µ%", min_size=1, max_size=8),
)
def test_any_surface_survives(
    name: str, vertices: np.ndarray, values: np.ndarray, key: str, tmp_path: Path
) -> None:
    surface = Surface(vertices, np.array([[0, 1, 2], [3, 4, 5], [0, 4, 2]]), {key: values})
    back = read_surface(written(name, surface, tmp_path))
    np.testing.assert_array_equal(back.vertices, surface.vertices)
    np.testing.assert_array_equal(back.faces, surface.faces)
    np.testing.assert_array_equal(back.fields[key], values)


@pytest.mark.parametrize("name", WRITTEN)
def test_formats_are_told_by_content_not_by_suffix(name: str, tmp_path: Path) -> None:
    path = written(name, marker(), tmp_path)
    renamed = path.rename(tmp_path / "surface.dat")
    assert len(read_surface(renamed).faces) == 4


@pytest.mark.parametrize("name", WRITTEN)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.95])
def test_truncated_files_are_refused(name: str, share: float, tmp_path: Path) -> None:
    surface = Surface(marker().vertices, marker().faces)
    path = written(name, surface, tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    if name == "carto_vtk" and share > 0.5:
        return  # the cut is in the colour table, which is not the surface
    with pytest.raises(InputError, match=r"surface\."):
        read_surface(path)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"\x93\x07garbage" * 40, "not a surface file that o3dls knows"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n", "no line 'end_header'"),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty int x\nproperty int y\nproperty int "
            b"z\nend_header\n1 2 3\n",
            "has no faces",
        ),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1,5 0\n3 0 1 2\n", r"line 5: vertex '1,5' has a decimal comma"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 nan 0\n3 0 1 2\n", "vertex 2 is not finite"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", r"names vertices \[0, 1, 3\]: there are 3"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 1\n", "names one vertex twice"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 1.5\n", "not a whole number"),
        (b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "3 vertices and 0 triangles"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "counts from 1"),
        (b"v 0 0 0\nv 1 0 0\nv 0 one 0\nf 1 2 3\n", "line 3: vertex 'one' is not a number"),
        (
            b"# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 3 float\n0 0 0\n1 0 0\n",
            "line 7: 9 numbers are declared, 6",
        ),
        (b"v 0 0 0\nv 5_0 0 0\nv 0 1 0\nf 1 2 3\n", "line 2: vertex '5_0' is not a number"),
        (VTK_POINTS + b"0 0 0\n1,5 0 0\n0 1,5 0\n", "line 7: value '1,5' has a decimal comma"),
        (VTK_POINTS + b"0 0 0\n1 0 0\n0 1_5 0\n", "line 8: value '1_5' is not a number"),
        (
            b"<DIF><DIFBody><Volumes><Volume><Vertices>0 0 1_5</Vertices></Volume></Volumes></DIFBody></DIF>",
            "'1_5' is not a number",
        ),
        (
            PLY_VERTICES + b"element tristrips 1\n" + PLY_ROWS,
            r"holds triangle strips \(element 'tristrips'\), which are not read",
        ),
        (PLY_VERTICES + b"element face 1\n" + PLY_ROWS[:-1], "the last line has no end"),
        (
            PLY_VERTICES
            + b"element face 1\n"
            + PLY_ROWS.replace(b"list int ", b"").replace(b"3 0 1 2", b"3"),
            "has no faces",
        ),
        (
            b"# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_POINTS\n",
            "line 4: .* must be DATASET POLYDATA",
        ),
        (b"<?xml version='1.0'?><VTKFile type='PolyData'><PolyData>", "not well-formed XML"),
    ],
)
def test_broken_files_are_named_with_place_and_reason(content: bytes, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.ply"
    path.write_bytes(content)
    with pytest.raises(InputError, match=sentence) as error:
        read_surface(path)
    assert "broken.ply" in str(error.value)


def test_missing_empty_and_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_surface(tmp_path / "none.ply")
    (tmp_path / "empty.ply").touch()
    with pytest.raises(InputError, match="is empty"):
        read_surface(tmp_path / "empty.ply")
    os.mkfifo(tmp_path / "pipe.ply")
    with pytest.raises(InputError, match="is a pipe or a device"):  # opening one would wait for ever
        read_surface(tmp_path / "pipe.ply")
    (tmp_path / "pipe.ply").unlink()
    with pytest.raises(InputError, match="is a folder"):
        read_surface(tmp_path)
    with pytest.raises(InputError, match=r"cannot write surfaces as '\.xyz'"):
        write_surface(tmp_path / "a.xyz", marker())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["empty.ply"]


def test_polygons_strips_and_foreign_properties_are_understood(tmp_path: Path) -> None:
    square = b"OFF # a comment\n# another\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3  255 0 0\n"
    corners = b"POINTS 4 float\n0 0 0 1 0 0 0 1 0 1 1 0\n"
    strip = (
        b"# vtk DataFile Version 2.0\nt\nASCII\nDATASET POLYDATA\n"
        + corners
        + b"TRIANGLE_STRIPS 1 5\n4 0 1 2 3\n"
    )
    mixed = (
        b"ply\r\nformat ascii 1.0\r\nelement vertex 4\r\nproperty float x\r\nproperty float "
        b"y\r\nproperty float z\r\nproperty uchar red\r\n"
        b"element face 2\r\nproperty uchar flag\r\nproperty list uchar int vertex_index\r\nend_header\r\n"
        b"0 0 0 9\r\n1 0 0 8\r\n1 1 0 7\r\n0 1 0 6\r\n1 3 0 1 2\r\n1 4 0 1 2 3\r\n"
    )
    for content, faces in ((square, 2), (strip, 2), (mixed, 3)):
        path = tmp_path / "any"
        path.write_bytes(content)
        surface = read_surface(path)
        assert len(surface.faces) == faces
        assert (surface.face_normals[:, 2] > 0).all()
    np.testing.assert_array_equal(surface.fields["red"], [9, 8, 7, 6])


def test_obj_with_texture_and_backward_indices(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("o thing\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1/1/1 2//1 3\nf -3 -2 -1\n")
    np.testing.assert_array_equal(read_surface(path).faces, [[0, 1, 2], [0, 1, 2]])


def test_obj_indices_count_back_from_where_they_stand(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    corners = marker().vertices[marker().faces].reshape(-1, 3, 3)
    path.write_text(
        "".join(
            "".join("v {} {} {}\n".format(*v) for v in triangle) + "  f -3 -2 -1\n" for triangle in corners
        )
    )
    np.testing.assert_array_equal(by_position(read_surface(path)), by_position(marker()))


@pytest.mark.parametrize("first", range(5))
def test_polygons_with_a_reflex_corner_are_cut_inside_from_any_first_corner(
    first: int, tmp_path: Path
) -> None:
    path = tmp_path / "dented.off"
    for dented in ([(0, 0), (50, 0), (10, 10), (0, 50)], [(0, 0), (50, 0), (10, 10), (20, 50), (0, 50)]):
        ring = np.roll(np.column_stack([dented, np.zeros(len(dented))]), -first, axis=0)
        x, y, _ = ring.T
        n = len(ring)
        rows = "".join("{} {} {}\n".format(*v) for v in ring)
        path.write_text(f"OFF\n{n} 1 0\n{rows}{n} {' '.join(map(str, range(n)))}\n")
        shoelace = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
        assert read_surface(path).area == pytest.approx(shoelace)


@pytest.mark.parametrize("name", ["obj", "off"])
def test_a_cut_within_the_last_number_is_seen(name: str, tmp_path: Path) -> None:
    ring = 15 * np.column_stack([np.cos(np.arange(120)), np.sin(np.arange(120)), np.arange(120)])
    faces = np.arange(120).reshape(-1, 3)
    path = written(name, Surface(ring, faces), tmp_path)
    path.write_bytes(path.read_bytes()[:-2])  # 119 becomes 11
    with pytest.raises(InputError, match="the last line has no end"):
        read_surface(path)
    path.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2")  # other programs end their files so
    assert len(read_surface(path).faces) == 1


def test_field_names_of_ply_never_clash(tmp_path: Path) -> None:
    column = np.arange(4.0)
    names = ["x", "nz", "a b", "a_b", "", "lat", "lat_0", "lat_1", "run_0", "run_1", "run_3", "shift_0"]
    fields = {name: column + k for k, name in enumerate(names)} | {"shift": np.arange(12.0).reshape(4, 3)}
    back = read_surface(written("ply", Surface(marker().vertices, marker().faces, fields), tmp_path)).fields
    stored = ["x_", "nz_", "a_b", "a_b_", "_", *names[5:], "shift_"]
    assert set(back) == set(stored)
    for name, values in zip(stored, fields.values(), strict=True):
        np.testing.assert_array_equal(back[name], values)


POINT_DATA = "POINT_DATA {n}\nSCALARS depth float\nLOOKUP_TABLE default\n{values}\n"
TRIANGLE = (
    "# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 3 float\n0 0 0\n1 0 0\n0 1 "
    "0\nPOLYGONS 1 4\n3 0 1 2\n"
)
COUNTED = "FIELD f 1\ndepth 1 2 float\n1 2\n"


def test_point_and_cell_data_of_another_length_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.vtk"
    for content in (POINT_DATA.format(n=2, values="1 2"), f"POINT_DATA 3\n{COUNTED}"):
        path.write_text(TRIANGLE + content)
        with pytest.raises(InputError, match=r"line 1\d: point data 'depth' have 2 rows: there are 3 points"):
            read_surface(path)
    path.write_text(TRIANGLE + POINT_DATA.format(n=3, values="1 2 3") + f"CELL_DATA 2\n{COUNTED}")
    with pytest.raises(InputError, match=r"line 18: cell data 'depth' have 2 rows: there are 1 cells"):
        read_surface(path)


def test_stl_vertices_are_merged(tmp_path: Path) -> None:
    surface = read_surface(written("stl", marker(), tmp_path))
    assert len(surface.vertices) == 4


def test_outlines_keep_area_holes_and_fields(tmp_path: Path) -> None:
    path = tmp_path / "outline.csv"
    outer, hole = np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]]), np.array([[1.0, 1], [1, 2], [2, 2], [2, 1]])
    ring = np.array([[k, (k + 1) % 4] for k in range(4)])
    write_surface(
        path, Surface(np.vstack([outer, hole]), np.vstack([ring, ring + 4]), {"sd": np.arange(8.0)})
    )
    back = read_surface(path)
    assert back.volume == pytest.approx(15.0)
    np.testing.assert_array_equal(back.fields["sd"], np.arange(8.0))
    path.write_text("x,y\n0,0\n0,1\n1,1\n1,0\n0,0\n")
    assert read_surface(path).volume == pytest.approx(1.0)
    path.write_text("x,y\n0,0\n0,1\n")
    with pytest.raises(InputError, match="at least 3 points"):
        read_surface(path)
    write_surface(tmp_path / "outline.vtp", outline(outer))  # ParaView shows it as lines


def test_carto_dialect_word_for_word(tmp_path: Path) -> None:
    lines = written("carto_vtk", marker(), tmp_path).read_bytes().decode("ascii").split("\n")
    assert lines[:6] == [
        "# vtk DataFile Version 3.0",
        "PatientData Anon Anon 00000000",
        "ASCII",
        "DATASET POLYDATA",
        "POINTS 4 float",
        "10.0000 -20.0000 30.0000",
    ]
    assert lines[9:12] == ["", "POLYGONS 4 16", "3 0 2 1"]
    assert lines[15:19] == ["", "POINT_DATA 4", "SCALARS scalars float", "LOOKUP_TABLE lookup_table"]
    assert lines[19:23] == ["0.0078", "0.0000", "1.0000", "0.4832"]  # the second is missing
    assert lines[23:25] == ["", "LOOKUP_TABLE lookup_table 256"]
    assert lines[25:27] == ["0.5000 0.5000 0.5000 1.0", "0.0400 0.2100 0.2500 1.0"]
    assert len(lines) == 25 + 256 + 1


def test_carto_scalar_mapping_says_what_it_did() -> None:
    mapped = map_field(marker(), "bipolar", (0.0, 2.0))
    least = 2 / 256
    np.testing.assert_allclose(
        mapped.values, [least + (1 - least) * 0.05, 0.0, 1.0, least + (1 - least) * 0.625]
    )
    assert mapped.meaning == {
        "field": "bipolar",
        "values": [0.0, 2.0],
        "at": [least, 1.0],
        "missing_vertices": 1,
        "missing_at": 0.0,
    }
    assert mapped.notes == (
        "1 of 4 vertices have no 'bipolar': they are 0, grey in the file's table of colours, and values "
        "begin at 0.0078",
    )
    with pytest.raises(InputError, match="did you mean 'bipolar'"):
        map_field(marker(), "bipolr")
    with pytest.raises(InputError, match="must be below"):
        map_field(marker(), "bipolar", (2.0, 0.5))
    with pytest.raises(InputError, match="must be below"):
        map_field(marker(), "bipolar", (2.0, 2.0))


def test_without_missing_values_the_carto_scalar_fills_its_range() -> None:
    surface = Surface(marker().vertices, marker().faces, {"depth": np.array([1.0, 2.0, 5.0, 9.0])})
    mapped = map_field(surface, "depth")
    np.testing.assert_allclose(mapped.values, [0.0, 0.125, 0.5, 1.0])
    assert mapped.meaning == {"field": "depth", "values": [1.0, 9.0], "at": [0.0, 1.0], "missing_vertices": 0}
    assert not mapped.notes
    assert b"LOOKUP_TABLE lookup_table 256\n0.0400 0.2100 0.2500 1.0\n" in encode(surface, mapped)


@pytest.mark.parametrize("limits", [None, (0.0, 6.0)])
@pytest.mark.parametrize("missing", [False, True])
def test_a_carto_scalar_of_one_value_is_told_from_missing_ones(
    limits: tuple[float, float] | None, missing: bool
) -> None:
    values = np.array([3.0, np.nan if missing else 3.0, 3.0, 3.0])
    mapped = map_field(Surface(marker().vertices, marker().faces, {"lat": values}), "lat", limits)
    expected = 1.0 if limits is None else 0.5 + missing / 256
    np.testing.assert_allclose(mapped.values, [expected, 0.0 if missing else expected, expected, expected])
    assert ("'lat' is 3 everywhere, and is written as 1" in mapped.notes) == (limits is None)


def test_vtk_paints_missing_values_of_a_carto_scalar_grey_and_the_least_one_not(tmp_path: Path) -> None:
    vtk = pytest.importorskip("vtk")
    reader = vtk.vtkPolyDataReader()
    reader.SetFileName(str(written("carto_vtk", marker(), tmp_path)))
    reader.Update()
    scalars = reader.GetOutput().GetPointData().GetScalars()
    table = scalars.GetLookupTable()
    colours = np.zeros((4, 3))
    for k, colour in enumerate(colours):
        table.GetColor(scalars.GetValue(k), colour)
    one_of_255 = 1 / 255
    np.testing.assert_allclose(colours[1], [0.5, 0.5, 0.5], atol=one_of_255)
    np.testing.assert_allclose(colours[0], [0.04, 0.21, 0.25], atol=one_of_255)
    np.testing.assert_allclose(colours[2], [0.90, 0.11, 0.14], atol=one_of_255)


@pytest.mark.parametrize("name", ["ply", "stl", "obj", "off"])
def test_trimesh_reads_the_same_body(name: str, tmp_path: Path) -> None:
    import trimesh

    body = trimesh.load(written(name, marker(), tmp_path), process=True)
    assert body.is_watertight
    assert body.volume == pytest.approx(marker().volume, rel=1e-5)
    np.testing.assert_allclose(
        body.bounds, [marker().vertices.min(axis=0), marker().vertices.max(axis=0)], rtol=1e-6
    )


def test_samples_of_the_formats_are_one_sphere(shared_data: Path) -> None:
    """Icosphere of radius 25 mm at (10, -20, 30): a wrong unit or frame shows in its centre."""
    found = [
        p
        for pattern in ("stl_ply/*.[ps]*", "vtk_carto/*.vtk", "vtp/*.vtp")
        for p in (shared_data / "formats/samples").glob(pattern)
    ]
    assert len(found) == 5
    for path in found:
        surface = read_surface(path)
        assert (len(surface.vertices), len(surface.faces)) == (162, 320), path
        np.testing.assert_allclose(surface.vertices.mean(axis=0), [10, -20, 30], atol=1e-3)


def test_collapsed_triangles_of_a_closed_surface_are_left_out_and_it_stays_closed(tmp_path: Path) -> None:
    # edge 0-1 carries a triangle 0-1-0 between its two neighbours, as isosurfaces do
    path = tmp_path / "tetra.off"
    path.write_text("OFF\n4 5 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 0\n3 0 1 3\n3 1 2 3\n3 2 0 3\n")
    surface = read_surface(path)
    assert len(surface.faces) == 4
    assert surface.watertight
