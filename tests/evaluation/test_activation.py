"""Activation times and velocities on a ball, where the wave is known."""

from __future__ import annotations

import numpy as np
import pytest
from tiny import sphere

from data_synth.motion import wobble
from o3dls.arrays import Array
from o3dls.errors import InputError
from o3dls.evaluation.activation import learning
from o3dls.evaluation.activation.activation_map import ActivationMap, map_activation
from o3dls.evaluation.activation.features import make_features
from o3dls.evaluation.activation.harmonics import Harmonics
from o3dls.evaluation.activation.velocity import Told, find_velocity
from o3dls.evaluation.activation.winding import find_wave, phase_times, wrap
from o3dls.geometry.surface import Surface
from o3dls.geometry.twist import rotation
from tests.chamber import sampled

RADIUS, SPEED, NOISE = 25.0, 0.6, 4.0  # mm, m/s, ms
BALL = sphere(RADIUS, 24)
CYCLE = 2.0 * np.pi * RADIUS / SPEED  # of a wave about the axis, which has this speed on the equator
WRONG = 15


def way_from_top(at: Array) -> Array:
    """Time at which a wave from the top arrives."""
    cosine = at[:, 2] / np.linalg.norm(at, axis=1)
    return np.asarray(RADIUS * np.arccos(np.clip(cosine, -1.0, 1.0)) / SPEED)


def turn_about_axis(at: Array) -> Array:
    return np.asarray(np.arctan2(at[:, 1], at[:, 0]) / (2.0 * np.pi) * CYCLE % CYCLE)


def measured(seed: int, *, circular: bool = False) -> tuple[Array, Array]:
    """300 places and times, of which the first are wrong."""
    rng = np.random.default_rng(seed)
    at = sampled(BALL, 300, seed, 0.0)
    times = (turn_about_axis if circular else way_from_top)(at) + NOISE * rng.normal(size=300)
    times[:WRONG] = rng.uniform(0.0, times.max(), WRONG)
    return at, times % CYCLE if circular else times


@pytest.fixture(scope="module")
def focal() -> ActivationMap:
    return map_activation(BALL, *measured(51_204))


@pytest.fixture(scope="module")
def turning() -> ActivationMap:
    return map_activation(BALL, *measured(51_205, circular=True), cycle=CYCLE)


def test_times_of_a_wave_are_found_within_their_deviation(focal: ActivationMap) -> None:
    missed = focal.time - way_from_top(BALL.vertices)
    assert np.abs(missed).mean() < 0.5 * NOISE
    assert (np.abs(missed) < 1.96 * focal.sd).mean() > 0.9
    assert np.quantile(focal.sd, 0.9) < NOISE


def test_wrong_times_are_doubted_and_others_are_not(focal: ActivationMap) -> None:
    at, times = measured(51_204)
    far = np.abs(times - way_from_top(at)) > 8.0 * NOISE
    assert far.sum() > 5
    assert focal.trust[far].max() < 0.1
    assert (focal.trust[WRONG:] > 0.5).mean() > 0.98
    assert focal.posterior.process.noise == pytest.approx(NOISE, rel=0.25)


def test_speed_and_direction_are_those_of_the_wave(focal: ActivationMap) -> None:
    told = focal.told == Told.VELOCITY
    assert told.mean() > 0.3
    assert np.median(focal.velocity.speed[told]) == pytest.approx(SPEED, rel=0.1)
    assert (focal.velocity.low[told] < SPEED).mean() > 0.9
    assert (focal.velocity.high[told] > SPEED).mean() > 0.9
    away = np.cross(np.cross([0.0, 0.0, 1.0], BALL.vertices), BALL.vertices)
    away /= np.maximum(np.linalg.norm(away, axis=1), 1e-9)[:, None]
    along = (focal.vectors * away).sum(axis=1)[told] / focal.velocity.speed[told]
    assert np.median(along) > 0.95
    assert np.isnan(focal.vectors[~told]).all()


def test_no_velocity_is_told_where_the_wave_starts(focal: ActivationMap) -> None:
    assert focal.told[BALL.vertices[:, 2].argmax()] == Told.UNDIRECTED


def test_nothing_is_told_where_a_map_has_no_points() -> None:
    at, times = measured(51_207)
    upper = at[:, 2] > 0.0
    found = map_activation(BALL, at[upper], times[upper])
    assert (found.told[BALL.vertices[:, 2] < -11.0] == Told.FAR).all()
    assert found.known[BALL.vertices[:, 2] > 2.0].mean() > 0.9
    low = BALL.vertices[:, 2] < -20.0
    assert found.sd[low].min() > 2.0 * np.median(found.sd[found.known])


def test_a_wave_that_comes_again_has_no_step_where_early_meets_late(turning: ActivationMap) -> None:
    middle = np.abs(BALL.vertices[:, 2]) < 0.6 * RADIUS
    missed = wrap(turning.time - turn_about_axis(BALL.vertices), CYCLE)[middle]
    assert np.abs(missed).mean() < 0.6 * NOISE
    assert (np.abs(missed) < 1.96 * turning.sd[middle]).mean() > 0.85
    told = middle & (turning.told == Told.VELOCITY)
    true = SPEED * np.hypot(BALL.vertices[:, 0], BALL.vertices[:, 1]) / RADIUS
    assert np.median(turning.velocity.speed[told] / true[told]) == pytest.approx(1.0, abs=0.08)
    seam = middle & (BALL.vertices[:, 0] > 0.0) & (np.abs(BALL.vertices[:, 1]) < 3.0)
    assert np.median(turning.velocity.speed[seam]) == pytest.approx(SPEED, rel=0.25)
    assert turning.told[[BALL.vertices[:, 2].argmin(), BALL.vertices[:, 2].argmax()]].all()  # it turns there


def test_the_wave_that_times_are_beside_does_not_follow_their_noise() -> None:
    """Of a wave that comes by twice a turn: what it followed would be missing from the intervals."""
    harmonics = Harmonics.of(BALL, np.ones(len(BALL.vertices), dtype=bool))
    rng = np.random.default_rng(51_211)
    middle = np.flatnonzero(np.abs(BALL.vertices[:, 2]) < 0.8 * RADIUS)
    kept = []
    for _ in range(4):
        rows = rng.choice(middle, 160, replace=False)
        noise = NOISE * rng.normal(size=160)
        times = (turn_about_axis(BALL.vertices[rows]) + noise) % (CYCLE / 2.0)
        wave, _ = find_wave(harmonics, harmonics.values[rows], times, CYCLE / 2.0)
        kept.append(wrap(times - phase_times(wave, CYCLE / 2.0), CYCLE / 2.0).std() / noise.std())
    assert np.mean(kept) > 0.93


def test_the_map_turns_with_the_heart(focal: ActivationMap) -> None:
    at, times = measured(51_204)
    turn, shift = rotation(np.array([0.4, -0.9, 0.3])), np.array([30.0, -12.0, 7.0])
    other = Surface(BALL.vertices @ turn.T + shift, BALL.faces)
    found = map_activation(other, at @ turn.T + shift, times + 100.0)
    apart = np.abs(found.time - 100.0 - focal.time)  # the bumps that harmonics are made of lie elsewhere
    assert apart.mean() < 0.2
    both = (found.told == Told.VELOCITY) & (focal.told == Told.VELOCITY)
    assert np.median(np.abs(found.vectors[both] - focal.vectors[both] @ turn.T)) < 0.02


def test_errors_of_place_make_times_less_sure() -> None:
    at, times = measured(51_204)
    rng = np.random.default_rng(7_718)
    errors = np.repeat(2.0 * rng.normal(size=(50, 1, 3)), len(BALL.vertices), axis=1)
    still, moved = (map_activation(BALL, at, times, errors=e) for e in (0.0 * errors, errors))
    assert np.median(moved.sd) > 1.2 * np.median(still.sd)


def test_intervals_hold_on_a_wall_that_a_registration_has_put_elsewhere() -> None:
    """The wall is off by a smooth field, of which samples are told that are not the field itself."""
    at, held = BALL.vertices, []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        drawn = np.stack([wobble(rng, 2.5, RADIUS, 3)(at) - at for _ in range(101)])
        wall, (xyz, times) = Surface(at + drawn[0], BALL.faces), measured(51_204 + seed)
        found = [map_activation(wall, xyz, times, errors=errors) for errors in (None, drawn[1:])]
        held.append([(np.abs(one.time - way_from_top(at)) < 1.96 * one.sd).mean() for one in found])
    without, allowed = np.mean(held, axis=0)
    assert without < 0.75
    assert allowed > 0.9


def test_samples_scatter_as_the_deviation_says(focal: ActivationMap) -> None:
    times, speeds = focal.samples(300, 4)
    assert times.std(axis=0) == pytest.approx(focal.sd, rel=0.25)
    assert np.abs(times.mean(axis=0) - focal.time).max() < 0.3 * focal.sd.max()
    told = focal.told == Told.VELOCITY
    low, high = np.quantile(speeds[:, told], [0.025, 0.975], axis=0)
    assert np.median(low / focal.velocity.low[told]) == pytest.approx(1.0, abs=0.1)
    assert np.median(high / focal.velocity.high[told]) == pytest.approx(1.0, abs=0.1)


def test_a_noisy_slope_does_not_make_the_wave_slow() -> None:
    """The length of a slope with noise is too large in the mean."""
    rng = np.random.default_rng(90_113)
    sd = 0.4 / SPEED
    slope = np.array([1.0 / SPEED, 0.0]) + sd * rng.normal(size=(400, 2))
    found = find_velocity(slope, np.tile(sd**2 * np.eye(2), (400, 1, 1)))
    naive = np.median(1.0 / np.linalg.norm(slope, axis=1))
    assert naive < SPEED
    assert np.median(found.speed) > naive
    assert np.median(found.speed) == pytest.approx(SPEED, rel=0.15)


def test_what_no_heart_does_is_said_and_not_cut_to_a_bound() -> None:
    still, fast = np.array([[100.0, 0.0], [0.2, 0.0]])
    found = find_velocity(np.stack([still, fast]), np.tile(1e-3 * np.eye(2), (2, 1, 1)))
    assert (found.tell(np.ones(2, dtype=bool)) == Told.STRANGE).all()


def test_harmonics_of_a_ball_are_spherical_ones() -> None:
    found = Harmonics.of(BALL, np.ones(len(BALL.vertices), dtype=bool), 100)
    degree = np.repeat(np.arange(6), 2 * np.arange(6) + 1)
    assert found.eigenvalues[1:36] * RADIUS**2 == pytest.approx((degree * (degree + 1.0))[1:], rel=0.05)
    height = BALL.vertices[:, 2]
    steep = np.linalg.norm(found.slopes(height), axis=0)
    assert steep == pytest.approx(np.hypot(BALL.vertices[:, 0], BALL.vertices[:, 1]) / RADIUS, abs=0.05)


def test_the_slope_of_the_likelihood_is_that_of_its_value() -> None:
    at, times = measured(51_208)
    harmonics = Harmonics.of(BALL, np.ones(len(BALL.vertices), dtype=bool), 120)
    rows = np.linalg.norm(BALL.vertices[:, None] - at[:60], axis=2).argmin(axis=0)
    seen = make_features(harmonics, harmonics.values[rows])
    rng = np.random.default_rng(3_317)
    logs = np.append(np.log(learning.BEGIN), 0.1 * rng.normal(size=seen.local.shape[1]))
    likely = learning.Likelihood(seen, times[:60] / 30.0, 0.0 * logs, np.ones(len(logs)))
    trust = rng.uniform(0.5, 1.0, 60)
    slope = likely(logs, trust)[1]
    for k in (0, 1, 2, 5, 40):
        step = 1e-5 * (np.arange(len(logs)) == k)
        rise = (likely(logs + step, trust)[0] - likely(logs - step, trust)[0]) / 2e-5
        assert slope[k] == pytest.approx(rise, rel=1e-4, abs=1e-4)


def test_maps_that_tell_nothing_are_refused() -> None:
    at, times = measured(51_209)
    with pytest.raises(InputError, match="10 points have a time"):
        map_activation(BALL, at[:10], times[:10])
    with pytest.raises(InputError, match="all points are the same"):
        map_activation(BALL, at, np.full(len(times), 3.0))
