"""A surface is read whole or refused: rows that one changed byte would have left out without a word."""

from __future__ import annotations

from pathlib import Path

import pytest
from formats import marker, write_as

import o3dls
from o3dls.errors import InputError
from o3dls.io.surfaces import read_surface_file

BODY = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\n"  # without its last face


def text_ply(path: Path) -> bytes:
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(marker().vertices), o3d.utility.Vector3iVector(marker().faces)
    )
    o3d.io.write_triangle_mesh(str(path), mesh, write_ascii=True)
    return path.read_bytes()


@pytest.mark.parametrize("fewer", [1, 3])
def test_a_header_of_ply_that_counts_too_few_faces_is_refused(fewer: int, tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    rows = {b"bytes": write_as("ply", tmp_path).read_bytes(), b"lines": text_ply(path)}
    for what, data in rows.items():
        wrong = data.replace(b"element face 4", b"element face %d" % (4 - fewer))
        assert wrong != data
        path.write_bytes(wrong)
        size = fewer * 13 if what == b"bytes" else fewer
        with pytest.raises(InputError, match=rf"{size} {what.decode()} follow the last row that its header"):
            o3dls.read_surface(path)
        for end in (b"", b"\n", b"\r\n"):  # an end that an editor or a transfer has put there
            path.write_bytes(data + end)
            assert len(o3dls.read_surface(path).faces) == 4


@pytest.mark.parametrize("word", ["\xf6", "f\xd5", "f1", "\x7f"])
def test_a_line_of_obj_that_begins_with_no_word_is_refused(word: str, tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(f"{BODY}{word} 1 4 3\n")
    with pytest.raises(InputError, match=r"line 8 begins with '.*', which is no statement of OBJ"):
        o3dls.read_surface(path)


def test_a_word_that_obj_has_not_is_named_and_what_it_has_is_not(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    body = f"{BODY}f 1 4 3\n"
    path.write_text(f"mtllib a.mtl\n# any words\no la\ng wall\ns off\nusemtl red\n\nvn 0 0 1\n{body}l 1 2\n")
    assert read_surface_file(path).notes == ()
    path.write_text(f"{body}fj 1 2 3\nfj 1 2 4\n")
    assert read_surface_file(path).notes == (
        "lines that begin with 'fj' are left out: OBJ has no such statement",
    )


def test_an_obj_of_vtk_that_ends_within_a_line_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("vtk")
    from benchmarks.speed import whole_files

    path = whole_files(tmp_path)["OBJ"]
    data = path.read_bytes()
    assert o3dls.read_surface(path).watertight
    for cut in (1, 2, 30, 1001):
        assert data[-cut - 1 : -cut] != b"\n"
        path.write_bytes(data[:-cut])
        with pytest.raises(InputError, match=r"the last line has no end|a face needs 3 corners"):
            o3dls.read_surface(path)
