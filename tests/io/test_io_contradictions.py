"""Two statements of one file, or of a file and an option, that contradict: none is taken without a word."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from tiny import ball_case

import o3dls
from o3dls.errors import InputError
from o3dls.io.meshes.carto import mesh_file
from o3dls.io.meshes.surface_file import SurfaceFile
from o3dls.io.surfaces import write_surface

BODY = np.zeros((12, 13, 14), np.uint8)
BODY[3:8, 4:9, 5:9] = 1


def nrrd(path: Path, spacings: str) -> Path:
    head = (
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 14 13 12\nspace: LPS\nencoding: raw\n"
        "space directions: (1,0,0) (0,1,0) (0,0,2)\nspace origin: (0,0,0)\n"
    )
    path.write_bytes((head + spacings + "\n").encode() + BODY.tobytes())
    return path


@pytest.mark.parametrize("spacings", ["spacings: 1 1 1\n", "spacings: 2 1 1\n"])
def test_spacings_beside_directions_must_agree(spacings: str, tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"'spacings: .*' and the lengths of 'space directions'.* contradict"
    ):
        o3dls.read_surface(nrrd(tmp_path / "a.nrrd", spacings))
    for right in ("", "spacings: 1 1 2\n", "spacings: 1 1.001 2\n"):
        assert o3dls.read_surface(nrrd(tmp_path / "b.nrrd", right)).watertight


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("Offset = 1 2 3", "Position = 1 2 4"),
        ("Offset = 1 2 3", "Origin = 0 0 0"),
        ("ElementSpacing = 1 1 2", "ElementSize = 1 1 1"),
        ("TransformMatrix = 1 0 0 0 1 0 0 0 1", "Rotation = -1 0 0 0 1 0 0 0 1"),
    ],
)
def test_two_names_of_one_key_must_agree(one: str, other: str, tmp_path: Path) -> None:
    head = "ObjectType = Image\nNDims = 3\nDimSize = 14 13 12\nElementType = MET_UCHAR\n"
    for extra, fault in ((f"{one}\n{other}\n", True), (f"{one}\n", False), (f"{other}\n", False)):
        data = f"{head}{extra}ElementDataFile = LOCAL\n".encode() + BODY.tobytes()
        (tmp_path / "a.mha").write_bytes(data)
        if fault:
            with pytest.raises(
                InputError, match=rf"{one.split()[0]} = .* and {other.split()[0]} = .* contradict"
            ):
                o3dls.read_surface(tmp_path / "a.mha")
        else:
            assert o3dls.read_surface(tmp_path / "a.mha").watertight


@pytest.mark.parametrize("key", ["NumVertex", "NumTriangle", "NumVertexColors"])
@pytest.mark.parametrize("more", [-1, 1])
def test_counts_of_a_carto_mesh_are_those_of_its_rows(key: str, more: int, tmp_path: Path) -> None:
    """A count of 0 colours had them dropped without a word."""
    ball = ball_case().prior
    surface = o3dls.Surface(ball.vertices, ball.faces, {"bipolar": np.ones(len(ball.vertices))})
    data = mesh_file.write(SurfaceFile(surface))
    count = re.compile(rf"({key}\s*=\s*)(\d+)".encode())
    wrong = count.sub(lambda found: found[1] + str(int(found[2]) + more).encode(), data, count=1)
    assert wrong != data
    (tmp_path / "a.mesh").write_bytes(wrong)
    with pytest.raises(InputError, match=r"are declared|but ColorsNames has|must be a count"):
        o3dls.read_surface(tmp_path / "a.mesh")


def test_units_of_a_case_that_differ_from_those_of_a_file_are_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    case = ball_case(points=40)
    write_surface(tmp_path / "prior.ply", case.prior, units="mm")
    rows = "".join(f"{x},{y},{z}\n" for x, y, z in case.points.of("eam").xyz)
    (tmp_path / "points.csv").write_text("# units=mm\nx,y,z\n" + rows)
    caplog.set_level("INFO", "o3dls")
    found = o3dls.read_case(tmp_path, units="cm")
    np.testing.assert_allclose(found.prior.vertices, case.prior.vertices, atol=1e-5)
    for name in ("prior.ply", "points.csv"):
        assert f"{name}: states units mm, which are taken; cm is for files that state none" in caplog.text
