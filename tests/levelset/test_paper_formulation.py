"""The paper's energy: its slopes, its descent, and what it is known for."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import circle, meshed, round_distance, sampled, whole_box

from o3dls.geometry.components import components_and_euler
from o3dls.geometry.surface import Surface
from o3dls.levelset.grid.distance import SignedDistance, signed_distance
from o3dls.levelset.grid.isosurface import zero_set
from o3dls.levelset.grid.operators import delta, heaviside, mean_curvature
from o3dls.levelset.paper import DEFAULTS, Weights, _make_steps, _on_band, descend, energies
from o3dls.levelset.settings import PaperSettings

SEED = 244_948


def energy_of(field: SignedDistance, phi: np.ndarray, points: np.ndarray, weights: Weights) -> float:
    shape = heaviside(round_distance(7.0)(field.band.positions), DEFAULTS.delta_width * field.band.spacing)
    return energies(SignedDistance(field.band, phi, field.face), shape, points, 1.0, weights)["energy"]


@pytest.mark.parametrize("term", ["data", "area", "shape"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_flow_is_minus_the_slope_of_the_energy(term: str, dimension: int) -> None:
    """Each term of (16) against central differences along smooth directions; area by the law that it shrinks
    with its curvature.
    """
    h = 0.5 if dimension == 3 else 0.25
    band, phi = whole_box(round_distance(6.0), 9.0, h, dimension)
    field = SignedDistance(band, phi, np.zeros(len(band), dtype=np.int32))
    points = np.random.default_rng(SEED).normal(size=(20, dimension)) * 4.0
    weights = Weights(**{name: 1.0 if name == term else 0.0 for name in ("data", "area", "shape")})
    way = np.cos(band.positions @ np.full(dimension, 0.2))
    step = 1e-4
    central = (
        energy_of(field, phi + step * way, points, weights)
        - energy_of(field, phi - step * way, points, weights)
    ) / (2.0 * step)
    reach = DEFAULTS.delta_width * h
    cell = h**dimension
    shape = heaviside(round_distance(7.0)(band.positions), reach)
    at = band.interpolation(points)
    slope = {
        "data": 2.0 * at.T @ (at @ phi),
        "area": -mean_curvature(band, phi) * delta(phi, reach) * cell,
        "shape": 2.0 * (heaviside(phi, reach) - shape) * delta(phi, reach) * cell,
    }[term]
    # (16) has the exact variation of the area, the energy its discretisation, which averages over few nodes
    # along a curve
    tolerance = {2: 0.15, 3: 0.02}[dimension] if term == "area" else 1e-6
    assert slope @ way == pytest.approx(central, rel=tolerance)


@pytest.mark.parametrize(
    "surface", [circle(20.0, 300), meshed(round_distance(14.0), 18.0, 1.0)], ids=["2D", "3D"]
)
def test_energy_falls_and_data_pull_the_wall(surface: Surface) -> None:
    radius = np.linalg.norm(surface.vertices, axis=1).mean()
    points = sampled(surface, 150, 0.1, SEED) * (1.0 + 1.0 / radius)  # one spacing outside
    found = descend(surface, points, 1.0, Weights(), spacing=1.0, cycles=15)
    energy = [record["energy"] for record in found.trace]
    assert energy[-1] < 0.5 * energy[0]
    assert found.converged == ("converged" in found.status)
    assert energy[0] == pytest.approx(sum(found.trace[0][name] for name in ("data", "area", "shape")))
    psi = signed_distance(surface.vertices, surface.faces, 1.0, 3.0)
    before = np.abs(psi.band.interpolation(points) @ psi.phi).mean()
    assert np.abs(found.phi.band.interpolation(points) @ found.phi.phi).mean() < 0.5 * before


def test_without_data_and_area_the_prior_stays() -> None:
    surface = meshed(round_distance(14.0), 18.0, 1.0)
    found = descend(
        surface, sampled(surface, 50, 0.1, SEED), 1.0, Weights(0.0, 0.0, 1.0), spacing=1.0, cycles=5
    )
    vertices, _ = zero_set(found.phi.band, found.phi.phi)
    assert np.abs(np.linalg.norm(vertices, axis=1) - 14.0).max() < 0.1  # chord error


def test_area_alone_shrinks_a_sphere() -> None:
    surface = meshed(round_distance(14.0), 18.0, 1.0)
    found = descend(surface, surface.vertices[:20], 1.0, Weights(0.0, 1.0, 0.0), spacing=1.0, cycles=5)
    assert Surface(*zero_set(found.phi.band, found.phi.phi)).volume < 0.97 * surface.volume


def test_it_says_its_islands_and_the_points_without_effect() -> None:
    surface = meshed(round_distance(14.0), 18.0, 1.0)
    far = np.array([[0.0, 0.0, 40.0], [0.0, 2.0, 0.0], [30.0, 0.0, 0.0]])
    points = np.vstack([sampled(surface, 100, 1.8, SEED), far])
    found = descend(surface, points, 1.0, Weights(100.0, 0.05, 0.3), spacing=1.0, cycles=15)
    count = components_and_euler(*zero_set(found.phi.band, found.phi.phi))[0]
    assert found.facts == {"components": count, "points_outside_band": 3}
    assert f"{count} component" in found.status
    assert "3 points outside the band" in found.status
    assert found.islands


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_step_for_the_points_goes_down_their_energy_at_any_spacing_and_noise(dimension: int) -> None:
    h = 0.5
    sigma = 2.0
    weights = Weights(10.0, 0.0, 100.0)
    band, phi = whole_box(round_distance(6.0), 9.0, h, dimension)
    field = SignedDistance(band, phi, np.zeros(len(band), dtype=np.int32))
    way = np.random.default_rng(1).normal(size=(8, dimension))
    points = 6.3 * way / np.linalg.norm(way, axis=1)[:, None]
    shape = heaviside(phi, DEFAULTS.delta_width * h)
    step = h * DEFAULTS.delta_width * h / (2.0 * weights.shape)
    after = _make_steps(field, shape, points, sigma, weights, PaperSettings(steps=1))
    at = int(np.argmax(np.abs(after - phi)))

    def data(change: float) -> float:
        moved = after + change * (np.arange(len(band)) == at)
        return float(energies(SignedDistance(band, moved, field.face), shape, points, sigma, weights)["data"])

    slope = (data(1e-5) - data(-1e-5)) / 2e-5
    assert (after - phi)[at] == pytest.approx(-step * slope / h**dimension, rel=0.1)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("radius", [5.5, 6.5])
def test_the_shape_term_alone_draws_the_surface_towards_the_prior(radius: float, dimension: int) -> None:
    band, phi = whole_box(round_distance(6.0), 9.0, 0.5, dimension)
    field = SignedDistance(band, phi, np.zeros(len(band), dtype=np.int32))
    shape = heaviside(round_distance(radius)(band.positions), DEFAULTS.delta_width * 0.5)
    on_the_wall = np.full((1, dimension), 6.0 / dimension**0.5)
    moved = (
        _make_steps(field, shape, on_the_wall, 1.0, Weights(0.0, 0.0, 1.0), PaperSettings(steps=3)) - phi
    )[np.abs(phi) < 0.5]
    assert (moved * (6.0 - radius) >= 0.0).all()
    assert np.abs(moved).max() > 0.01


def test_beyond_its_band_a_prior_is_far_inside_or_far_outside() -> None:
    small, large = (
        signed_distance(s.vertices, s.faces, 1.0, 3.0)
        for s in (meshed(round_distance(r), r + 3.0) for r in (10.0, 16.0))
    )
    assert (_on_band(small, large.band) == 3.0).all()
    assert (_on_band(large, small.band) == -3.0).all()
