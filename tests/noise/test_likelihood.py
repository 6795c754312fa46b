"""The likelihood of signed distances is that of the mixture, and a density."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from o3dls.noise.contact import Contact
from o3dls.noise.likelihood import Likelihood
from o3dls.noise.settings import ContactSettings

CONTACT = Contact.expected(25.0, ContactSettings(depth=0.6, scatter=1.2))


def likelihood(one_sided: bool = False) -> Likelihood:
    sigma = np.array([0.8, 1.0, 1.5, 2.0, 1.2, 0.9])
    return Likelihood(sigma, CONTACT, np.full(6, one_sided))


@pytest.mark.parametrize("one_sided", [False, True])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_loss_is_that_of_the_mixture(one_sided: bool, side: float) -> None:
    """Of those known to be inside, the wall's density is flat there, and outliers are nowhere likelier."""
    noise = likelihood(one_sided)
    distance = side * np.array([0.1, 0.7, 2.0, 4.0, 90.0, 0.4])
    off = np.zeros(6) if one_sided and side < 0.0 else distance
    touching = np.exp(-0.5 * (off / noise.sigma) ** 2) / np.sqrt(2.0 * np.pi * noise.sigma**2)
    density = np.full(6, CONTACT.anywhere) if one_sided else CONTACT.outlier_density(distance)
    wall, floating = (1.0 - CONTACT.outlier_fraction) * touching, CONTACT.outlier_fraction * density
    np.testing.assert_allclose(noise.loss(distance), -np.log(wall + floating), rtol=1e-12)


def test_loss_is_a_normalised_density_but_for_the_reach_of_outliers() -> None:
    s = np.linspace(-15.0, 30.0, 90001)
    noise = Likelihood(np.full(len(s), 1.3), CONTACT, np.zeros(len(s), dtype=bool))
    # a uniform density over 15 inside and 30 anywhere
    assert np.trapezoid(np.exp(-noise.loss(s)), s) == pytest.approx(1.0, abs=0.02)


def test_points_inside_only_are_free_inside_and_pay_outside() -> None:
    noise = likelihood(one_sided=True)
    assert (noise.loss(np.full(6, -7.0)) == noise.loss(np.full(6, -0.1))).all()
    assert (noise.loss(np.full(6, 2.0)) > noise.loss(np.full(6, 0.5))).all()


def test_where_every_point_is_believed_none_is_too_far() -> None:
    believing = replace(likelihood(), contact=replace(CONTACT, outlier_fraction=0.0))
    distance = np.array([-1e4, -100.0, -1.0, 0.0, 1.0, 1e4])
    np.testing.assert_allclose(
        believing.loss(distance) - believing.loss(np.zeros(6)), 0.5 * (distance / believing.sigma) ** 2
    )


def test_inner_outliers_are_likelier_than_outer_ones() -> None:
    noise = likelihood()
    assert (noise.loss(np.full(6, -60.0)) < noise.loss(np.full(6, 60.0)) - 1.0).all()
