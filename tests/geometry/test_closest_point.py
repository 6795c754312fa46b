"""The tree finds what a plain loop over all faces finds, before and after the surface moved."""

import numpy as np
import pytest

from o3dls.geometry.closest_point import ClosestPoint
from o3dls.geometry.surface import Surface, outline


def ring(n: int = 57) -> Surface:
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return outline(np.column_stack([np.cos(t) * 3, np.sin(t)]))


def blob() -> Surface:
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=3, radius=2.0)
    return Surface(mesh.vertices * [1.0, 2.0, 0.5], mesh.faces)


def brute(points: np.ndarray, surface: Surface) -> np.ndarray:
    """Distance by dense sampling of each face: an independent upper bound that converges from above."""
    steps = np.linspace(0, 1, 60)
    if surface.dimension == 2:
        weights = np.column_stack([1 - steps, steps])
    else:
        u, v = np.meshgrid(steps, steps)
        weights = np.column_stack([1 - u.ravel() - v.ravel(), u.ravel(), v.ravel()])[
            (u + v).ravel() <= 1 + 1e-12
        ]
    samples = np.einsum("kc,mcd->mkd", weights, surface.vertices[surface.faces]).reshape(
        -1, surface.dimension
    )
    return np.sqrt(((points[:, None] - samples[None]) ** 2).sum(-1).min(axis=1))


@pytest.mark.parametrize("surface", [ring(), blob()], ids=["2D", "3D"])
def test_agrees_with_dense_sampling_also_where_it_moved(surface: Surface) -> None:
    rng = np.random.default_rng(84213)
    points = rng.normal(size=(12, surface.dimension)) * 2
    # neighbours stay, boxes change wholly
    moved = surface.with_vertices(surface.vertices[:, ::-1] * 1.7 + 0.3)
    at_rest = ClosestPoint(surface.vertices, surface.faces)
    # which has stayed where it was
    for target, tree in (
        (moved, at_rest.at(moved.vertices)),
        (surface, at_rest),
    ):
        squared, face, foot, weights = tree.query(points)
        np.testing.assert_allclose(
            np.einsum("kc,kcd->kd", weights, target.vertices[target.faces[face]]), foot, atol=1e-12
        )
        np.testing.assert_allclose(np.linalg.norm(points - foot, axis=1), np.sqrt(squared), atol=1e-12)
        sampled = brute(points, target)
        assert (np.sqrt(squared) <= sampled + 1e-12).all()
        # half a sampling step of the coarsest face
        np.testing.assert_allclose(np.sqrt(squared), sampled, atol=0.02)


def test_bound_and_points_on_the_surface() -> None:
    surface = blob()
    tree = ClosestPoint(surface.vertices, surface.faces)
    assert tree.distance(surface.vertices).max() < 1e-12
    squared, face, _, _ = tree.query(np.array([[50.0, 0.0, 0.0]]), bound=1.0)
    assert np.isinf(squared[0])
    assert face[0] == -1


@pytest.mark.parametrize("surface", [ring(), blob()], ids=["2D", "3D"])
def test_a_hint_changes_the_time_and_not_the_answer(surface: Surface) -> None:
    rng = np.random.default_rng(51907)
    points = rng.normal(size=(40, surface.dimension)) * 2
    tree = ClosestPoint(surface.vertices, surface.faces)
    squared, _, foot, _ = tree.query(points)
    hinted = tree.query(points, hint=rng.integers(len(surface.faces), size=40))
    np.testing.assert_array_equal(hinted[0], squared)
    np.testing.assert_allclose(hinted[2], foot, atol=1e-12)


def test_a_triangle_without_area_is_a_segment_or_a_point() -> None:
    vertices = np.array([[0.0, 0, 0], [2, 0, 0], [2, 0, 0], [1, 0, 0]])
    for faces in ([[0, 1, 2]], [[1, 2, 0]], [[2, 0, 1]], [[0, 1, 3]], [[0, 3, 1]], [[3, 0, 1]]):
        squared, _, foot, _ = ClosestPoint(vertices, np.array(faces)).query(
            np.array([[1.5, 1.0, 0.0], [-3.0, 0.0, 4.0]])
        )
        np.testing.assert_allclose(squared, [1.0, 25.0], atol=1e-12)
        np.testing.assert_allclose(foot, [[1.5, 0, 0], [0, 0, 0]], atol=1e-12)
    squared = ClosestPoint(vertices, np.array([[1, 2, 1]])).query(np.array([[2.0, 3.0, 0.0]]))[0]
    np.testing.assert_allclose(squared, 9.0)
