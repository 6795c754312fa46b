"""The Bayesian algebra against what defines it: numpy's dense formulas, central differences, and refits
without a point.
"""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fields import body, covariance, spots, wall

from o3dls.arrays import Array
from o3dls.errors import SolverError
from o3dls.motion.field import marginal_likelihood as evidence
from o3dls.motion.field.covariance import FieldPrior, Observed
from o3dls.motion.field.gaussian_process import FieldPosterior, Posterior, solve
from o3dls.motion.field.marginal_likelihood import MarginalLikelihood, Scales, free_energy, tune_noise
from o3dls.motion.field.observations import Data, Feet, Rows, gather, number_patches, points_left_out
from o3dls.motion.settings import IterationSettings

Objective = Callable[[Array], tuple[float, Array]]
LOG = np.log([1.4, 0.6, 0.04, 0.05, 1.3])  # vector field, normal field, bend, strain, noise
FIELDS = len(LOG) - 1


def rows_of(
    count: int,
    seed: int,
    weights: Array | None = None,
    groups: int = 1,
    most: int = 10_000,
    dimension: int = 3,
) -> Rows:
    surface = body(dimension)
    at, face, _ = spots(surface, count, seed)
    rng = np.random.default_rng(seed + 1)
    normals = surface.face_normals[face]
    feet = Feet(at, normals, np.ones(count), rng.normal(size=count) * 2.0)
    data = wall(
        at,
        group=rng.permutation(np.arange(count) % groups),
        groups=groups,
        relative=rng.uniform(0.7, 1.4, count),
    )
    return gathered(feet, data, np.ones(count) if weights is None else weights, most, 6.0)


def gathered(feet: Feet, data: Data, weights: Array, most: int = 1000, patch: float = 1e-6) -> Rows:
    """The rows of points without landmarks; above `most`, those of a patch share one."""
    dimension = feet.at.shape[1]
    of_point = np.arange(len(weights))
    if len(weights) > most:
        of_point = number_patches(feet, data.group, patch, np.eye(dimension + 1))
    return gather(feet, data, weights, np.zeros((0, dimension)), of_point)


def likelihood_of(rows: Rows) -> MarginalLikelihood:
    return MarginalLikelihood.of(covariance(3), rows)


def posterior_of(rows: Rows) -> Posterior:
    return solve(likelihood_of(rows).covariance(LOG)[0], rows.residual)[0]


def scales(groups: int = 1) -> Scales:
    log = np.r_[LOG[:FIELDS], np.full(groups, LOG[-1])]
    return Scales(log, log.copy(), np.full(len(log), 0.7), np.full(len(log), -np.inf), FIELDS)


def test_solve_is_the_dense_formula() -> None:
    rows = rows_of(50, 40_787)
    matrix, _ = likelihood_of(rows).covariance(LOG)
    posterior, inverse = solve(matrix, rows.residual)
    np.testing.assert_allclose(inverse, np.linalg.inv(matrix), rtol=1e-8, atol=1e-10)
    np.testing.assert_array_equal(inverse, inverse.T)
    np.testing.assert_allclose(posterior.factor, np.linalg.cholesky(matrix), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(posterior.alpha, np.linalg.solve(matrix, rows.residual), rtol=1e-8)
    gaussian = (
        0.5 * rows.residual @ np.linalg.solve(matrix, rows.residual) + 0.5 * np.linalg.slogdet(matrix)[1]
    )
    assert posterior.energy == pytest.approx(gaussian, rel=1e-10)
    with pytest.raises(SolverError, match="not positive definite"):
        solve(matrix - 1e6 * np.eye(50), rows.residual)


@pytest.fixture
def minimised(monkeypatch: pytest.MonkeyPatch) -> list[Objective]:
    """The functions that tuning hands to the minimiser, which is kept from running."""
    kept: list[Objective] = []

    def catch(objective: Objective, x: Array, **_: object) -> SimpleNamespace:
        kept.append(objective)
        return SimpleNamespace(x=x)

    monkeypatch.setattr(evidence, "minimize", catch)
    return kept


@pytest.mark.parametrize("groups", [1, 2])
@pytest.mark.parametrize("merged", [False, True])
def test_gradient_of_the_evidence_against_central_differences(
    minimised: list[Objective], groups: int, merged: bool
) -> None:
    weights = np.random.default_rng(7_919).uniform(0.05, 1.0, 60)
    rows = rows_of(60, 55_439, weights, groups, most=20 if merged else 1000)
    likelihood_of(rows).maximise(scales(groups), IterationSettings())
    at = scales(groups).log + 0.1
    slope = minimised[0](at)[1]
    for k in range(len(at)):
        step = np.eye(len(at))[k] * 1e-5
        assert slope[k] == pytest.approx(
            (minimised[0](at + step)[0] - minimised[0](at - step)[0]) / 2e-5, rel=1e-5, abs=1e-5
        )


@pytest.mark.parametrize("groups", [1, 2])
def test_noise_beside_few_features_is_tuned_as_with_their_whole_covariance(
    minimised: list[Objective], groups: int
) -> None:
    rows = rows_of(60, 41_143, np.random.default_rng(3_571).uniform(0.05, 1.0, 60), groups)
    noises = scales(groups).noise_alone()
    seen = np.einsum("na,nak->nk", rows.observed.directions, covariance(3).similarity(rows.observed.at))
    MarginalLikelihood(seen @ seen.T, [], rows).maximise(noises, IterationSettings())
    tune_noise(noises, seen, rows, IterationSettings())
    for shift in (-1.0, 0.0, 2.0):
        whole, few = (objective(noises.log + shift) for objective in minimised)
        assert few[0] == pytest.approx(whole[0], rel=1e-8)
        np.testing.assert_allclose(few[1], whole[1], rtol=1e-6)


def test_no_step_of_the_line_search_overflows(minimised: list[Objective]) -> None:
    """Points in a plane that are all believed once asked for amplitudes beyond e^354."""
    rows = rows_of(60, 2_203)
    likelihood_of(rows).maximise(scales(1), IterationSettings())
    for step in (90.0, 400.0):
        energy, slope = minimised[0](scales(1).log + step)
        assert energy > minimised[0](scales(1).log)[0]
        assert np.isfinite(slope).all()


def test_left_out_is_a_refit_without_the_point() -> None:
    rows = rows_of(30, 82_903)
    matrix, noise = likelihood_of(rows).covariance(LOG)
    posterior, _ = solve(matrix, rows.residual)
    residual, var = posterior.left_out(noise)
    for i in range(30):
        others = np.arange(30) != i
        gain = np.linalg.solve(matrix[np.ix_(others, others)], matrix[others, i])
        assert residual[i] == pytest.approx(rows.residual[i] - gain @ rows.residual[others], abs=1e-8)
        assert var[i] == pytest.approx(matrix[i, i] - noise[i] - gain @ matrix[others, i], abs=1e-8)


def test_posterior_variance_is_the_dense_formula_and_falls_with_every_point() -> None:
    prior = FieldPrior(covariance(3), np.exp(LOG[:FIELDS]))
    asked = rows_of(12, 5_701).observed
    before = np.full(12, np.inf)
    for count in (5, 20, 80):
        rows = rows_of(80, 31_337)
        names = ("observed", "residual", "group", "relative", "of_point")
        first = replace(rows, **{name: _first(getattr(rows, name), count) for name in names})
        matrix, _ = likelihood_of(first).covariance(LOG)
        crossed = prior.between(first.observed, asked)
        field = FieldPosterior(prior, first.observed, posterior_of(first))
        var = field.variance(asked)
        dense = prior.between(asked, asked) - crossed.T @ np.linalg.inv(matrix) @ crossed
        np.testing.assert_allclose(field.covariance(asked), dense, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(var, np.diag(dense), rtol=1e-6, atol=1e-9)
        assert (var <= before + 1e-9).all()
        before = var


def _first(values, count):  # type: ignore[no-untyped-def]
    if isinstance(values, np.ndarray):
        return values[:count]
    return type(values)(values.at[:count], values.directions[:count], values.normal_part[:count])


def test_evidence_finds_amplitudes_and_noise_that_made_the_residuals() -> None:
    """Pooled over draws: the maximum of the evidence is consistent, so its mean logarithm comes near the
    truth.
    """
    rows = rows_of(250, 12_409)
    rng = np.random.default_rng(90_001)
    found = []
    likelihood = likelihood_of(rows)
    true = np.log([2.0, 0.8, 0.04, 0.05, 1.0])
    root = np.linalg.cholesky(likelihood.covariance(true)[0])
    wide = Scales(LOG, LOG.copy(), np.full(len(LOG), 2.0), np.full(len(LOG), -np.inf), FIELDS)
    for _ in range(12):
        drawn = replace(rows, residual=root @ rng.normal(size=250))
        found.append(replace(likelihood, rows=drawn).maximise(wide, IterationSettings(tuning_steps=40)))
    assert abs(np.mean(found, axis=0)[-1] - true[-1]) < 0.05
    assert abs(np.mean(found, axis=0)[0] - true[0]) < 0.35


def test_free_energy_of_believed_points_is_the_gaussian_evidence() -> None:
    rows = rows_of(40, 66_821)
    posterior = posterior_of(rows)
    assert free_energy(posterior, LOG[FIELDS:], rows) == pytest.approx(
        posterior.energy + 20.0 * np.log(2.0 * np.pi)
    )


@pytest.mark.parametrize("relative", [0.25, 1.0, 4.0])
def test_a_point_that_is_not_believed_leaves_the_free_energy(relative: float) -> None:
    """Also where its own noise differs: that of the others, and of nothing else."""
    surface = body(3)
    (at, face, _) = spots(body(3), 40, 5)
    feet = Feet(at, surface.face_normals[face], np.ones(40), np.random.default_rng(1).normal(size=40))
    data = wall(at, relative=np.r_[np.full(10, relative), np.ones(30)])
    doubted = np.arange(40) < 10
    rows = gathered(feet, data, np.where(doubted, 0.0, 1.0))
    posterior = posterior_of(rows)
    kept = Feet(*(getattr(feet, name)[10:] for name in ("at", "normals", "along", "residual")))
    others = gathered(kept, wall(at[10:]), np.ones(30))
    alone = posterior_of(others)
    assert free_energy(posterior, LOG[FIELDS:], rows) == pytest.approx(
        free_energy(alone, LOG[FIELDS:], others), abs=1e-3
    )


@pytest.mark.parametrize("belief", [1.0, 0.5, 1e-6])
def test_a_point_that_shares_a_row_is_left_out_as_far_as_it_is_believed(belief: float) -> None:
    """Against a refit without it: an outlier of four in a row, and one of its neighbours."""
    surface = body(3)
    (at, face, _) = spots(body(3), 15, 24_593)
    at = np.repeat(at, 4, axis=0)
    normals = np.repeat(surface.face_normals[face], 4, axis=0)
    residual = np.random.default_rng(1).normal(size=60)
    weights = np.ones(60)
    residual[::4] = -8.0
    weights[::4] = belief
    prior = FieldPrior(covariance(3), np.exp(LOG[:FIELDS]))
    noises = np.exp(LOG[FIELDS:])
    feet = Feet(at, normals, np.ones(60), residual)
    rows = gathered(feet, wall(at), weights, 10)
    matrix, noise = likelihood_of(rows).covariance(LOG)
    alone = solve(matrix, rows.residual)[0].left_out(noise)
    apart, var = points_left_out(rows, feet, weights, noise, alone, wall(at).noise(noises))
    for point in (0, 1):
        kept = np.arange(60) != point
        feet_kept = Feet(at[kept], normals[kept], np.ones(59), residual[kept])
        others = gathered(feet_kept, wall(at[kept]), weights[kept])
        posterior = posterior_of(others)
        asked = Observed(at[point : point + 1], normals[point : point + 1], np.ones(1))
        field = FieldPosterior(prior, others.observed, posterior)
        crossed = prior.between(others.observed, asked)
        assert apart[point] == pytest.approx(residual[point] - posterior.alpha @ crossed[:, 0], abs=1e-4)
        assert var[point] == pytest.approx(field.variance(asked)[0] + noises[0] ** 2, rel=1e-4)


@pytest.mark.parametrize("belief", [1.0, 0.4])
def test_free_energy_does_not_depend_on_merging(belief: float) -> None:
    """Points at one place may share a row: sufficient statistics lose nothing."""
    surface = body(3)
    at, face, _ = spots(surface, 15, 24_593)
    at = np.repeat(at, 4, axis=0)
    normals = np.repeat(surface.face_normals[face], 4, axis=0)
    feet = Feet(at, normals, np.ones(60), np.random.default_rng(3_163).normal(size=60))
    energies, alphas = [], []
    for most in (1000, 10):
        rows = gathered(feet, wall(at), np.full(60, belief), most)
        posterior = posterior_of(rows)
        energies.append(free_energy(posterior, LOG[FIELDS:], rows))
        alphas.append(
            np.bincount(np.arange(60) // 4, posterior.alpha)
            if most > 60
            else posterior.alpha[rows.of_point[::4]]
        )
    np.testing.assert_allclose(alphas[0], alphas[1], rtol=1e-6, atol=1e-9)
    assert energies[0] == pytest.approx(energies[1], abs=1e-6)


def test_flattery_is_what_integration_takes_from_the_evidence() -> None:
    """Against sums over a grid of one amplitude and the noise level; an amplitude that nothing depends on
    costs nothing.
    """
    rows = rows_of(30, 8_513)
    whole = likelihood_of(rows)
    part = whole.parts[0]
    likelihood = replace(whole, parts=[part])
    prior = Scales(np.log([0.8, 1.5]), np.log([0.8, 1.5]), np.array([1.0, 0.5]), np.full(2, -np.inf), 1)

    def energy(log: Array) -> float:
        pull = (log - prior.prior_log) / prior.prior_log_sd
        posterior = solve(likelihood.covariance(log)[0], rows.residual)[0]
        return free_energy(posterior, log[1:], rows) + 0.5 * float(pull @ pull)

    best = replace(prior, log=likelihood.maximise(prior, IterationSettings(tuning_steps=50)))
    pull = (best.log - prior.prior_log) / prior.prior_log_sd
    step = 0.15
    grid = [prior.prior_log + step * np.array([i, j]) for i in range(-40, 30) for j in range(-15, 16)]
    total = np.logaddexp.reduce([-energy(log) for log in grid]) + np.log(
        step**2 / (2.0 * np.pi * prior.prior_log_sd.prod())
    )
    flattered = -total - (energy(best.log) - 0.5 * float(pull @ pull))
    assert flattered > 0.5  # there is something to correct,
    # and Laplace's parabola misses little of it
    assert likelihood.laplace(best) == pytest.approx(flattered, abs=0.3)
    silent = replace(prior, log=np.r_[prior.log[:1], best.log[1:]])
    noise_only = Scales(best.log[1:], prior.prior_log[1:], prior.prior_log_sd[1:], prior.least[1:], 0)
    assert replace(whole, parts=[0.0 * part]).laplace(silent) == pytest.approx(
        replace(whole, parts=[]).laplace(noise_only)
    )


def stacked() -> tuple[Array, Feet]:
    """Fifteen places of the wall with four points each."""
    surface = body(3)
    at, face, _ = spots(surface, 15, 24_593)
    at = np.repeat(at, 4, axis=0)
    normals = np.repeat(surface.face_normals[face], 4, axis=0)
    return at, Feet(at, normals, np.ones(60), np.random.default_rng(3_163).normal(size=60))


def test_points_that_share_a_row_flatter_a_motion_as_those_that_do_not() -> None:
    at, feet = stacked()
    apart, merged = (gathered(feet, wall(at), np.ones(60), most) for most in (1000, 10))
    assert len(merged.residual) == 15
    found = [likelihood_of(rows).laplace(scales()) for rows in (apart, merged)]
    assert found[0] == pytest.approx(found[1], abs=1e-6)


def test_points_of_two_groups_share_no_row() -> None:
    at, feet = stacked()
    group = np.arange(60) % 2
    rows = gathered(feet, wall(at, group=group, groups=2), np.ones(60), 10, 6.0)
    np.testing.assert_array_equal(rows.group[rows.of_point], group)


def test_the_two_sides_of_a_thin_wall_share_no_row() -> None:
    at, feet = stacked()
    both = replace(feet, normals=feet.normals * np.where(np.arange(60) % 2, 1.0, -1.0)[:, None])
    rows = gathered(both, wall(at), np.ones(60), 10)
    assert np.linalg.norm(rows.observed.directions, axis=1).min() > 0.9


@pytest.mark.filterwarnings("ignore:overflow")
def test_a_residual_without_measure_is_an_error() -> None:
    with pytest.raises(SolverError, match="not finite"):
        solve(np.eye(2), np.array([1e200, 1.0]))
