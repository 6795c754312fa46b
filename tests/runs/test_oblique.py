"""One oblique, anisotropic chamber through every exporter and reader and back, in LPS and RAS, on the map and
on the image.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from o3dls.arrays import Array
from o3dls.geometry.similarity import apply
from o3dls.io.images.labels import read as read_labels
from o3dls.io.images.registry import read_image
from o3dls.io.points import read_points
from o3dls.io.surfaces import read_surface_file
from o3dls.io.transforms import read_transform
from o3dls.runs.export.finished import export_run
from o3dls.runs.export.formats import BETWEEN, file_name
from tests.oblique_motion import (
    AFFINE,
    Smooth,
    chamber,
    image,
    oblique_case,
    oblique_run,
    turn_of,
    write_image,
)

SURFACES = ("ply", "stl", "obj", "off", "vtk", "vtp", "carto_mesh", "openep", "opencarp", "carto_vtk", "dif")
VOLUMES = ("phi_nrrd", "phi_nifti", "mask_nrrd", "mask_nifti")
ROUNDED = 1e-3  # mm: digits of the text formats, and float32
SIDES = tuple(product(("map", "prior"), ("LPS", "RAS")))
VOXEL = 1.2  # mm: of a mask's centre of mass


def on_side(side: str) -> Array:
    """Where the wall is, in LPS: on the image, or on the map."""
    wall = chamber().vertices
    return wall if side == "prior" else Smooth("LPS", "LPS")(wall)


@pytest.fixture(scope="module", params=["LPS", "RAS"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The prior in one frame, the map in the other."""
    other = "RAS" if request.param == "LPS" else "LPS"
    return oblique_run(request.param, other).write(tmp_path_factory.mktemp("oblique") / "run")


@pytest.mark.parametrize(("side", "frame"), SIDES)
def test_every_surface_comes_back(run: Path, side: str, frame: str, tmp_path: Path) -> None:
    for name in SURFACES:
        frame_of_file = "LPS" if name == "dif" else frame
        path = tmp_path / file_name("a", name)
        export_run(run, path, format=name, on=side, frame=None if name == "dif" else frame)
        found = read_surface_file(path, units="um" if name == "opencarp" else None)
        xyz = found.surface.vertices * (0.001 if name == "opencarp" and found.units == "um" else 1.0)
        back = apply(turn_of(frame_of_file), xyz)
        wall = on_side(side)
        # a soup's corners come in another order
        for some, others in ((back, wall), (wall, back)):
            assert cKDTree(others).query(some)[0].max() < ROUNDED, name
        assert found.space in (frame_of_file, "unknown"), name


@pytest.mark.parametrize(("side", "frame"), SIDES)
def test_every_volume_comes_back(run: Path, side: str, frame: str, tmp_path: Path) -> None:
    wall = chamber().with_vertices(on_side(side))
    middle = (wall.vertices * wall.vertex_areas[:, None]).sum(axis=0) / wall.vertex_areas.sum()
    for name in VOLUMES:
        path = export_run(
            run, tmp_path / file_name("a", name), format=name, on=side, frame=frame, spacing=1.5
        )
        found = read_image(path, path.read_bytes())
        affine = turn_of(found.space) @ found.affine
        near = np.abs(found.values) < 1.0 if name.startswith("phi") else found.values > 0
        places = apply(affine, np.argwhere(near)[:, ::-1])
        np.testing.assert_allclose(
            places.min(axis=0), wall.vertices.min(axis=0), atol=2 * VOXEL, err_msg=name
        )
        np.testing.assert_allclose(
            places.max(axis=0), wall.vertices.max(axis=0), atol=2 * VOXEL, err_msg=name
        )
        if name.startswith("phi"):
            np.testing.assert_allclose(places.mean(axis=0), middle, atol=VOXEL, err_msg=name)


@pytest.mark.parametrize("frame", ["LPS", "RAS"])
def test_points_and_poses_come_back(run: Path, frame: str, tmp_path: Path) -> None:
    path = export_run(run, tmp_path / "a.csv", format="csv", frame=frame)
    measured = apply(turn_of(frame), read_points(path, 3).xyz)
    np.testing.assert_allclose(measured, oblique_case().points.xyz, atol=1e-9)
    wall = chamber().vertices
    for name in ("tfm", "txt"):
        matrix, space = read_transform(
            export_run(run, tmp_path / f"a.{name}", format=name, on="map", frame=frame)
        )
        moved = apply(turn_of(space) @ matrix @ turn_of(space), wall)
        assert np.linalg.norm(moved - on_side("map"), axis=1).mean() < 1.5, name  # what the motion adds
    assert BETWEEN  # those formats are in tests/runs/test_motion_files.py and test_scene.py


@pytest.mark.parametrize(("suffix", "space"), [("nii.gz", "LPS"), ("nrrd", "LPS"), ("nrrd", "RAS")])
def test_the_image_comes_back(suffix: str, space: str, tmp_path: Path) -> None:
    path = write_image(tmp_path / f"a.{suffix}", space)
    found = read_image(path, path.read_bytes())
    np.testing.assert_allclose(turn_of(found.space) @ found.affine, AFFINE, atol=1e-4)
    np.testing.assert_array_equal(found.values.transpose(2, 1, 0), image())
    surface = read_labels(path, path.read_bytes(), label=2).surface
    distance = chamber().closest_point.distance(surface.vertices)
    cut = np.abs((surface.vertices - AFFINE[:3, 3]) @ AFFINE[:3, 0] / 0.9**2 - 50.5) < 1.5
    assert np.percentile(distance[~cut], 95) < 1.5  # voxels of 2.4 mm
