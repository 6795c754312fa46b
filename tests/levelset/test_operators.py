"""Operators on a band against analytic shapes, with their order; the zero set closed, outward and second
order; the box filled right.
"""

from __future__ import annotations

import numpy as np
import pytest
from shapes import ball_with_tube, meshed, round_distance, torus_distance, whole_box

from o3dls.geometry.components import component_labels, largest_component
from o3dls.geometry.surface import Surface
from o3dls.levelset.grid.band import Band
from o3dls.levelset.grid.distance import SignedDistance, signed_distance
from o3dls.levelset.grid.isosurface import reinitialise, zero_set
from o3dls.levelset.grid.operators import combine, delta, gradient, heaviside, mean_curvature


def orders(errors: list[float]) -> np.ndarray:
    return np.log2(np.array(errors[:-1]) / errors[1:])


@pytest.mark.parametrize("dimension", [2, 3])
def test_curvature_of_a_sphere_is_of_second_order(dimension: int) -> None:
    errors = []
    for spacing in (1.0, 0.5, 0.25):
        band, phi = whole_box(round_distance(6.0), 8.0, spacing, dimension)
        near = np.abs(phi) < 0.5
        exact = (dimension - 1) / np.linalg.norm(band.positions[near], axis=1)
        errors.append(float(np.abs(mean_curvature(band, phi)[near] - exact).max()))
    assert (orders(errors) > 1.6).all(), errors


def test_curvature_kernel_equals_the_plain_loop() -> None:
    band, phi = whole_box(lambda p: torus_distance(5.0, 2.0)(p) + 0.1 * np.sin(p[:, 0]), 8.0, 0.5)
    box = phi.reshape(band.shape)
    h = 0.5
    first = np.gradient(box, h)
    curvature = mean_curvature(band, phi).reshape(band.shape)
    for at in [(9, 12, 15), (20, 16, 18), (16, 25, 14)]:
        i = np.array(at)
        g = np.array([f[at] for f in first])
        hessian = np.empty((3, 3))
        for a in range(3):
            for b in range(3):
                ea, eb = np.eye(3, dtype=int)[a], np.eye(3, dtype=int)[b]
                if a == b:
                    hessian[a, a] = (box[tuple(i + ea)] - 2 * box[at] + box[tuple(i - ea)]) / h**2
                else:
                    corners = [s * t * box[tuple(i + s * ea + t * eb)] for s in (1, -1) for t in (1, -1)]
                    hessian[a, b] = sum(corners) / (4 * h**2)
        plain = (np.trace(hessian) * g @ g - g @ hessian @ g) / (g @ g) ** 1.5
        assert curvature[at] == pytest.approx(plain, abs=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_gradient_of_a_distance_has_length_one_and_points_outward(dimension: int) -> None:
    band, phi = whole_box(round_distance(6.0), 8.0, 0.25, dimension)
    near = np.abs(phi) < 1.0
    outward = band.positions[near] / np.linalg.norm(band.positions[near], axis=1, keepdims=True)
    # h^2 / 6 of the third derivative
    np.testing.assert_allclose(gradient(band, phi)[near], outward, atol=0.002)


def test_delta_is_the_slope_of_heaviside_and_integrates_to_one() -> None:
    s = np.linspace(-2.0, 2.0, 4001)
    assert np.trapezoid(delta(s, 1.5), s) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(np.gradient(heaviside(s, 1.5), s)[1:-1], delta(s, 1.5)[1:-1], atol=1e-5)
    assert heaviside(np.array([-9.0, 0.0, 9.0]), 1.5) == pytest.approx([0.0, 0.5, 1.0], abs=1e-15)


@pytest.mark.parametrize(
    ("distance", "dimension"),
    [(round_distance(6.0), 2), (round_distance(6.0), 3), (torus_distance(5.0, 2.0), 3)],
)
def test_zero_set_is_closed_outward_and_of_second_order(distance, dimension: int) -> None:  # type: ignore[no-untyped-def]
    errors = []
    for spacing in (1.0, 0.5, 0.25):
        surface = meshed(distance, 8.0, spacing, dimension)
        assert surface.watertight
        assert surface.volume > 0.0
        errors.append(float(np.abs(distance(surface.vertices)).max()))
    assert (orders(errors) > 1.6).all(), errors


def test_zero_set_survives_nodes_that_lie_on_it() -> None:
    band, phi = whole_box(lambda p: np.abs(p).max(axis=1) - 3.0, 6.0, 1.0)
    surface = Surface(*zero_set(band, phi))
    assert surface.watertight
    assert 5.0**3 < surface.volume <= 6.0**3  # linear on the simplices, some of which cut the corners


@pytest.mark.parametrize("dimension", [2, 3])
def test_reinitialise_restores_the_distance_and_leaves_one_alone(dimension: int) -> None:
    true = signed_distance(*_mesh(dimension), 0.5, 1.5)
    for distorted in (true.phi, true.phi * (2.0 + np.sin(true.band.positions[:, 0]))):
        again = reinitialise(true.band, distorted)
        shared = true.band.find(again.band.nodes + (again.band.low - true.band.low))
        near = (shared >= 0) & (np.abs(again.phi) < 1.0)
        # h^2 / 8 of the curvature, and of the sine
        np.testing.assert_allclose(again.phi[near], true.phi[shared[near]], atol=0.06)


def _mesh(dimension: int) -> tuple[np.ndarray, np.ndarray]:
    surface = meshed(round_distance(6.0), 8.0, 0.25, dimension)
    return surface.vertices, surface.faces


@pytest.mark.parametrize("dimension", [2, 3])
def test_box_has_the_sign_of_every_node(dimension: int) -> None:
    surface = meshed(ball_with_tube, 34.0, 1.0, dimension)
    field = signed_distance(surface.vertices, surface.faces, 2.0, 4.0)
    box = field.band.dense(field.phi)
    nodes = np.indices(field.band.shape).reshape(dimension, -1).T
    exact = ball_with_tube((nodes + field.band.low) * 2.0)
    clear = np.abs(exact) > 0.2
    assert ((box.ravel() < 0) == (exact < 0))[clear].all()
    assert np.abs(box).max() <= 4.0


@pytest.mark.parametrize("remove", [False, True])
def test_combine_unites_or_removes(remove: bool) -> None:
    fields = []
    for centre in ([0.0, 0.0, 0.0], [5.0, 1.0, 0.0]):
        ball = meshed(round_distance(6.0), 8.0, 0.5)
        fields.append(signed_distance(ball.vertices + centre, ball.faces, 0.5, 1.5))
    surface = Surface(*zero_set(*combine(*fields, remove=remove)))
    r = 6.0
    d = np.hypot(5.0, 1.0)
    lens = np.pi * (4 * r + d) * (2 * r - d) ** 2 / 12.0
    ball_volume = 4.0 / 3.0 * np.pi * r**3
    exact = ball_volume - lens if remove else 2.0 * ball_volume - lens
    assert surface.watertight
    if remove:
        assert surface.volume == pytest.approx(exact, rel=0.01)
    else:
        assert exact < surface.volume < 1.03 * exact  # the crease has a fillet


def test_largest_piece_drops_islands_and_cavities() -> None:
    def shape(p: np.ndarray) -> np.ndarray:
        shell = np.abs(np.linalg.norm(p, axis=1) - 5.0) - 1.5
        return np.minimum(shell, np.linalg.norm(p - [10.0, 10.0, 10.0], axis=1) - 2.0)

    surface = meshed(shape, 14.0, 0.5)
    assert component_labels(len(surface.vertices), surface.faces).max() == 2
    kept = Surface(*largest_component(surface.vertices, surface.faces))
    assert kept.watertight
    assert kept.volume == pytest.approx(4.0 / 3.0 * np.pi * 6.5**3, rel=0.01)


@pytest.mark.parametrize("dimension", [2, 3])
def test_interpolation_is_exact_on_linear_functions_and_empty_far_away(dimension: int) -> None:
    surface = meshed(round_distance(6.0), 8.0, 0.5, dimension)
    band: Band = signed_distance(surface.vertices, surface.faces, 0.7, 2.1).band
    slope = np.array([0.3, -1.2, 2.0])[:dimension]
    matrix = band.interpolation(surface.vertices)
    np.testing.assert_allclose(
        matrix @ (band.positions @ slope + 4.0), surface.vertices @ slope + 4.0, atol=1e-12
    )
    assert abs(band.interpolation(100.0 + surface.vertices)).sum() == 0.0


def test_whole_keeps_values_and_fills_the_rest() -> None:
    surface = meshed(round_distance(6.0), 8.0, 0.5)
    field: SignedDistance = signed_distance(surface.vertices, surface.faces, 1.0, 2.0)
    band, values = field.band.whole(field.phi, 7.0)
    assert len(band) == np.prod(field.band.shape)
    assert (values[field.band.keys] == field.phi).all()
    assert (np.delete(values, field.band.keys) == 7.0).all()
