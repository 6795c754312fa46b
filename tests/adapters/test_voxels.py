"""The signed distance of a mesh near its wall and on voxels: as in closed form, whoever holds the mesh."""

from __future__ import annotations

import doctest

import numpy as np
import pytest
from shapes import circle, round_distance, torus, torus_distance

import o3dls
from o3dls.adapters import voxels
from o3dls.errors import InputError
from o3dls.geometry.surface import Surface

FACETS = 0.02  # mm, of a mesh from its smooth shape
COUNTED = 0.02  # of a volume by its voxels, a sixth of the tube's radius each
SHAPES = [(circle(), round_distance()), (torus(around=384, across=192), torus_distance())]


def centres(found: o3dls.Voxels) -> np.ndarray:
    index = np.indices(found.phi.shape).reshape(found.phi.ndim, -1).T
    return index @ found.affine[:-1, :-1].T + found.affine[:-1, -1]


@pytest.mark.parametrize(("surface", "distance"), SHAPES, ids=["2D", "3D"])
def test_near_the_wall_the_distance_is_that_of_the_shape(surface: Surface, distance) -> None:
    near = o3dls.signed_distance(surface, 0.8, width=2.0)
    np.testing.assert_allclose(near.phi, distance(near.band.positions), atol=FACETS)
    assert np.abs(near.phi).max() <= 2.0 + FACETS
    assert np.abs(o3dls.signed_distance(surface, 0.8).phi).max() == pytest.approx(2.4, abs=0.1)


@pytest.mark.parametrize(("surface", "distance"), SHAPES, ids=["2D", "3D"])
def test_voxels_hold_the_distance_up_to_the_margin(surface: Surface, distance) -> None:
    found = o3dls.voxelise(surface, 0.8, margin=3)
    wanted = np.minimum(distance(centres(found)), 2.4)
    np.testing.assert_allclose(found.phi.ravel(), wanted, atol=FACETS)
    assert (found.inside == (found.phi < 0.0)).all()
    volume = found.inside.sum() * found.spacing**surface.dimension
    assert volume == pytest.approx(surface.volume, rel=COUNTED)


def test_a_mesh_of_another_library_has_the_same_voxels() -> None:
    surface = torus()
    mine = o3dls.voxelise(surface, 1.0)
    for other in (
        o3dls.to(surface, "trimesh"),
        o3dls.to(surface, "open3d"),
        (surface.vertices, surface.faces),
    ):
        np.testing.assert_allclose(o3dls.voxelise(other, 1.0).phi, mine.phi, atol=1e-4)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"spacing": -1.0}, "spacing = -1: must be above 0"),
        ({"spacing": float("nan")}, "spacing = nan: must be above 0"),
        ({"spacing": 20.0}, "a spacing between"),
        ({"spacing": 0.01}, "a spacing between"),
        ({"spacing": 1.0, "width": 0.5}, "width = 0.5: must be between spacing = 1 and"),
        ({"spacing": 1.0, "width": 1000.0}, "width = 1000: must be between"),
        ({"spacing": 1.0, "margin": 0}, "margin = 0 voxels: must be 1 or more"),
    ],
)
def test_what_cannot_be_is_refused_with_what_would_be_right(given: dict[str, float], sentence: str) -> None:
    ask = o3dls.signed_distance if "width" in given else o3dls.voxelise
    with pytest.raises(InputError, match=sentence):
        ask(torus(), **given)


@pytest.mark.parametrize("ask", [o3dls.signed_distance, o3dls.voxelise])
def test_an_open_surface_has_no_inside(ask) -> None:
    whole = torus()
    with pytest.raises(InputError, match="the surface is open"):
        ask(Surface(whole.vertices, whole.faces[:-40]), 1.0)


def test_the_examples_run() -> None:
    assert doctest.testmod(voxels).attempted > 5
    assert doctest.testmod(voxels).failed == 0
