"""Every term of the energy against central differences; the likelihood is one; the field's prior has the
variance that it says.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import circle, meshed, round_distance

from o3dls.arrays import Array
from o3dls.levelset.grid.distance import signed_distance
from o3dls.levelset.matern_prior import MaternPrior, matern
from o3dls.noise.contact import Contact
from o3dls.noise.likelihood import Likelihood
from o3dls.noise.settings import ContactSettings

STEP = 1e-5
CONTACT = Contact.expected(25.0, ContactSettings(depth=0.6, scatter=1.2))


def likelihood(one_sided: bool = False) -> Likelihood:
    sigma = np.array([0.8, 1.0, 1.5, 2.0, 1.2, 0.9])
    return Likelihood(sigma, CONTACT, np.full(6, one_sided))


def roughness(dimension: int, length: float = 8.0) -> MaternPrior:
    surface = meshed(round_distance(12.0), 14.0, 1.0, 3) if dimension == 3 else circle(12.0, 300)
    band = signed_distance(surface.vertices, surface.faces, length / 4.0, length / 2.0).band
    return MaternPrior.on(band, length, 0.7)


@pytest.mark.parametrize("one_sided", [False, True])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_slope_of_the_loss(one_sided: bool, side: float) -> None:
    noise = likelihood(one_sided)
    distance = side * np.array([0.1, 0.7, 2.0, 4.0, 9.0, 0.4])
    central = (noise.loss(distance + STEP) - noise.loss(distance - STEP)) / (2.0 * STEP)
    np.testing.assert_allclose(noise.slope(distance), central, atol=1e-8)


@pytest.mark.parametrize("one_sided", [False, True])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_loss_and_weight_are_those_of_the_mixture(one_sided: bool, side: float) -> None:
    """Of those known to be inside, the wall's density is flat there, and outliers are nowhere likelier."""
    noise = likelihood(one_sided)
    distance = side * np.array([0.1, 0.7, 2.0, 4.0, 90.0, 0.4])
    off = np.zeros(6) if one_sided and side < 0.0 else distance
    touching = np.exp(-0.5 * (off / noise.sigma) ** 2) / np.sqrt(2.0 * np.pi * noise.sigma**2)
    density = np.full(6, CONTACT.anywhere) if one_sided else CONTACT.outlier_density(distance)
    wall, floating = (1.0 - CONTACT.outlier_fraction) * touching, CONTACT.outlier_fraction * density
    np.testing.assert_allclose(noise.loss(distance), -np.log(wall + floating), rtol=1e-12)
    np.testing.assert_allclose(noise.weight(distance), wall / (wall + floating), rtol=1e-12, atol=1e-300)


def test_loss_is_a_normalised_density_but_for_the_reach_of_outliers() -> None:
    s = np.linspace(-15.0, 30.0, 90001)
    noise = Likelihood(np.full(len(s), 1.3), CONTACT, np.zeros(len(s), dtype=bool))
    # a uniform density over 15 inside and 30 anywhere
    assert np.trapezoid(np.exp(-noise.loss(s)), s) == pytest.approx(1.0, abs=0.02)


def test_points_inside_only_are_free_inside_and_pay_outside() -> None:
    noise = likelihood(one_sided=True)
    assert (noise.slope(np.full(6, -7.0)) == 0.0).all()
    assert (noise.loss(np.full(6, -7.0)) == noise.loss(np.full(6, -0.1))).all()
    assert (noise.loss(np.full(6, 2.0)) > noise.loss(np.full(6, 0.5))).all()


def test_where_every_point_is_believed_none_is_too_far() -> None:
    believing = replace(likelihood(), contact=replace(CONTACT, outlier_fraction=0.0))
    distance = np.array([-1e4, -100.0, -1.0, 0.0, 1.0, 1e4])
    np.testing.assert_array_equal(believing.weight(distance), 1.0)
    np.testing.assert_allclose(
        believing.loss(distance) - believing.loss(np.zeros(6)), 0.5 * (distance / believing.sigma) ** 2
    )
    np.testing.assert_allclose(believing.slope(distance), distance / believing.sigma**2)


def test_inner_outliers_are_likelier_than_outer_ones() -> None:
    noise = likelihood()
    assert (noise.weight(np.full(6, -6.0)) < 0.5 * noise.weight(np.full(6, 6.0))).all()
    assert (noise.weight(np.zeros(6)) > 0.95).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_slope_of_the_roughness(dimension: int) -> None:
    prior = roughness(dimension)
    rng = np.random.default_rng(602_214)
    f = rng.normal(size=len(prior.band))
    for _ in range(5):
        way = rng.normal(size=len(f))
        central = (prior.energy(f + STEP * way) - prior.energy(f - STEP * way)) / (2.0 * STEP)
        assert prior.slope(f) @ way == pytest.approx(central, rel=1e-7)


@pytest.mark.parametrize(("dimension", "tolerance"), [(2, 0.15), (3, 0.2)])
def test_field_has_the_variance_and_correlation_of_a_matern_field(dimension: int, tolerance: float) -> None:
    """The band has stairs for a border and four nodes in a length: a fifth of the standard deviation is what
    that costs.
    """
    prior = roughness(dimension)
    covariance = np.linalg.inv((prior.operator.T @ prior.operator).toarray() / prior.amplitude**2)
    rng = np.random.default_rng(271_828)
    points = rng.normal(size=(60, dimension))
    points *= 12.0 / np.linalg.norm(points, axis=1, keepdims=True)
    at = prior.band.interpolation(points)
    on_surface = at @ covariance @ at.T
    assert np.sqrt(np.diag(on_surface).mean()) == pytest.approx(prior.amplitude, rel=tolerance)
    arc = 12.0 * np.arccos(np.clip(points @ points.T / 144.0, -1.0, 1.0))
    expected = matern(arc, prior.length, dimension)
    scale = np.sqrt(np.outer(np.diag(on_surface), np.diag(on_surface)))
    assert np.abs(on_surface / scale - expected).max() < 0.15


def test_matern_falls_to_an_eighth_at_its_length() -> None:
    for dimension in (2, 3):
        assert matern(np.array([0.0]), 5.0, dimension)[0] == pytest.approx(1.0, abs=1e-6)
        assert 0.1 < matern(np.array([5.0]), 5.0, dimension)[0] < 0.15


def test_evidence_picks_the_field_that_made_the_residuals() -> None:
    from o3dls.levelset.residual_field import residual_field

    rng = np.random.default_rng(314_159)
    feet = rng.normal(size=(300, 3))
    feet *= 25.0 / np.linalg.norm(feet, axis=1, keepdims=True)
    gaps = np.linalg.norm(feet[:, None] - feet[None], axis=2)
    field = np.linalg.cholesky(matern(gaps, 20.0, 3) + 1e-9 * np.eye(300)) @ rng.normal(size=300)
    sigma, weight = np.ones(300), np.ones(300)

    def gain(residual: Array, length: float) -> float:
        return residual_field(feet, residual, weight, sigma, 0.25, length).gain

    found = residual_field(feet, 2.0 * field + rng.normal(size=300), weight, sigma, 0.25, 20.0)
    assert found.gain > 20.0
    assert 1.2 < found.amplitude < 3.0
    assert 0.8 < found.noise < 1.2
    silent = rng.normal(size=300)
    assert max(gain(silent, length) for length in (10.0, 20.0, 40.0)) < 3.0
