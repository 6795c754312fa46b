"""Normals and curvature of surfaces that are known: circle, sphere, plane, and the geometry module's own
normals.
"""

import numpy as np
import pytest
from fields import body
from shapes import meshed, round_distance

from o3dls.arrays import Array
from o3dls.geometry.differential import evened, normals_and_curvature, stretches, unit_mean, vertex_normals
from o3dls.geometry.similarity import apply, similarity
from o3dls.geometry.surface import Surface, outline

NO_LIMIT = 1e9


def circle(n: int, radius: float) -> Surface:
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return outline(radius * np.column_stack([np.cos(t), np.sin(t)]))


def ball(subdivisions: int, radius: float) -> Surface:
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return Surface(mesh.vertices, mesh.faces)


@pytest.mark.parametrize(
    ("surface", "expected"), [(circle(200, 7.0), 1 / 7), (ball(4, 7.0), 2 / 7)], ids=["circle", "sphere"]
)
def test_sum_of_curvatures_of_round_bodies(surface: Surface, expected: float) -> None:
    normals, curvature = normals_and_curvature(surface.vertices, surface.faces, NO_LIMIT)
    np.testing.assert_allclose(curvature, expected, rtol=0.02)
    np.testing.assert_allclose(normals, surface.vertices / 7.0, atol=0.01)
    _, inward = normals_and_curvature(surface.vertices, surface.faces[:, ::-1], NO_LIMIT)
    np.testing.assert_allclose(inward, -curvature, rtol=1e-9)


def test_curvature_that_changes_along_the_way() -> None:
    t = np.linspace(0, 2 * np.pi, 800, endpoint=False)
    ellipse = outline(np.column_stack([3.0 * np.cos(t), np.sin(t)]))
    expected = 3.0 / (9.0 * np.sin(t) ** 2 + np.cos(t) ** 2) ** 1.5
    np.testing.assert_allclose(normals_and_curvature(*_parts(ellipse), NO_LIMIT)[1], expected, rtol=0.02)


def test_a_plane_is_flat_and_the_limit_holds() -> None:
    x, y = np.meshgrid(np.arange(8.0), np.arange(8.0), indexing="ij")
    k = np.arange(64).reshape(8, 8)
    faces = np.vstack(
        [
            np.column_stack([k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[1:, 1:].ravel()]),
            np.column_stack([k[:-1, :-1].ravel(), k[1:, 1:].ravel(), k[:-1, 1:].ravel()]),
        ]
    )
    plane = np.column_stack([x.ravel(), y.ravel(), np.zeros(64)])
    normals, curvature = normals_and_curvature(plane, faces, NO_LIMIT)
    np.testing.assert_allclose(normals, np.tile([0.0, 0.0, 1.0], (64, 1)), atol=1e-12)
    np.testing.assert_allclose(curvature, 0.0, atol=1e-12)
    assert np.abs(normals_and_curvature(*_parts(ball(2, 0.1)), 3.0)[1]).max() <= 3.0


@pytest.mark.parametrize("dimension", [2, 3])
def test_normals_are_those_of_the_geometry_and_curvature_scales(dimension: int) -> None:
    surface = body(dimension)
    np.testing.assert_allclose(
        vertex_normals(surface.vertices, surface.faces), surface.vertex_normals, atol=1e-12
    )
    turn = np.linalg.qr(np.random.default_rng(4_421).normal(size=(dimension, dimension)))[0]
    turn[:, 0] *= np.linalg.det(turn)
    moved = apply(similarity(turn, np.arange(dimension) + 1.0, 3.0), surface.vertices)
    normals, curvature = normals_and_curvature(surface.vertices, surface.faces, NO_LIMIT)
    turned, flatter = normals_and_curvature(moved, surface.faces, NO_LIMIT)
    np.testing.assert_allclose(turned, normals @ turn.T, atol=1e-9)
    np.testing.assert_allclose(flatter, curvature / 3.0, rtol=1e-6, atol=1e-9)


def test_unit_mean_interpolates_and_has_length_one() -> None:
    vectors = np.eye(3)
    corner = np.array([[0, 1, 2], [0, 1, 2]])
    bary = np.array([[1.0, 0, 0], [0.5, 0.5, 0]])
    np.testing.assert_allclose(unit_mean(vectors, corner, bary), [[1, 0, 0], [0.5**0.5, 0.5**0.5, 0]])


def _parts(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    return surface.vertices, surface.faces


def test_slivers_of_a_lattice_become_triangles_on_the_same_surface() -> None:
    sphere = meshed(round_distance(8.3), 10.0)

    def shortest(vertices: Array) -> float:
        corners = vertices[sphere.faces]
        return float(np.quantile(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2), 0.02))

    even = evened(sphere.vertices, sphere.faces)
    assert shortest(even) > 2.0 * shortest(sphere.vertices)
    # chords of edges of 1 mm lie 0.02 inside: a few times that
    assert np.abs(np.linalg.norm(even, axis=1) - 8.3).max() < 0.1


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_stretch_is_the_largest_in_any_direction_whatever_turn_goes_with_it(dimension: int) -> None:
    surface = body(dimension)
    longer = np.diag(np.array([1.0, 3.0, 0.5])[:dimension])
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(dimension, dimension)))[0]
    found = stretches(surface.vertices, surface.vertices @ longer @ turn, surface.faces)
    assert found.max() == pytest.approx(3.0, rel=0.01)
    assert found.min() >= (1.0 - 1e-9 if dimension == 2 else 0.5)
    edges = surface.vertices[surface.faces[:, 1]] - surface.vertices[surface.faces[:, 0]]
    assert (found >= np.linalg.norm(edges @ longer, axis=1) / np.linalg.norm(edges, axis=1) - 1e-9).all()
    np.testing.assert_allclose(stretches(surface.vertices, 2.0 * surface.vertices @ turn, surface.faces), 2.0)


def test_a_face_whose_corners_are_in_line_stretches_by_what_its_edges_do() -> None:
    rest = np.array([[0.0, 0.0, 0.0], [1.0, 0.3, 0.1], [2.0, 0.6, 0.2]])
    face = np.array([[0, 1, 2]])
    with np.errstate(all="raise"):
        assert stretches(rest, 1.5 * rest, face)[0] == pytest.approx(1.5, rel=1e-3)
