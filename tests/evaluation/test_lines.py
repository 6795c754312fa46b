"""A line through points whose places are known with an error is not flattened by that error."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm
from tiny import sphere

from o3dls.arrays import Array
from o3dls.evaluation.measures.line import FEWEST, MOST, Line, crossing, fit_line
from o3dls.evaluation.measures.readings import Readings, read_at_points
from o3dls.geometry.twist import rotation
from o3dls.motion.wall.samples import SurfaceSamples

RADIUS, COUNT = 20.0, 250
BALL = sphere(RADIUS, 40)
TURNED, NOISE = 0.06, 1.2  # rad and mm, sd per axis
LEVEL, SLOPE, SCATTER = 1.0, -2.0, 0.1
CASES = 16


def waves(at: Array) -> Array:
    """A field (n,) that changes over some millimetres."""
    return np.asarray(np.sin(2.0 * np.pi * at / 14.0).sum(axis=1))


def turned(rng: np.random.Generator) -> Array:
    return rotation(TURNED * rng.normal(size=3))


def samples(rng: np.random.Generator, count: int = 200) -> SurfaceSamples:
    at = np.array([BALL.vertices @ turned(rng).T for _ in range(count)])
    return SurfaceSamples(BALL, at, np.ones(at.shape[:2], dtype=bool))


def mapped(rng: np.random.Generator) -> tuple[Line, Array]:
    """The line through points of a ball that was turned as its samples are, and the true places."""
    true = rng.normal(size=(COUNT, 3))
    true *= RADIUS / np.linalg.norm(true, axis=1)[:, None]
    xyz = true @ turned(rng).T + NOISE * rng.normal(size=true.shape)
    values = LEVEL + SLOPE * waves(true) + SCATTER * rng.normal(size=COUNT)
    read = read_at_points(samples(rng), waves(BALL.vertices), xyz, np.full(COUNT, NOISE), rng)
    found = fit_line(values, read)
    assert found is not None
    return found, true


def test_the_slope_is_the_true_one_where_that_at_the_nearest_places_is_flat() -> None:
    lines = [mapped(np.random.default_rng((7_907, k)))[0] for k in range(CASES)]
    slopes = np.array([line.found[1] for line in lines])
    naive = np.array([line.naive[1] for line in lines])
    assert np.mean(naive) / SLOPE < 0.9
    assert np.mean(slopes) == pytest.approx(SLOPE, rel=0.04)
    assert np.mean([line.found[0] for line in lines]) == pytest.approx(LEVEL, abs=0.1)
    deviations = (slopes - SLOPE) / [np.sqrt(line.covariance[1, 1]) for line in lines]
    assert 0.4 < np.sqrt(np.mean(deviations**2)) < 1.6
    held = [low <= SLOPE <= high for low, high in (line.slope_interval(0.95) for line in lines)]
    assert np.mean(held) >= 13 / CASES


def test_without_errors_of_place_it_is_that_of_least_squares() -> None:
    rng = np.random.default_rng(22_721)
    x, at = rng.normal(size=60), 30.0 * rng.normal(size=(60, 3))
    values = 3.0 + 0.5 * x + 0.2 * rng.normal(size=60)
    found = fit_line(values, Readings(x, np.tile(x, (20, 1)), at, np.ones(60, dtype=bool)))
    assert found is not None
    assert found.naive == pytest.approx(np.polyfit(x, values, 1)[::-1])
    assert found.found == pytest.approx(found.naive, abs=0.05)


def test_a_crossing_lies_where_the_line_may_have_the_value() -> None:
    """Its ends are where the value is as many deviations off as the interval has."""
    covariance = np.array([[0.04, -0.02], [-0.02, 0.02]])
    line = Line(np.array([1.0, -1.5]), covariance, np.zeros(2), 50)
    for end in line.crossing_interval(-0.7, 0.95):
        row = np.array([1.0, end])
        off = (row @ line.found + 0.7) / np.sqrt(row @ covariance @ row)
        assert abs(off) == pytest.approx(norm.ppf(0.975))
    low, high = line.crossing_interval(-0.7, 0.95)
    assert low < crossing(line.found, -0.7) < high


def test_a_line_that_may_be_level_crosses_anywhere() -> None:
    line = Line(np.array([1.0, -0.1]), np.diag([0.01, 0.01]), np.zeros(2), 50)
    assert np.isnan(line.crossing_interval(0.0, 0.95)).all()
    assert np.isnan(crossing(np.array([1.0, 0.0]), 0.5))


def test_too_few_points_or_a_field_that_is_the_same_everywhere_have_no_line() -> None:
    rng = np.random.default_rng(3_463)
    x, at, near = rng.normal(size=FEWEST), rng.normal(size=(FEWEST, 3)), np.ones(FEWEST, dtype=bool)
    read = Readings(x, np.tile(x, (20, 1)), at, near)
    assert fit_line(x, read) is not None
    for k in range(2):
        without = x.copy()
        without[k] = np.nan
        assert fit_line(without, read) is None
    flat = np.ones(FEWEST)
    assert fit_line(x, Readings(flat, np.tile(flat, (20, 1)), at, near)) is None
    far = near.copy()
    far[3] = False
    assert fit_line(x, Readings(x, np.tile(x, (20, 1)), at, far)) is None


def test_of_many_points_those_are_used_that_lie_apart() -> None:
    rng = np.random.default_rng(59_011)
    n = MOST + 50
    x, at = rng.normal(size=n), 30.0 * rng.normal(size=(n, 3))
    found = fit_line(2.0 * x, Readings(x, x + 0.01 * rng.normal(size=(20, n)), at, np.ones(n, dtype=bool)))
    assert found is not None
    assert found.count == MOST
