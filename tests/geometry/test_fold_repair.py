"""Folds are mended, and nothing else is: not what turned with its surroundings, however far."""

from typing import Any

import numpy as np
import pytest
from fields import SIZE, body

from o3dls.arrays import Array
from o3dls.geometry import fold_repair as unfold_module
from o3dls.geometry.fold_repair import repair_folds
from o3dls.geometry.surface import Surface


def pushed_through(surface: Surface, at: Array, depth: float, width: float) -> Array:
    """Vertices after a dent at `at` that is narrower than it is deep, so that its sides overlap those around
    it.
    """
    towards = at - surface.vertices
    near = np.exp(-0.5 * (towards**2).sum(axis=1) / width**2)
    return np.asarray(surface.vertices + depth * near[:, None] * towards)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_fold_is_mended_where_it_is_and_counted(dimension: int) -> None:
    surface = body(dimension, fineness=5)
    at = surface.vertices[17]
    # past the middle: the surface there comes out on the other side
    moved = pushed_through(surface, at, 2.2, 0.16 * SIZE)
    mended, count, left = repair_folds(surface.vertices, moved, surface.faces)
    assert left == 0
    before = surface.face_normals
    after = Surface(mended, surface.faces).face_normals
    assert count > 0
    assert (
        (before * Surface(moved, surface.faces).face_normals).sum(axis=1).min()
        < 0.0
        < (before * after).sum(axis=1).min()
    )
    far = np.linalg.norm(surface.vertices - at, axis=1) > SIZE
    np.testing.assert_array_equal(mended[far], moved[far])


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_has_no_fold_comes_back_as_it_was(dimension: int) -> None:
    surface = body(dimension, fineness=4)
    moved = surface.vertices * 1.2 + 3.0
    mended, count, _ = repair_folds(surface.vertices, moved, surface.faces)
    assert count == 0
    np.testing.assert_array_equal(mended, moved)


@pytest.mark.parametrize("enough", [16_000, 500], ids=["all vertices", "an even part"])
def test_a_body_twisted_far_has_no_fold(enough: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Normals at both ends are far from where they were, but so are those of their surroundings."""
    monkeypatch.setattr(unfold_module, "ENOUGH", enough)
    ball = body(3, fineness=5)
    rest = ball.vertices * [0.5, 0.5, 3.0]
    angle = np.deg2rad(100.0) * np.tanh(rest[:, 2] / SIZE)
    x, y, z = rest.T
    moved = np.column_stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y, z])
    cosine = (Surface(rest, ball.faces).face_normals * Surface(moved, ball.faces).face_normals).sum(axis=1)
    assert cosine.min() < -0.1  # by their own normals, many would pass for folded
    mended, count, _ = repair_folds(rest, moved, ball.faces)
    assert count == 0
    np.testing.assert_array_equal(mended, moved)


def test_mending_never_leaves_more_folds_than_there_were() -> None:
    """Slivers: a patch that is smooth over the graph is steep over their short sides, and turns more faces
    than it mends.
    """
    ball = body(3, fineness=5)
    # half of an edge
    rest = ball.vertices + 0.03 * SIZE * np.random.default_rng(8).normal(size=ball.vertices.shape)
    near = np.exp(-0.5 * ((rest - ball.vertices[17]) ** 2).sum(axis=1) / (0.25 * SIZE) ** 2)
    moved = rest + near[:, None] * 0.2 * SIZE * np.array([1.0, -1.0, 0.5])
    mended, count, left = repair_folds(rest, moved, ball.faces)
    assert 0 < left <= count
    assert repair_folds(rest, mended, ball.faces, rounds=0)[1] == left


def test_a_small_piece_that_folded_as_a_whole_stays_and_the_rest_is_mended() -> None:
    """It has no surroundings to continue: its bending alone is singular, so that nothing was mended, or the
    solver gave up in an error.
    """
    ball, crumb = body(3, fineness=5), body(3, fineness=1)
    rest = np.vstack([ball.vertices, 0.05 * crumb.vertices + 3.0 * SIZE])
    faces = np.vstack([ball.faces, crumb.faces + len(ball.vertices)])
    moved = rest.copy()
    moved[: len(ball.vertices)] = pushed_through(ball, ball.vertices[17], 2.2, 0.16 * SIZE)
    small = slice(len(ball.vertices), None)
    moved[small] = moved[small][np.random.default_rng(5).permutation(len(crumb.vertices))]
    mended, count, left = repair_folds(rest, moved, faces)
    assert 0 < left < count
    np.testing.assert_array_equal(mended[small], moved[small])
    assert repair_folds(ball.vertices, mended[: len(ball.vertices)], ball.faces)[1] == 0


def test_a_sliver_of_a_fine_mesh_is_mended_by_a_few_vertices_around_it(
    sizes: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A patch as wide as folds of the wall took seconds for it, and folded others."""
    monkeypatch.setattr(unfold_module, "ENOUGH", 500)
    ball = body(3, fineness=5)
    vertex = 17
    moved = ball.vertices.copy()
    neighbour = ball.faces[(ball.faces == vertex).any(axis=1)].max()
    moved[vertex] += 1.5 * (moved[neighbour] - moved[vertex])
    _, count, left = repair_folds(ball.vertices, moved, ball.faces)
    assert (count > 0, left) == (True, 0)
    assert sizes == [30]  # of 10 242


def test_patches_that_fold_ever_more_faces_are_given_up(
    sizes: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They spread over half of a mesh of slivers, round by round, for two faces that nothing mends."""
    ball = body(3, fineness=4)
    moved = ball.vertices + 0.01 * SIZE * np.random.default_rng(5).normal(size=ball.vertices.shape)
    turned = [np.arange(len(ball.faces)) < folded for folded in (2, 2, 3, 13, 40)]
    monkeypatch.setattr(unfold_module, "_find_turned", lambda rest, moved, faces: turned[len(sizes)])
    mended, count, left = repair_folds(ball.vertices, moved, ball.faces)
    assert (count, left, len(sizes)) == (2, 2, 3)
    np.testing.assert_array_equal(mended, moved)


@pytest.fixture
def sizes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many vertices each round replaces."""
    found = list[int]()
    solver = unfold_module.splu

    def recorded(matrix: Any, **options: Any) -> Any:
        found.append(matrix.shape[0])
        return solver(matrix, **options)

    monkeypatch.setattr(unfold_module, "splu", recorded)
    return found


@pytest.mark.parametrize("strength", [0.02, 0.05, 0.1, 0.3])
def test_what_a_repair_solves_is_bounded_whatever_has_folded(strength: float, sizes: list[int]) -> None:
    """Priors of label volumes under another's heart took 39 systems, of up to all vertices: a minute."""
    ball = body(3, fineness=5)
    noise = strength * SIZE * np.random.default_rng(5).normal(size=ball.vertices.shape)
    north = ball.vertices[:, 2:] > np.quantile(ball.vertices[:, 2], 0.85)
    for moved in (ball.vertices + noise, ball.vertices + north * noise):
        sizes.clear()
        mended, count, left = repair_folds(ball.vertices, moved, ball.faces)
        assert len(sizes) <= unfold_module.ROUNDS
        assert max(sizes, default=0) <= unfold_module.MOST_BENT * len(ball.vertices)
        assert left <= count
        still = unfold_module._Still.of(ball.vertices, ball.faces)
        assert unfold_module._find_turned(still, mended, ball.faces).sum() == left


def test_a_sliver_is_straightened_and_nothing_else_moves(sizes: list[int]) -> None:
    """Three corners in line, as decimated label volumes have them: the least bend turns such a face over, and
    no patch turned it back.
    """
    ball = body(3, fineness=4)
    a, b, c = ball.faces[100]
    along, inwards = ball.vertices[b] - ball.vertices[a], ball.vertices[c] - ball.vertices[a]
    rest = np.vstack([ball.vertices, ball.vertices[a] + 0.4 * along + 1e-3 * inwards])
    m = len(rest) - 1
    faces = np.vstack([np.delete(ball.faces, 100, axis=0), [[a, m, c], [m, b, c], [a, b, m]]])
    moved = rest * [1.1, 1.0, 0.9] + [5.0, 0.0, 0.0]
    moved[m] -= 3e-3 * inwards
    mended, count, left = repair_folds(rest, moved, faces)
    assert (count, left, sizes) == (1, 0, [])
    np.testing.assert_allclose(mended[:m], moved[:m], atol=1e-12)
    assert np.linalg.norm(mended[m] - moved[m]) < 4e-3 * np.linalg.norm(inwards)
    assert Surface(mended, faces).face_normals[-1] @ Surface(rest, faces).face_normals[-1] > 0.9
