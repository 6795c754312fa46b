"""What mesh files of other programs hold beyond triangles with values at their vertices."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from formats import TOLERANCE, same_body, write_as

from o3dls.errors import InputError
from o3dls.io.meshes.registry import read_surface
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
        with pytest.raises(InputError, match="no surface file that o3dls knows"):
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
    said = "list property 'near' of the vertices is left out: its lists differ in length"
    assert f"{path}: {said}" in sentences
    fields = read_surface(tmp_path / "a.vtp").fields
    assert list(fields) == ["shift", "bipolar"]
    np.testing.assert_array_equal(fields["shift"], [[3, 4], [5, 6], [7, 8], [9, 1]])
    np.testing.assert_array_equal(fields["bipolar"], [0.5, 0.25, np.nan, 2])
