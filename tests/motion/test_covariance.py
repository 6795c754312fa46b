"""Gram matrix, cross-covariance, displacement and variance are four views of one covariance, and a plain loop
is its definition.
"""

import numpy as np
import pytest
from fields import SIZE, body, covariance, spots

from o3dls.arrays import Array
from o3dls.motion.field.covariance import (
    Covariance,
    FieldPrior,
    Observed,
    Places,
    grams,
    interpolation,
)

DIMENSIONS = pytest.mark.parametrize(
    ("dimension", "anchors"),
    [(2, 0), (2, 2), (3, 0), (3, 4)],
)
ROUNDING = 1e-9


def observations(dimension: int, count: int, seed: int) -> Observed:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, dimension))
    at = spots(body(dimension), count, seed)[0]
    return Observed(at, directions / np.linalg.norm(directions, axis=1)[:, None], rng.uniform(-1, 1, count))


def deviations(cov: Covariance) -> Array:
    return np.array([1.5, 0.7, 0.11, 0.06] + [2.0] * (len(cov.anchors) > 0))


def by_definition(cov: Covariance, sds: Array, a: Observed, b: Observed, i: int, j: int) -> float:
    """Covariance of one pair of observations, written out term by term."""
    dim = len(cov.centre)
    x = a.at[i] - cov.centre
    y = b.at[j] - cov.centre
    n = a.directions[i]
    m = b.directions[j]
    r = float(np.linalg.norm(x - y))

    def matern(length: float, apart: float = r) -> float:
        s = 5**0.5 * apart / length
        return float((1 + s + s * s / 3) * np.exp(-s))

    total = cov.translation**2 * n @ m + cov.scale**2 * (n @ x) * (m @ y)
    for p in range(dim):
        for q in range(dim):
            unit = np.zeros((dim, dim))
            unit[p, q] = 1.0
            if p < q:
                turning = (n @ (unit - unit.T) @ x) * (m @ (unit - unit.T) @ y)
                total += (cov.rotation**2 + sds[2] ** 2 * (x @ y) / cov.radius**2) * turning
            # symmetric traceless matrices: all symmetric ones less the trace's share; sum over an orthonormal
            # basis times sqrt(2)
            sym = (unit + unit.T) / 2 - np.eye(dim) * (p == q) / dim
            total += 2.0 * sds[3] ** 2 * (n @ sym @ x) * (m @ sym @ y)
    total += sds[0] ** 2 * matern(cov.vector[0]) * n @ m
    total += sds[1] ** 2 * matern(cov.normal[0]) * a.normal_part[i] * b.normal_part[j]
    for anchor in cov.anchors:
        apart = [float(np.linalg.norm(at - anchor)) for at in (a.at[i], b.at[j])]
        reach = [matern(cov.anchor_length, one) for one in apart]
        total += sds[-1] ** 2 * reach[0] * reach[1] * n @ m
    return float(total)


@DIMENSIONS
def test_covariance_between_observations_is_the_definition_written_out(dimension: int, anchors: int) -> None:
    cov = covariance(dimension, anchors)
    a, b = observations(dimension, 9, 71_033), observations(dimension, 6, 20_417)
    loop = [[by_definition(cov, deviations(cov), a, b, i, j) for j in range(6)] for i in range(9)]
    np.testing.assert_allclose(
        FieldPrior(cov, deviations(cov)).between(a, b), loop, rtol=ROUNDING, atol=ROUNDING
    )


@DIMENSIONS
def test_gram_and_variance_agree_with_the_covariance(dimension: int, anchors: int) -> None:
    cov = covariance(dimension, anchors)
    obs = observations(dimension, 40, 9_187)
    sds = deviations(cov)
    prior = FieldPrior(cov, sds)
    whole = prior.between(obs, obs)
    fixed, parts = grams(cov, obs)
    np.testing.assert_allclose(
        fixed + sum(sd**2 * part for sd, part in zip(sds, parts, strict=True)),
        whole,
        rtol=ROUNDING,
        atol=ROUNDING,
    )
    np.testing.assert_allclose(prior.variance(obs), np.diag(whole), rtol=ROUNDING)
    assert np.linalg.eigvalsh(whole).min() > -1e-8 * np.linalg.eigvalsh(whole).max()


@DIMENSIONS
def test_displacement_is_the_covariance_along_every_axis(dimension: int, anchors: int) -> None:
    cov = covariance(dimension, anchors)
    obs = observations(dimension, 30, 33_871)
    prior = FieldPrior(cov, deviations(cov))
    alpha = np.random.default_rng(60_289).normal(size=30)
    surface = body(dimension)
    at, normals = surface.vertices[::11], surface.vertex_normals[::11]
    places = Places(at, normals)
    field = prior.displacement(obs, alpha, places)
    for axis in range(dimension):
        along = places.observed(np.tile(np.eye(dimension)[axis], (len(at), 1)))
        np.testing.assert_allclose(field[:, axis], prior.between(along, obs) @ alpha, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("dimension", [2, 3])
def test_interpolation_from_nodes_loses_a_hundredth_of_the_field(dimension: int) -> None:
    """Nodes at a good quarter of the correlation length, as the fit takes them."""
    from o3dls.motion.problem import space_points

    surface = body(dimension, fineness=4)
    cov = covariance(dimension)
    obs = observations(dimension, 80, 14_537)
    sds = np.array([1.0, 1.0, 1e-9, 1e-9])
    alpha = np.random.default_rng(2_741).normal(size=80)
    field = FieldPrior(cov, sds).displacement(obs, alpha, Places(surface.vertices, surface.vertex_normals))
    nodes = space_points(surface.vertices, 0.27 * 0.46 * SIZE)
    weights = interpolation(surface.vertices[nodes], surface.vertices, 0.46 * SIZE, 8)
    found = weights @ field[nodes]
    error = np.sqrt(((found - field) ** 2).sum(axis=1).mean())
    assert error < 0.01 * np.sqrt(((field - field.mean(axis=0)) ** 2).sum(axis=1).mean())
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
