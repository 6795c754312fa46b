"""Laws of the registration kernels: steps follow the gradient, weights and masks do what their papers say,
directions are named right.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from chamber import chamber, farthest_effect, outline_without_symmetry, pose, sampled
from tiny import sphere

from o3dls.arrays import Array
from o3dls.geometry.similarity import apply, fit_similarity, scale_of
from o3dls.geometry.surface import Surface
from o3dls.geometry.twist import Twist, rotation, strains
from o3dls.noise.mixture import fit_mixture
from o3dls.noise.robust import EFFICIENT_95, KERNELS, kernel_weights, robust_sd
from o3dls.registration import metrics, reject
from o3dls.registration.icp import Criteria, Recipe, align
from o3dls.registration.match import Pairs, SurfaceMatcher
from o3dls.registration.normals import point_normals
from o3dls.registration.observability import spectrum
from o3dls.registration.step import Body, Freedom, best_motion, normal_equations, velocity

SHAPES = pytest.mark.parametrize("prior", [chamber(24), outline_without_symmetry()], ids=["3D", "2D"])


def moved(pairs: Pairs, matrix: Array) -> Pairs:
    """The pairs after the surface, normals and all, went along with a similarity."""
    normals = pairs.normals @ matrix[:-1, :-1].T / scale_of(matrix)
    return Pairs(pairs.points, apply(matrix, pairs.feet), normals, pairs.faces)


def energy(factors: metrics.Factors, weights: Array) -> float:
    return 0.5 * float(weights @ factors.residuals**2)


@SHAPES
@pytest.mark.parametrize("metric", [metrics.point_to_point, metrics.point_to_plane])
def test_the_gradient_is_that_of_the_metric_by_central_differences(
    prior: Surface, metric: metrics.Metric
) -> None:
    pairs = SurfaceMatcher(prior).match(
        apply(pose(3.0, 2.0, d=prior.dimension), sampled(prior, 80, 55_021, 1.0)), np.eye(prior.dimension + 1)
    )
    # as normals of vertices are
    tilted = pairs.normals + np.random.default_rng(27_361).normal(0.0, 0.2, pairs.normals.shape)
    pairs = replace(pairs, normals=tilted / np.linalg.norm(tilted, axis=1, keepdims=True))
    factors = metric(pairs)
    twist = Twist(prior.dimension, scale=True)
    centre = pairs.feet.mean(axis=0)
    weights = np.random.default_rng(7_741).uniform(0.2, 1.0, 80)
    _, gradient = normal_equations(factors, weights, velocity(factors, twist, centre))
    h = 1e-5
    for k in range(twist.size):
        e = h * np.eye(twist.size)[k]
        up, down = (energy(metric(moved(pairs, twist.motion(s * e, centre))), weights) for s in (1.0, -1.0))
        assert -(up - down) / (2 * h) == pytest.approx(gradient[k], rel=1e-5, abs=1e-4)


@SHAPES
def test_a_step_lessens_the_metric_and_a_second_on_the_same_pairs_has_nothing_to_do(prior: Surface) -> None:
    still = SurfaceMatcher(prior).match(
        apply(pose(3.0, 2.0, d=prior.dimension), sampled(prior, 80, 4_993)), np.eye(prior.dimension + 1)
    )
    weights = np.ones(80)
    body = Body.of(prior.vertices)
    for make in (metrics.point_to_point, metrics.point_to_plane):
        pairs = still
        for _ in range(8):
            factors = make(pairs)
            delta = best_motion(factors, weights, body, Freedom(scale=True))
            pairs = moved(pairs, delta)
        assert energy(make(pairs), weights) < 0.95 * energy(make(still), weights)
        assert np.abs(delta - np.eye(prior.dimension + 1)).max() < 1e-6


@pytest.mark.parametrize("d", [2, 3])
def test_a_twist_and_its_tangent_agree(d: int) -> None:
    rng = np.random.default_rng(66_103)
    twist = Twist(d, scale=True)
    points = rng.normal(size=(5, d))
    centre = rng.normal(size=d)
    small = 1e-6 * rng.normal(size=twist.size)
    displaced = apply(twist.motion(small, centre), points) - points
    np.testing.assert_allclose(displaced, twist.tangent(points, centre) @ small, atol=1e-11)


@SHAPES
def test_a_strain_is_no_similarity_and_the_nearest_similarity_to_it_is_none(prior: Surface) -> None:
    generators = strains(prior.vertices)
    vertices = prior.vertices - prior.vertices.mean(axis=0)
    assert len(generators) == (2 if prior.dimension == 2 else 5)
    for generator in generators:
        strained = vertices + 0.01 * vertices @ generator.T
        # but for its square
        np.testing.assert_allclose(fit_similarity(vertices, strained), np.eye(prior.dimension + 1), atol=1e-4)
        assert np.linalg.norm(strained - vertices, axis=1).max() > 0.05


@SHAPES
def test_a_pose_is_not_pulled_by_a_strain_that_it_may_assume(prior: Surface) -> None:
    """Points on a quarter of a strained surface: the pose of the whole is the prior's own, and strain
    explains the rest.
    """
    d = prior.dimension
    middle = prior.vertices.mean(axis=0)
    linear = np.eye(d) + 0.03 * strains(prior.vertices)[-1]
    stretched = sampled(prior, 400, 83_417) @ linear.T + middle - linear @ middle
    seen = stretched[stretched[:, 0] > middle[0]]
    body = Body.of(prior.vertices)
    ends = []
    for freedom in (Freedom(scale=True), Freedom(scale=True, strain_sd=0.05)):
        recipe = Recipe(metrics.point_to_plane, freedom)
        found = align(seen, SurfaceMatcher(prior), np.eye(d + 1), recipe, Criteria())
        ends.append(farthest_effect(found.T_map_prior, np.eye(d + 1), prior))
    assert body.strained(prior.vertices).shape[2] == len(body.strains)
    assert ends[1] < 0.5 * ends[0]


def test_a_rotation_vector_turns_by_its_length() -> None:
    np.testing.assert_allclose(
        rotation(np.array([0.0, 0.0, np.pi / 2])) @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15
    )
    np.testing.assert_allclose(rotation(np.array([np.pi / 2])) @ [1.0, 0.0], [0.0, 1.0], atol=1e-15)


@SHAPES
def test_pairs_are_closest_points_wherever_the_surface_is(prior: Surface) -> None:
    d = prior.dimension
    matrix = pose(40.0, 15.0, 1.3, d=d)
    points = sampled(prior, 50, 93_911, 2.0)
    found = SurfaceMatcher(prior).match(points, matrix)
    exact = SurfaceMatcher(prior.with_vertices(apply(matrix, prior.vertices))).match(points, np.eye(d + 1))
    np.testing.assert_allclose(found.feet, exact.feet, atol=1e-9)
    np.testing.assert_allclose(found.normals, exact.normals, atol=1e-6)
    np.testing.assert_allclose(np.abs(found.signed), found.distances, atol=1e-9)


@pytest.mark.parametrize("kernel", KERNELS)
def test_kernels_believe_small_residuals_and_doubt_large_ones(kernel: str) -> None:
    residuals = np.linspace(0.0, 50.0, 501)
    weights = kernel_weights(kernel, residuals, 2.0)
    assert weights[0] == 1.0
    assert (np.diff(weights) <= 1e-15).all()
    assert weights[-1] < 0.05
    np.testing.assert_array_equal(weights, kernel_weights(kernel, -residuals, 2.0))
    clean = np.random.default_rng(31_013).normal(size=200_000)
    # efficiency of a location estimate: (E psi')^2 / E psi^2
    w = kernel_weights(kernel, clean, EFFICIENT_95[kernel])
    slope = (kernel_weights(kernel, clean + 1e-4, EFFICIENT_95[kernel]) * (clean + 1e-4) - w * clean) / 1e-4
    assert slope.mean() ** 2 / ((w * clean) ** 2).mean() == pytest.approx(0.95, abs=0.01)


def test_spread_is_the_standard_deviation_and_forgets_a_third_of_outliers() -> None:
    rng = np.random.default_rng(81_517)
    clean = rng.normal(0.0, 1.5, 9_000)
    assert robust_sd(clean) == pytest.approx(1.5, rel=0.03)
    assert robust_sd(np.r_[clean, np.full(3_000, 1e6)]) < 2.5


def test_the_mixture_finds_noise_and_share_and_tells_inside_from_outside() -> None:
    rng = np.random.default_rng(20_389)
    signed = np.r_[rng.normal(0.0, 1.5, 800), -rng.uniform(0.0, 12.0, 200)]  # from the wall on
    found = fit_mixture(signed, radius=26.0)
    assert found.sigma == pytest.approx(1.5, rel=0.1)
    assert found.outlier_fraction == pytest.approx(0.2, abs=0.04)
    assert found.weights[800:][signed[800:] < -4.5].mean() < 0.02
    assert found.weights[:800].mean() > 0.9
    weights = fit_mixture(np.r_[signed, 5.0, -5.0], radius=26.0).weights
    # out there a point is more likely noise: catheters do not leave the chamber
    assert weights[-2] > weights[-1]
    clean = fit_mixture(rng.normal(0.0, 1.5, 1_000), radius=26.0)
    assert clean.outlier_fraction < 0.03
    assert fit_mixture(np.zeros(50), radius=26.0).weights.min() > 0.99


def test_rules_keep_what_their_names_say() -> None:
    distances = np.r_[np.linspace(0.1, 1.0, 9), 8.0]
    points = np.column_stack([10.0 * np.arange(10.0), distances, np.zeros(10)])
    pairs = Pairs(
        points, points * [1.0, 0.0, 1.0], np.tile([0.0, 1.0, 0.0], (10, 1)), np.zeros(10, dtype=np.int64)
    )
    counts = {
        "within": reject.within(0.55),
        "trimmed": reject.trimmed(0.7),
        "deviations": reject.deviations(2.0),
        "median_deviations": reject.median_deviations(3.0),
        "reciprocal": reject.reciprocal(1.0),
    }
    assert {name: int(rule(pairs, 1.0).sum()) for name, rule in counts.items()} == {
        "within": 5,
        "trimmed": 7,
        "deviations": 9,
        "median_deviations": 9,
        "reciprocal": 10,
    }
    assert int(counts["within"](pairs, 2.0).sum()) == 9
    tilted = np.tile([0.0, np.cos(0.5), np.sin(0.5)], (10, 1))
    assert reject.normal_angle(0.51, -tilted)(pairs, 1.0).all()
    assert not reject.normal_angle(0.49, tilted)(pairs, 1.0).any()


def test_a_point_that_stole_its_foot_from_a_nearer_one_is_not_reciprocal() -> None:
    points = np.array([[0.0, 5.0, 0.0], [0.1, 0.2, 0.0]])
    pairs = Pairs(
        points,
        np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]),
        np.tile([0.0, 1.0, 0.0], (2, 1)),
        np.zeros(2, dtype=np.int64),
    )
    np.testing.assert_array_equal(reject.reciprocal(1.5)(pairs, 1.0), [False, True])


def test_normals_of_points_are_those_of_the_sphere_they_lie_on() -> None:
    directions = np.random.default_rng(47_363).normal(size=(400, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    assert np.abs((point_normals(20.0 * directions) * directions).sum(axis=1)).mean() > 0.98


def test_a_body_of_revolution_does_not_tell_the_rotation_about_its_axis() -> None:
    egg = sphere(1.0, 30)
    egg = egg.with_vertices(egg.vertices * [10.0, 10.0, 25.0])
    points = sampled(egg, 200, 61_927, 0.5)
    weakest, *others = spectrum(
        SurfaceMatcher(egg).match(points, np.eye(4)), np.ones(200), egg.vertices, np.eye(4), scale=True
    )
    assert weakest.meaning == "rotation about the long axis"
    assert "do not determine" in weakest.sentence("mm")
    assert not any(direction.weak for direction in others)
    assert len(others) == 6


@SHAPES
def test_the_spectrum_turns_and_scales_with_the_case(prior: Surface) -> None:
    d = prior.dimension
    points = sampled(prior, 120, 23_869, 0.6)
    frame = pose(70.0, 30.0, 2.0, d=d)
    here = spectrum(
        SurfaceMatcher(prior).match(points, np.eye(d + 1)),
        np.ones(120),
        prior.vertices,
        np.eye(d + 1),
        scale=True,
    )
    there = spectrum(
        SurfaceMatcher(prior).match(apply(frame, points), frame),
        np.ones(120),
        prior.vertices,
        frame,
        scale=True,
    )
    np.testing.assert_allclose([t.relative for t in there], [h.relative for h in here], rtol=1e-6)
    assert [t.meaning.split()[0] for t in there] == [h.meaning.split()[0] for h in here]
