"""Tags of a study's points: known names are landmarks, ablation is ablation, and what is not on the wall is
no point of the wall, whichever system wrote them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
from formats import car_file
from said import said_by

import o3dls
from o3dls.case import Points
from o3dls.errors import InputError
from o3dls.geometry.surface import Surface
from o3dls.io.mapping.study import read_study
from o3dls.io.matlab import openep
from o3dls.io.matlab.openep_points import electric_of
from o3dls.io.meshes.carto import mesh_file
from o3dls.io.meshes.surface_file import SurfaceFile

RADIUS = 20.0
TABLE = {
    9: ("ABL", "Ablation"),
    13: ("EOS", "End of Sheath"),
    14: ("SIA", "Short Interval Ablation"),
    11: ("LO", "Location Only"),
    10: ("SCR", "Scar"),
    101: ("LSPV", "LSPV"),
    4: ("None", "None"),
    77: ("abl7", "Ablation"),  # renamed by a lab
}


def ball() -> Surface:
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh.create_sphere(RADIUS, 16)
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.triangles))


def points(n: int = 40) -> Points:
    """Points on the wall, but for the last three: in the middle, far outside, and 2 mm inside the wall."""
    ways = np.random.default_rng(31_337).normal(size=(n, 3))
    xyz = RADIUS * ways / np.linalg.norm(ways, axis=1)[:, None]
    xyz[-3:] = [[1, 2, 0], [60, 0, 0], [0, RADIUS - 2, 0]]
    columns = dict.fromkeys(("bipolar", "unipolar", "impedance"), np.ones(n)) | {"lat": np.zeros(n)}
    return Points(np.round(xyz, 3), np.full(n, "eam"), columns)


def carto(folder: Path, tags: dict[int, Sequence[int]], *, shell: bool = True) -> Path:
    """A study of one map; tags by row."""
    folder.mkdir()
    table = "".join(
        f"<Tag ID='{k}' Short_Name={quoteattr(short)} Full_Name={quoteattr(full)} />"
        for k, (short, full) in TABLE.items()
    )
    rows = "".join(
        f"<Point Id='{row + 1}'>"
        + (f"<Tags Count='{len(tags[row])}'>{' '.join(map(str, tags[row]))}</Tags>" if row in tags else "")
        + "</Point>"
        for row in range(len(points()))
    )
    files = "1-LA.mesh" if shell else ""
    (folder / "Study.xml").write_text(
        f"<Study name='S'><Maps><TagsTable>{table}</TagsTable><Map Name='1-LA' FileNames='{files}'>"
        f"<CartoPoints>{rows}</CartoPoints></Map></Maps></Study>"
    )
    (folder / "1-LA_car.txt").write_bytes(car_file("1-LA", points()))
    if shell:
        (folder / "1-LA.mesh").write_bytes(mesh_file.write(SurfaceFile(ball())))
    return folder


def openep_of(path: Path, tags: dict[int, Sequence[int]], *, shell: bool = True) -> Path:
    """The same as a data set of OpenEP: a cell of text for each point, or of cells of text."""
    measured = points()
    electric = electric_of(measured)
    cells = np.full((len(measured), 1), "", dtype=object)
    for row, ids in tags.items():
        names = [TABLE[k][1] for k in ids]
        if len(names) == 1:
            cells[row, 0] = names[0]
        else:
            cells[row, 0] = np.array(names, dtype=object).reshape(1, -1)
    electric["tags"] = cells
    surface = {"triRep": {"X": ball().vertices, "Triangulation": ball().faces + 1.0}} if shell else {}
    path.write_bytes(openep.save({"electric": electric, "surface": surface}))
    return path


def study(system: str, folder: Path, tags: dict[int, Sequence[int]], *, shell: bool = True) -> Path:
    if system == "carto":
        return carto(folder / "study", tags, shell=shell)
    return openep_of(folder / "study.mat", tags, shell=shell)


@pytest.mark.parametrize("system", ["carto", "openep"])
def test_each_tag_is_what_it_means(system: str, tmp_path: Path) -> None:
    tags = {0: [9], 1: [14], 2: [9, 101], 3: [101], 4: [10], 5: [77], 6: [4], 37: [13], 38: [13], 39: [11]}
    path = study(system, tmp_path, tags)
    found = read_study(path)
    assert list(found.landmarks) == ["LSPV"]
    np.testing.assert_allclose(found.landmarks["LSPV"], points().xyz[[2, 3]].mean(axis=0), atol=1e-3)
    kinds = found.points.type
    assert (kinds == "ablation").sum() == 4
    np.testing.assert_allclose(found.points.of("inside").xyz, points().xyz[[37]], atol=1e-3)
    assert (kinds == "eam").sum() == len(points()) - 6  # one end of a sheath is left out
    assert "Scar" in str(found.points.columns["tags"]) or "SCR" in str(found.points.columns["tags"])
    code, said = said_by("import", path, tmp_path / "case")
    assert code == 0, said
    assert "took 1 points tagged" in said
    assert "left 1 points tagged" in said
    assert "took landmark LSPV" in said
    table = o3dls.read_points(tmp_path / "case" / "points.csv")
    assert (table.type == "landmark").sum() == 1
    assert (table.type == "ablation").sum() == 4


@pytest.mark.parametrize("system", ["carto", "openep"])
def test_a_location_deep_inside_is_inside_and_one_at_the_wall_is_not(system: str, tmp_path: Path) -> None:
    found = read_study(study(system, tmp_path, {37: [11], 39: [11]}))
    np.testing.assert_allclose(found.points.of("inside").xyz, points().xyz[[37]], atol=1e-3)
    assert len(found.points) == len(points())


@pytest.mark.parametrize("system", ["carto", "openep"])
def test_without_a_shell_the_end_of_a_sheath_is_left_out_and_a_location_stays(
    system: str, tmp_path: Path
) -> None:
    found = read_study(study(system, tmp_path, {37: [13], 39: [11]}, shell=False))
    assert (found.points.type == "eam").all()
    assert len(found.points) == len(points()) - 1
    assert any("no shell says that they are inside" in line for line in found.left)


@pytest.mark.parametrize("system", ["carto", "openep"])
def test_points_without_tags_have_no_such_column(system: str, tmp_path: Path) -> None:
    found = read_study(study(system, tmp_path, {}))
    assert "tags" not in found.points.columns
    assert not found.landmarks


def test_tags_that_are_not_one_for_each_point_are_refused(tmp_path: Path) -> None:
    electric = electric_of(points()) | {"tags": np.array(["LSPV", "LIPV"], dtype=object)}
    (tmp_path / "a.mat").write_bytes(openep.save({"electric": electric}))
    with pytest.raises(InputError, match=r"electric\.tags has 2 rows: must be 40, one for each position"):
        read_study(tmp_path / "a.mat")
