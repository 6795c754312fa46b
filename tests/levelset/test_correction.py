"""Refinement: nothing to do leaves the wall; what the prior lacks is found; the energy never rises; grid,
pose and scale do not matter.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import circle, meshed, round_distance, sampled

from o3dls.arrays import Array
from o3dls.geometry.surface import Surface
from o3dls.levelset.correction import Limits, _lengths, fit_correction
from o3dls.levelset.descent import Level, _newton
from o3dls.levelset.normal_displacement import Wall
from o3dls.levelset.observation import Measured, Noise, observe
from o3dls.levelset.residual_field import residual_field
from o3dls.levelset.settings import CorrectionSettings

SIGMA = 0.8
SEED = 141_421


def bump(directions: Array) -> Array:
    """3 outward at one pole, 2 inward at another."""
    pole, other = np.eye(directions.shape[1])[-1], np.eye(directions.shape[1])[0]
    return 3.0 * np.exp(-((directions - pole) ** 2).sum(axis=1) / 0.25) - 2.0 * np.exp(
        -((directions - other) ** 2).sum(axis=1) / 0.2
    )


def body(dimension: int) -> Surface:
    return meshed(round_distance(20.0), 22.0, 1.5) if dimension == 3 else circle(20.0, 240)


def seen(surface: Surface, points: Array, sigma: float = SIGMA, inside: Array | None = None) -> Measured:
    one_sided = np.zeros(len(points), dtype=bool) if inside is None else inside
    return observe(Wall(surface), points, one_sided, np.ones(len(points)), Noise(sigma, 0.25, 0.05))


def bumpy_points(dimension: int, count: int, outliers: int = 0) -> Array:
    rng = np.random.default_rng(SEED)
    n = rng.normal(size=(count, dimension))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    points = n * (20.0 + bump(n))[:, None] + SIGMA * rng.normal(size=n.shape)
    points[:outliers] *= 0.6
    return points


def error(surface: Surface, u: Array) -> float:
    directions = surface.vertices / np.linalg.norm(surface.vertices, axis=1, keepdims=True)
    return float(np.sqrt(((u - bump(directions)) ** 2).mean()))


@pytest.mark.parametrize("dimension", [2, 3])
def test_noise_alone_leaves_the_wall_exactly_where_it_is(dimension: int) -> None:
    surface = body(dimension)
    points = sampled(surface, 300, SIGMA, SEED)
    found = fit_correction(Wall(surface), seen(surface, points), np.ones(len(surface.vertices)), Limits(1.0))
    assert (found.u == 0.0).all()
    assert found.fields == ()
    assert "no correction needed" in found.status


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_the_prior_lacks_is_found_and_the_energy_never_rises(dimension: int) -> None:
    surface = body(dimension)
    points = bumpy_points(dimension, 800, outliers=40)
    found = fit_correction(Wall(surface), seen(surface, points), np.ones(len(surface.vertices)), Limits(0.5))
    assert found.converged
    assert error(surface, found.u) < 0.5 * error(surface, np.zeros(len(found.u)))
    energy = np.array([record["energy"] for record in found.trace])
    starts = np.array([record["iteration"] == 0 for record in found.trace])
    assert (np.diff(energy)[~starts[1:]] <= 1e-9).all()
    for record in found.trace:
        assert record["energy"] == pytest.approx(record["data"] + record["prior"])


def test_without_coarse_to_fine_only_the_shortest_length_is_tried() -> None:
    surface = body(3)
    seen_ = seen(surface, bumpy_points(3, 400))
    both, fine = (
        fit_correction(Wall(surface), seen_, np.ones(len(surface.vertices)), Limits(0.5, coarse_to_fine=x))
        for x in (True, False)
    )
    lengths = [{field.length for field in found.fields} for found in (both, fine)]
    assert len(lengths[1]) <= 1
    assert max(lengths[0]) > max(lengths[1], default=0.0)


def test_more_points_find_it_better() -> None:
    surface = body(3)
    errors = []
    for count in (200, 800, 3200):
        found = fit_correction(
            Wall(surface), seen(surface, bumpy_points(3, count)), np.ones(len(surface.vertices)), Limits(0.5)
        )
        errors.append(error(surface, found.u))
    assert errors[0] > errors[1] > errors[2]


def test_turn_shift_and_scale_carry_the_correction_along() -> None:
    """Lattices differ by the turn, so the fields differ by what their discretisation costs: a tenth of a
    noise level.
    """
    surface = body(3)
    points = bumpy_points(3, 600)
    ones = np.ones(len(surface.vertices))
    plain = fit_correction(Wall(surface), seen(surface, points), ones, Limits(0.5)).u
    a, b = np.deg2rad(37.0), np.deg2rad(71.0)
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]) @ np.array(
        [[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]]
    )
    moved = surface.with_vertices(1.7 * surface.vertices @ turn.T + [3.3, -8.1, 40.2])
    inside = np.zeros(len(points), dtype=bool)
    even = np.ones(len(points))
    measured = observe(
        Wall(moved), 1.7 * points @ turn.T + [3.3, -8.1, 40.2], inside, even, Noise(1.7 * SIGMA, 0.25, 0.05)
    )
    other = fit_correction(Wall(moved), measured, ones, Limits(0.85)).u / 1.7
    assert np.sqrt(((other - plain) ** 2).mean()) < 0.1 * SIGMA
    assert np.abs(other - plain).max() < 0.5 * SIGMA


def test_prior_holds_where_the_motion_is_certain() -> None:
    surface = body(3)
    points = bumpy_points(3, 600)
    top = surface.vertices[:, 2] > 0.0
    doubt = np.where(top, 0.5, 2.0)
    even = fit_correction(Wall(surface), seen(surface, points), np.ones(len(top)), Limits(0.5)).u
    held = fit_correction(Wall(surface), seen(surface, points), doubt, Limits(0.5)).u
    assert np.abs(held[top]).mean() < np.abs(even[top]).mean()


def test_a_crowd_of_noisy_points_inside_asks_for_no_correction() -> None:
    """The outermost lie beyond the wall, where the noise has put them: each heard, they held a field of 0.2
    mm.
    """
    surface = body(3)
    rng = np.random.default_rng(SEED)
    wall = sampled(surface, 300, SIGMA, SEED)
    crowd = sampled(surface, 1500, SIGMA, SEED + 1)
    crowd *= 1.0 - rng.uniform(0.0, 3.0, len(crowd))[:, None] / 20.0
    measured = seen(surface, np.vstack([wall, crowd]), SIGMA, np.arange(1800) >= 300)
    assert fit_correction(Wall(surface), measured, np.ones(len(surface.vertices)), Limits(1.0)).fields == ()


def test_points_inside_only_push_the_wall_out_but_never_pull_it_in() -> None:
    """The wall has points everywhere but round one pole, where points inside say how far it must reach at
    least.
    """
    surface = body(3)
    wall = sampled(surface, 500, SIGMA, SEED)
    wall = wall[wall[:, 2] < 14.0]
    pole = np.array([0.0, 0.0, 1.0])
    rng = np.random.default_rng(SEED)
    near = pole + 0.2 * rng.normal(size=(60, 3))
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    inside = np.arange(len(wall) + 60) >= len(wall)
    reached = {}
    for radius in (12.0, 22.0):
        measured = seen(surface, np.vstack([wall, radius * near]), SIGMA, inside)
        found = fit_correction(Wall(surface), measured, np.ones(len(surface.vertices)), Limits(0.5))
        reached[radius] = found.u[np.argmax(surface.vertices @ pole)]
    assert reached[12.0] == 0.0
    assert reached[22.0] > 1.0


def test_given_noise_of_single_points_is_used() -> None:
    surface = body(3)
    points = bumpy_points(3, 50)
    relative = np.where(np.arange(50) < 10, 3.0, 1.0)
    measured = observe(Wall(surface), points, np.zeros(50, dtype=bool), relative, Noise(SIGMA, 0.25, 0.05))
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


def test_wall_sees_its_own_moves() -> None:
    surface = body(3)
    wall = Wall(surface)
    wall.move(np.full(len(surface.vertices), 1.5))
    distance, _, _ = wall.look(np.array([[0.0, 0.0, 24.0], [0.0, 19.0, 0.0]]))
    np.testing.assert_allclose(distance, [2.5, -2.5], atol=0.03)  # chord error of the facets


def test_equal_inputs_give_equal_corrections() -> None:
    surface = body(3)
    points = bumpy_points(3, 400)
    first, second = (
        fit_correction(Wall(surface), seen(surface, points), np.ones(len(surface.vertices)), Limits(0.5))
        for _ in range(2)
    )
    assert (first.u == second.u).all()
    assert replace(first, u=second.u).trace == second.trace


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
    found = observe(Wall(surface), points, inside, np.ones(3000), Noise())
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
        Noise(1.0, outlier_fraction=share),
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


def scattered() -> tuple[Array, Array]:
    """Feet (200, 3) on a ball and residuals of unit noise."""
    rng = np.random.default_rng(314)
    feet = rng.normal(size=(200, 3))
    return feet * 25.0 / np.linalg.norm(feet, axis=1, keepdims=True), rng.normal(size=200)


def test_points_of_more_noise_hide_no_field() -> None:
    feet, residual = scattered()
    sigma = np.where(np.arange(200) < 60, 4.0, 1.0)
    found = residual_field(feet, sigma * residual, np.ones(200), sigma, 0.5, 20.0)
    assert found.noise == pytest.approx(1.0, rel=0.15)
    assert found.gain < 3.0


def test_noise_that_is_known_is_kept_and_doubtful_noise_is_found() -> None:
    feet, residual = scattered()
    known, doubtful = (
        residual_field(feet, 1.5 * residual, np.ones(200), np.ones(200), doubt, 20.0).noise
        for doubt in (0.01, 0.5)
    )
    assert known == pytest.approx(1.0, rel=0.06)
    assert doubtful > 1.3


def test_no_field_is_finer_than_the_points_stand_apart() -> None:
    surface = body(3)
    assert min(
        _lengths(Wall(surface), seen(surface, around(surface, 20.0, 12)), 0.1, CorrectionSettings())
    ) >= np.sqrt(surface.area / 12)


@pytest.mark.parametrize("sigma", [0.2, 3.0])
def test_the_step_goes_to_the_least_energy_on_its_way(sigma: float) -> None:
    surface = body(3)
    wall = Wall(surface)
    measured = seen(surface, around(surface, 20.3, 300), sigma)
    level = Level.of(surface, np.ones(len(surface.vertices)), 12.0, CorrectionSettings()).of_amplitude(1.0)

    def energy(f: Array) -> float:
        wall.move(level.to_vertices @ f)
        return float(
            measured.likelihood.loss(wall.look(measured.points)[0] - measured.bias).sum()
            + level.prior.energy(f)
        )

    start = np.zeros(level.to_vertices.shape[1])
    energy(start)
    step = _newton(wall, level, measured, start, CorrectionSettings())
    short, whole, long = (energy(share * step) for share in (0.8, 1.0, 1.2))
    assert whole < min(short, long)
