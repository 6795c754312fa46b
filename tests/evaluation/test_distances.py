"""Scores: exact distances, sets that never mix, summaries that are what they are called."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tiny import SHIFT, ball_case, disc_case, sphere

from o3dls.arrays import Array, Ints
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import (
    dice,
    distances,
    measure,
    occupancy,
    sample,
    scored_as_fitted,
    summary,
    truth_scores,
)
from o3dls.evaluation.projection import project
from o3dls.geometry.closest_point import ClosestPoint
from o3dls.geometry.similarity import similarity
from o3dls.geometry.surface import Surface, outline

SEED = 440_179
COUNTING = 0.01  # Dice counts cells: one in a hundred along the longest side


def cube(side: float = 2.0) -> Surface:
    """A cube about the origin, wound outward."""
    corner = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * side / 2
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Surface(corner, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]))


def placed(case, T=None):  # type: ignore[no-untyped-def]
    T = np.eye(case.dimension + 1) if T is None else T
    return Estimate(case.prior.transformed(T), T, "placed")


def test_distances_to_a_cube_are_those_of_its_formula() -> None:
    points = np.random.default_rng(SEED).uniform(-3, 3, (400, 3))
    outside = np.linalg.norm(np.maximum(np.abs(points) - 1.0, 0.0), axis=1)
    inside = np.minimum(1.0 - np.abs(points).max(axis=1), np.inf)
    np.testing.assert_allclose(distances(points, cube()), np.where(outside > 0, outside, inside), atol=1e-12)


def test_samples_lie_on_the_surface_spread_by_area_and_repeat() -> None:
    box = Surface(cube().vertices * [1.0, 1.0, 5.0], cube().faces)
    points = sample(box, 4000)
    assert distances(points, box).max() < 1e-12
    on_ends = np.isclose(np.abs(points[:, 2]), 5.0).mean()
    assert on_ends == pytest.approx(8.0 / 88.0, abs=0.015)  # three standard errors
    np.testing.assert_array_equal(points, sample(box, 4000))


def test_a_summary_is_what_its_keys_say() -> None:
    values = np.array([0.0, 1.0, 2.0, 5.0])
    expected = {"n": 4, "mean_px": 2.0, "median_px": 1.5, "rms_px": 7.5**0.5, "p95_px": 4.55, "max_px": 5.0}
    assert summary(values, "px") == pytest.approx(expected)


def test_each_set_holds_what_its_name_says() -> None:
    case = ball_case()
    sets = measure(case, placed(case), ("eam", "inside"))
    counts = {name: len(values) for name, values in sets.items()}
    assert counts["fitted"] == 60
    assert counts["ablation"] == 10
    assert counts["landmarks"] == 3
    assert (counts["held_out"], counts["held_out_unseen"], counts["held_out_seen"]) == (20, 5, 15)
    np.testing.assert_allclose(sets["landmarks"], np.linalg.norm(SHIFT))
    np.testing.assert_allclose(sets["correspondence"], np.linalg.norm(SHIFT))


def test_ablation_points_that_were_fitted_count_as_fitted() -> None:
    case = ball_case()
    sets = measure(case, placed(case), ("ablation", "eam"))
    assert "ablation" not in sets
    assert len(sets["fitted"]) == 70
    assert scored_as_fitted(("eam", "inside")) == ("eam",)


def test_the_motion_carries_what_belongs_to_the_prior() -> None:
    class Rise:
        def __call__(self, points):  # type: ignore[no-untyped-def]
            return points + SHIFT

    case = ball_case()
    sets = measure(case, replace(placed(case), motion=Rise()), ("eam",))
    np.testing.assert_allclose(sets["landmarks"], 0.0, atol=1e-12)
    np.testing.assert_allclose(sets["correspondence"], 0.0, atol=1e-12)


def test_a_perfect_estimate_scores_perfectly() -> None:
    case = ball_case()
    perfect = placed(case, similarity(np.eye(3), SHIFT))
    found = truth_scores(measure(case, perfect, ("eam",)), perfect.surface, case.truth.surface, "mm")  # type: ignore[union-attr, arg-type]
    assert found["assd_mm"] < 1e-12
    assert found["hd95_mm"] < 1e-12
    assert found["dice"] == 1.0
    assert found["within_1mm"] == found["within_3mm"] == 1.0


def test_truth_scores_take_the_larger_direction_and_no_dice_of_an_open_truth() -> None:
    case = ball_case()
    half = Surface(
        case.prior.vertices, case.prior.faces[case.prior.vertices[case.prior.faces].mean(axis=1)[:, 2] > 0]
    )
    case = replace(case, truth=replace(case.truth, surface=half))  # type: ignore[type-var]
    sets = measure(case, placed(case), ("eam",))
    found = truth_scores(sets, case.prior, half, "mm")
    assert found["dice"] is None
    assert found["hd95_mm"] == pytest.approx(np.percentile(sets["surface_to_truth"], 95))
    assert found["assd_mm"] == pytest.approx(sets["surface_to_truth"].mean() / 2, rel=1e-6)


@pytest.mark.parametrize("shift", [0.0, 0.5, 1.0, 3.0])
def test_dice_of_shifted_boxes_is_that_of_the_formula(shift: float) -> None:
    square = outline(np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]))
    expected = max(0.0, 1.0 - shift / 2.0)
    for shape in (cube(), square):
        moved = shape.with_vertices(shape.vertices + np.eye(shape.dimension)[0] * shift)
        assert dice(shape, moved) == pytest.approx(expected, abs=COUNTING)


@pytest.mark.parametrize("dimension", [2, 3])
def test_occupancy_agrees_with_the_formula_of_a_ball(dimension: int) -> None:
    shape = (
        sphere(10.0, 40)
        if dimension == 3
        else outline(10.0 * np.column_stack([np.cos(t := np.linspace(0, 6.2, 400)), np.sin(t)]))
    )
    axes = [np.linspace(-12, 12, 31) + 0.017 * k for k in range(dimension)]
    radius = np.linalg.norm(np.stack(np.meshgrid(*axes, indexing="ij"), -1), axis=-1)
    clear = np.abs(radius - 10.0) > 0.1  # the polygon's chord error
    np.testing.assert_array_equal(occupancy(shape, axes)[clear], (radius < 10.0)[clear])


def test_pixels_are_scored_in_pixels() -> None:
    case = disc_case()
    sets = measure(case, placed(case), ("eam",))
    found = truth_scores(sets, case.prior, case.truth.surface, "px")  # type: ignore[union-attr, arg-type]
    assert set(found) == {"assd_px", "hd95_px", "dice", "within_1px", "within_2px", "within_3px"}
    assert found["assd_px"] == pytest.approx(2 / np.pi, rel=0.02)  # mean of |cos| over the circle


def test_all_that_is_measured_on_a_surface_shares_one_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    made = list[int]()
    build = ClosestPoint.__init__

    def counted(self: ClosestPoint, vertices: Array, faces: Ints) -> None:
        made.append(len(faces))
        build(self, vertices, faces)

    monkeypatch.setattr(ClosestPoint, "__init__", counted)
    ball = sphere(10.0, 12)
    near = project(2.0 * ball.vertices, ball)
    np.testing.assert_array_equal(near.distance, distances(2.0 * ball.vertices, ball))
    assert made == [len(ball.faces)]
