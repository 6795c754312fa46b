"""How points are seen from a wall: their noise, the bias of its curvature, outliers, points inside."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import circle, meshed, round_distance, sampled

from o3dls.arrays import Array
from o3dls.geometry.surface import Surface
from o3dls.topology.observation import Measured, Noise, observe
from o3dls.topology.wall import Wall

SIGMA = 0.8
SEED = 141_421


def body(dimension: int) -> Surface:
    return meshed(round_distance(20.0), 22.0, 1.5) if dimension == 3 else circle(20.0, 240)


def seen(surface: Surface, points: Array, sigma: float = SIGMA, inside: Array | None = None) -> Measured:
    one_sided = np.zeros(len(points), dtype=bool) if inside is None else inside
    return observe(Wall(surface), points, one_sided, np.ones(len(points)), Noise(sigma, 0.05))


def test_given_noise_of_single_points_is_used() -> None:
    surface = body(3)
    points = around(surface, 20.0, 50)
    relative = np.where(np.arange(50) < 10, 3.0, 1.0)
    measured = observe(Wall(surface), points, np.zeros(50, dtype=bool), relative, Noise(SIGMA, 0.05))
    assert (measured.likelihood.sigma[:10] == 3.0 * SIGMA).all()
    assert (measured.likelihood.sigma[10:] == SIGMA).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_curvature_bias_is_what_noise_adds(dimension: int) -> None:
    """On a sphere of radius r the mean distance of noisy points is s^2 (d - 1) / 2r; single facets are not
    round.
    """
    surface = body(dimension)
    sigma = 2.0
    measured = seen(surface, sampled(surface, 200, sigma, SEED), sigma)
    assert measured.bias.mean() == pytest.approx(0.5 * sigma**2 * (dimension - 1) / 20.0, rel=0.12)


def around(surface: Surface, radii: Array | float, count: int, seed: int = 5) -> Array:
    """Points (n, 3) at distances `radii` from the middle of a ball."""
    way = sampled(surface, count, 0.0, seed)
    return np.asarray(
        way / np.linalg.norm(way, axis=1, keepdims=True) * np.broadcast_to(radii, count)[:, None]
    )


def test_unknown_noise_is_the_spread_of_the_points_at_the_wall() -> None:
    surface = body(3)
    rng = np.random.default_rng(3)
    points = np.vstack(
        [around(surface, 20.0 + 0.7 * rng.normal(size=2000), 2000), around(surface, 10.0, 1000)]
    )
    inside = np.arange(3000) >= 2000
    found = observe(Wall(surface), points, inside, np.ones(3000), Noise(None, 0.08))
    assert found.likelihood.sigma[0] == pytest.approx(0.7, rel=0.06)
    assert (found.bias[found.likelihood.one_sided] == 0.0).all()


def test_the_bias_of_a_bent_wall_is_bounded() -> None:
    found = seen(body(3), around(body(3), 20.0, 50), 40.0)
    assert found.bias.max() <= 0.5 * 40.0 * 0.6 + 1e-9


@pytest.mark.parametrize(("share", "taken"), [(0.0, 0.0), (0.001, 0.02), (0.1, 0.1), (1.0, 0.3)])
def test_a_share_of_outliers_is_taken_within_bounds(share: float, taken: float) -> None:
    surface = body(3)
    found = observe(
        Wall(surface),
        around(surface, 20.0, 50),
        np.zeros(50, dtype=bool),
        np.ones(50),
        Noise(1.0, share),
    )
    assert found.likelihood.contact.outlier_fraction == taken


def test_a_crowd_that_is_outweighed_is_heard_as_one() -> None:
    surface = body(3)
    crowd = [
        [0.0, 0.0, 22.0],
        [0.3, 0.0, 22.0],
        [0.0, 0.0, 19.0],
        [1.0, 0.0, 19.0],
        [0.0, 1.0, 19.0],
        [1.0, 1.0, 18.0],
    ]
    found = seen(surface, np.vstack([around(surface, 20.0, 50), crowd]), inside=np.arange(56) >= 50)
    assert (found.likelihood.one_sided & (found.distance > 0.0)).sum() == 1
