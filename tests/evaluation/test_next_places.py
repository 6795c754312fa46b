"""Where to map next: what is proposed makes the posterior as sure as is promised, and nothing else is."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from starts import started

from o3dls import InputError, suggest
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.evaluation import next_places
from o3dls.evaluation.wall_modes import wall_modes
from o3dls.geometry.cut_wall import CUT
from o3dls.geometry.inner_balls import GRAZING, depth_in_tubes, inner_balls
from o3dls.geometry.similarity import apply, similarity
from o3dls.geometry.spread import spread
from o3dls.motion.recorded import RecordedMotion
from tests.chamber import chamber, sampled
from tests.tiny import sphere

NOISE = 1.0
SEED = 271_829


def mapped(rings: int, count: int, *, half: bool = False) -> tuple[Case, Estimate]:
    """A chamber that has filled since it was imaged, more to the front than to the side, fitted to points of
    it.
    """
    surface = chamber(rings)
    points = sampled(surface, count, SEED) * [1.05, 1.18, 0.98]
    points += NOISE * np.random.default_rng(SEED).normal(size=points.shape)
    case, estimate = started(surface, points[points[:, 0] > 0] if half else points, NOISE)
    fit = estimate.fit
    assert fit is not None
    surface = replace(surface, vertices=fit.vertices, fields={"sd_mm": fit.sd})
    return case, replace(estimate, surface=surface, sigma=fit.sigma, weights=fit.weights)


@pytest.fixture(scope="module")
def half_mapped() -> tuple[Case, Estimate]:
    """A chamber with points on its left half alone."""
    return mapped(24, 160, half=True)


def test_the_first_place_is_where_no_points_are(half_mapped: tuple[Case, Estimate]) -> None:
    case, estimate = half_mapped
    places = suggest(case, estimate, 3).places
    assert places[0].xyz[0] < -5.0
    for place in places:
        assert np.array_equal(estimate.surface.vertices[place.vertex], place.xyz)
        nearest = np.linalg.norm(case.points.xyz - place.xyz, axis=1).min()
        assert place.distance == pytest.approx(nearest)
        assert place.after < place.before
        assert place.near_after < place.near_before
    assert [one.after for one in places[:-1]] == [one.before for one in places[1:]]
    gaps = [np.linalg.norm(a.xyz - b.xyz) for a in places for b in places if a is not b]
    assert min(gaps) > 5.0


def test_a_place_is_worth_what_gaussian_algebra_says(half_mapped: tuple[Case, Estimate]) -> None:
    """One after another in closed form gives what conditioning on all of them at once gives."""
    case, estimate = half_mapped
    noise = estimate.sigma or 0.0
    at = estimate.motion(case.prior.vertices)  # type: ignore[misc]
    where = [one.vertex for one in suggest(case, estimate, 2).places]
    some = np.r_[where, spread(at, 200)]
    normals = case.prior.with_vertices(at).vertex_normals[some]
    joint = estimate.motion.joint(case.prior.vertices[some], normals)  # type: ignore[union-attr]
    seen = joint[:2, :2] + noise**2 * np.eye(2)
    after = np.diag(joint) - np.einsum("ij,ji->i", joint[:, :2], np.linalg.solve(seen, joint[:2]))
    modes = wall_modes(case.prior, estimate.motion)
    assert modes is not None
    first = modes.modes @ modes.modes.T
    left = first
    for vertex in where:
        row = left[np.flatnonzero(modes.places == vertex)[0]]
        own = float(row[modes.places == vertex][0])
        left = left - np.outer(row, row) / (own + noise**2)
    common = {int(vertex): k for k, vertex in enumerate(modes.places)}
    pairs = [(k, common[int(vertex)]) for k, vertex in enumerate(some) if int(vertex) in common]
    mine, theirs = np.array(pairs).T
    # the weakest modes are left out: a hundredth of the variance
    assert np.allclose(np.diag(left)[theirs], after[mine], atol=0.02 * np.diag(first).max())


def test_the_promise_is_kept_by_a_fit_with_the_point(half_mapped: tuple[Case, Estimate]) -> None:
    from o3dls.motion.fit import fit_motion
    from tests.fields import wall

    case, estimate = half_mapped
    place = suggest(case, estimate, 1).places[0]
    fit = estimate.fit
    assert fit is not None
    further = fit_motion(
        case.prior.vertices,
        case.prior.faces,
        np.eye(4),
        wall(np.vstack([case.points.xyz, place.xyz])),
        warm=fit,
    )
    fell = [
        (one**2).mean() for one in (fit.sd, further.sd)
    ]  # plain means over vertices: the areas of a chamber differ by little
    # what a point does to noise level and normals is not foreseen: a quarter of the gain
    assert 1.0 - fell[1] / fell[0] == pytest.approx(place.gain, rel=0.25)


def test_weights_and_reach_are_respected(half_mapped: tuple[Case, Estimate]) -> None:
    case, estimate = half_mapped
    x, z = estimate.surface.vertices[:, [0, 2]].T
    for sign in (1, -1):
        top = suggest(case, estimate, 2, reachable=sign * z > 0).places
        assert len(top) == 2
        assert all(sign * place.xyz[2] > -3.0 for place in top)  # within the spacing of the places
    weighed = suggest(case, estimate, 1, weights=((x < 0) & (z > 5)).astype(float)).places[0]
    assert weighed.xyz[2] > 0
    nowhere = suggest(case, estimate, 2, reachable=x > x.max() - 1e-9)
    assert not nowhere.places
    assert "no further place" in nowhere.ended


def test_no_place_is_proposed_where_the_image_ended(half_mapped: tuple[Case, Estimate]) -> None:
    case, estimate = half_mapped
    free = suggest(case, estimate, 1).places[0]
    z = np.sign(free.xyz[2]) * estimate.surface.vertices[:, 2]
    surface = replace(estimate.surface, fields={**estimate.surface.fields, CUT: (z > 0).astype(float)})
    cut = suggest(case, replace(estimate, surface=surface), 2).places
    assert len(cut) == 2
    assert all(np.sign(free.xyz[2]) * place.xyz[2] < 3.0 for place in cut)


def test_a_sure_wall_needs_no_point() -> None:
    case, estimate = mapped(16, 700)
    found = suggest(case, estimate, 5)
    assert len(found.places) < 5
    assert found.ended


def test_no_place_is_surer_than_the_mean(half_mapped: tuple[Case, Estimate]) -> None:
    case, estimate = half_mapped
    sd = estimate.surface.fields["sd_mm"]
    for place in suggest(case, estimate, 4).places:
        assert sd[place.vertex] > 0.9 * sd.mean()  # means of the area and of the vertices differ


def test_outliers_are_expected_among_new_points_too(half_mapped: tuple[Case, Estimate]) -> None:
    case, estimate = half_mapped
    believed = (replace(estimate, weights=np.full(len(case.points), weight)) for weight in (1.0, 0.5))
    sure, doubted = (suggest(case, one, 1).places[0].gain for one in believed)
    assert doubted == pytest.approx(0.5 * sure)


def test_it_turns_with_the_map(half_mapped: tuple[Case, Estimate]) -> None:
    case, estimate = half_mapped
    modes = wall_modes(case.prior, estimate.motion)
    moved = case.prior.with_vertices(estimate.motion(case.prior.vertices))  # type: ignore[misc]
    T = similarity(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([30.0, -8, 5]))
    own = RecordedMotion(case.prior, moved, np.eye(4), np.ones(len(moved.vertices)), modes)
    turned = replace(own, moved=moved.transformed(T), T_map_prior=T)
    there = replace(case, points=replace(case.points, xyz=apply(T, case.points.xyz)))
    here = suggest(case, replace(estimate, motion=own), 2).places
    found = suggest(
        there, replace(estimate, motion=turned, surface=estimate.surface.transformed(T)), 2
    ).places
    for a, b in zip(here, found, strict=True):
        assert np.allclose(apply(T, a.xyz[None])[0], b.xyz)
        assert a.after == pytest.approx(b.after)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"k": 0}, "must be at least 1"),
        ({"weights": np.ones(3)}, "weights has shape \\(3,\\)"),
        ({"reachable": np.zeros(1106)}, "above 0 somewhere"),
        ({"weights": np.full(1106, np.nan)}, "must be finite"),
    ],
)
def test_what_does_not_fit_is_refused(
    half_mapped: tuple[Case, Estimate], options: dict[str, Any], sentence: str
) -> None:
    case, estimate = half_mapped
    options = {
        key: np.resize(value, len(case.prior.vertices)) if np.shape(value) == (1106,) else value
        for key, value in options.items()
    }
    with pytest.raises(InputError, match=sentence):
        suggest(case, estimate, **options)


def test_an_estimate_without_posterior_is_refused(half_mapped: tuple[Case, Estimate]) -> None:
    case, estimate = half_mapped
    with pytest.raises(InputError, match="no joint posterior"):
        suggest(case, replace(estimate, motion=None))


def test_inner_balls_of_a_sphere_are_the_sphere() -> None:
    rng = np.random.default_rng(SEED)
    on: Array = rng.normal(size=(4000, 3))
    on /= np.linalg.norm(on, axis=1, keepdims=True)
    centre, radius = inner_balls(20.0 * on[:50], on[:50], 20.0 * on)
    assert np.allclose(radius, 20.0, rtol=1e-3)  # the ball stops shrinking within 0.001 of its radius
    assert np.abs(centre).max() < 0.03


def test_inner_balls_are_those_of_a_plain_loop_over_all_points() -> None:
    """On a body with dents and bumps, so that balls of all sizes touch it."""
    rng = np.random.default_rng(60_517)
    out = sphere(1.0, 14).vertices
    points = 20.0 * out * (1.0 + 0.3 * np.sin(5.0 * out).prod(axis=1))[:, None]
    normals = out + 0.2 * rng.normal(size=out.shape)  # uneven, as a scanner's
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    _, radius = inner_balls(points, normals, points)
    away = points[:, None] - points
    height = np.einsum("ijd,id->ij", away, normals)
    squared = (away**2).sum(axis=2)
    bounding = (height > 0.0) & (height**2 > GRAZING**2 * squared)
    through = np.divide(squared, 2.0 * height, out=np.full(height.shape, np.inf), where=bounding)
    widest = float(np.ptp(points, axis=0).min()) / 2
    assert radius == pytest.approx(np.minimum(through.min(axis=1), widest), rel=1e-12)


def test_depth_grows_along_a_tube() -> None:
    """A ball of radius 16 with a tube of radius 5 along x, which leaves it at 15.2."""
    ball, *_ = 16.0 * np.array([sphere(1.0, 20).vertices])
    ball = ball[ball[:, 0] < 15.2]
    x, around = (one.ravel() for one in np.meshgrid(np.arange(15.5, 30, 0.5), np.linspace(0, 6.2, 40)))
    out = np.column_stack([0 * x, np.cos(around), np.sin(around)])
    at = np.vstack([ball, 5.0 * out + x[:, None] * [1, 0, 0]])
    depth = depth_in_tubes(at, np.vstack([ball / 16.0, out]), at)
    assert depth[: len(ball)].max() < 0.1  # the ball is that of its points
    assert np.allclose(depth[len(ball) :], np.hypot(x, 5.0) - 16.0, atol=0.1)


def test_numbers_of_the_advice_are_those_of_the_documents() -> None:
    assert (next_places.LEAST_GAIN, next_places.APART) == (0.02, 0.2)


def test_a_part_without_a_point_is_proposed_though_it_changes_the_mean_little() -> None:
    case, estimate = mapped(24, 160)
    every = suggest(case, estimate, 9)
    assert every.ended
    surface = estimate.surface
    near = np.linalg.norm(surface.vertices[:, None] - case.points.xyz[None], axis=2).min(axis=1)
    chosen = np.array([one.xyz for one in every.places]).reshape(-1, 3)
    taken = np.linalg.norm(surface.vertices[:, None] - chosen[None], axis=2).min(axis=1, initial=np.inf)
    rest = np.where(taken > 12.0, near, 0.0)
    part = np.linalg.norm(surface.vertices - surface.vertices[rest.argmax()], axis=1) < 5.0
    found = suggest(case, estimate, 9, unvisited=[part])
    assert [one.xyz.tolist() for one in found.places[:-1]] == chosen.tolist()
    assert part[found.places[-1].vertex]
    without = suggest(case, estimate, 9, unvisited=[part], reachable=~part)
    assert len(without.places) == len(every.places)
