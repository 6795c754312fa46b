"""The tree finds what a plain loop over all faces finds, before and after the surface moved."""

import numpy as np
import pytest

from o3dls.geometry import Surface, outline
from o3dls.levelset.closest import ClosestPoint


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
        weights = np.column_stack([1 - u.ravel() - v.ravel(), u.ravel(), v.ravel()])[(u + v).ravel() <= 1 + 1e-12]
    samples = np.einsum("kc,mcd->mkd", weights, surface.vertices[surface.faces]).reshape(-1, surface.dimension)
    return np.sqrt(((points[:, None] - samples[None]) ** 2).sum(-1).min(axis=1))


@pytest.mark.parametrize("surface", [ring(), blob()], ids=["2D", "3D"])
def test_agrees_with_dense_sampling_also_after_refit(surface: Surface) -> None:
    rng = np.random.default_rng(84213)
    points = rng.normal(size=(12, surface.dimension)) * 2
    moved = surface.with_vertices(surface.vertices[:, ::-1] * 1.7 + 0.3)  # neighbours stay, boxes change wholly
    tree = ClosestPoint(surface.vertices, surface.faces)
    for target in (surface, moved):
        tree.refit(target.vertices)
        squared, face, foot, weights = tree.query(points)
        np.testing.assert_allclose(np.einsum("kc,kcd->kd", weights, target.vertices[target.faces[face]]), foot, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(points - foot, axis=1), np.sqrt(squared), atol=1e-12)
        sampled = brute(points, target)
        assert (np.sqrt(squared) <= sampled + 1e-12).all()
        np.testing.assert_allclose(np.sqrt(squared), sampled, atol=0.02)  # half a sampling step of the coarsest face


def test_bound_and_points_on_the_surface() -> None:
    surface = blob()
    tree = ClosestPoint(surface.vertices, surface.faces)
    assert tree.distance(surface.vertices).max() < 1e-12
    squared, face, _, _ = tree.query(np.array([[50.0, 0.0, 0.0]]), bound=1.0)
    assert np.isinf(squared[0]) and face[0] == -1
