"""Electrical values reach the wall: known fields come back, nothing is claimed where no point is near."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from o3dls.case import Points
from o3dls.errors import InputError
from o3dls.evaluation.electrical import with_electrical
from o3dls.evaluation.harmonic import stiffness
from o3dls.evaluation.interpolation import METHODS, to_surface
from o3dls.evaluation.projection import project
from o3dls.evaluation.transfer import between
from o3dls.geometry.surface import Surface, outline

SEED = 92_551
POINTS = 250
OF_RANGE = 0.10  # mean error of a smooth field, in units of its range
CYCLE = 220.0


def ball(radius: float = 28.0, level: int = 4) -> Surface:
    import trimesh

    mesh = trimesh.creation.icosphere(level, radius)
    return Surface(np.array(mesh.vertices) * [1.0, 0.8, 1.2], np.array(mesh.faces))


def smooth(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.sin(x[:, 0] / 15) + 0.5 * np.cos(x[:, 1] / 12) + 0.02 * x[:, 2])


def sampled(surface: Surface, n: int = POINTS, noise: float = 1.0) -> np.ndarray:
    """Points near the wall, with the top of the body left out."""
    rng = np.random.default_rng(SEED)
    at = surface.vertices[surface.vertices[:, 2] < 12]
    return np.asarray(at[rng.integers(len(at), size=n)] + noise * rng.normal(size=(n, 3)))


@pytest.mark.parametrize("method", list(METHODS))
def test_a_smooth_field_comes_back_and_nothing_is_claimed_far_away(method: str) -> None:
    surface = ball()
    xyz = sampled(surface)
    carried = to_surface(xyz, smooth(project(xyz, surface).foot), surface, method=method, reach=10.0)
    truth = smooth(surface.vertices)
    assert np.abs(carried.values - truth)[carried.known].mean() < OF_RANGE * np.ptp(truth)
    nearest = np.linalg.norm(surface.vertices[:, None] - project(xyz, surface).foot[None], axis=2).min(axis=1)
    np.testing.assert_allclose(carried.distance, nearest, atol=1e-9)
    np.testing.assert_array_equal(carried.known, nearest <= 10.0)
    assert np.isnan(carried.values[~carried.known]).all()
    assert 0.5 < carried.known.mean() < 0.95


@pytest.mark.parametrize("method", list(METHODS))
def test_a_constant_stays_one(method: str) -> None:
    surface = ball(level=3)
    xyz = sampled(surface, 60)
    carried = to_surface(xyz, np.full(60, 2.5), surface, method=method)
    np.testing.assert_allclose(carried.values[carried.known], 2.5, atol=1e-6)


@pytest.mark.parametrize("method", list(METHODS))
@pytest.mark.parametrize("time", [250.0, -37.3, 1 / 3])
def test_a_constant_time_stays_one_whatever_the_cycle(method: str, time: float) -> None:
    """Rounding at the ends of the window does not make the earliest the latest."""
    surface = ball(level=3)
    xyz = sampled(surface, 60)
    carried = to_surface(xyz, np.full(60, time), surface, method=method, cycle=200.0)
    np.testing.assert_allclose(carried.values[carried.known], time)


@pytest.mark.parametrize("method", list(METHODS))
def test_missing_values_and_points_off_the_wall_do_not_count(method: str) -> None:
    surface = ball(level=3)
    xyz = sampled(surface, 60)
    values = smooth(xyz)
    more = np.vstack([xyz, xyz[:5], np.zeros((1, 3))])
    worse = np.concatenate([values, np.full(5, np.nan), [1e9]])
    first, second = (
        to_surface(xyz, values, surface, method=method),
        to_surface(more, worse, surface, method=method),
    )
    np.testing.assert_allclose(first.values, second.values)
    with pytest.raises(InputError, match="none of 1 points has a value and lies within 10 mm"):
        to_surface(np.zeros((1, 3)), np.ones(1), surface, method=method)


def test_the_process_knows_how_wrong_it_is() -> None:
    surface = ball()
    xyz = sampled(surface)
    rng = np.random.default_rng(SEED + 1)
    measured = smooth(project(xyz, surface).foot) + 0.1 * rng.normal(size=len(xyz))
    carried = to_surface(xyz, measured, surface, method="process", reach=20.0)
    assert carried.sd is not None
    error = (carried.values - smooth(surface.vertices))[carried.known]
    assert 0.6 < np.sqrt((error**2 / carried.sd[carried.known] ** 2).mean()) < 1.5
    far = carried.distance > 8
    assert carried.sd[carried.known & far].mean() > 1.5 * carried.sd[carried.known & ~far].mean()


@pytest.mark.parametrize("method", list(METHODS))
def test_times_live_on_a_circle(method: str) -> None:
    """A wave that runs round the body once per cycle: early meets late at the back, and no false value lies
    between.
    """
    surface = ball()

    def lat(x: np.ndarray) -> np.ndarray:
        return np.mod(np.arctan2(x[:, 1], x[:, 0]) / (2 * np.pi) * CYCLE, CYCLE) - 90.0

    xyz = sampled(surface)
    feet = project(xyz, surface).foot
    away = np.hypot(surface.vertices[:, 0], surface.vertices[:, 1]) > 8  # at the pole all times meet
    carried = to_surface(xyz, lat(feet), surface, method=method, cycle=CYCLE)
    error = np.mod(carried.values - lat(surface.vertices) + CYCLE / 2, CYCLE) - CYCLE / 2
    assert np.abs(error[carried.known & away]).mean() < 0.05 * CYCLE
    start = lat(feet).min()
    assert np.nanmin(carried.values) >= start
    assert np.nanmax(carried.values) <= start + CYCLE
    if method in ("gaussian", "harmonic"):  # averaging on a line invents times in the middle of the cycle
        line = to_surface(xyz, lat(feet), surface, method=method).values
        wrong = np.mod(line - lat(surface.vertices) + CYCLE / 2, CYCLE) - CYCLE / 2
        assert np.abs(wrong[carried.known & away]).mean() > 1.3 * np.abs(error[carried.known & away]).mean()


def test_fields_follow_the_motion_not_the_nearest_wall() -> None:
    """Two balls that are one body moved by more than its own radius: the nearest wall is another place, the
    motion knows better.
    """
    prior = ball(level=3)
    prior = Surface(prior.vertices, prior.faces, {"height": smooth(prior.vertices), "place": prior.vertices})

    def motion(x: np.ndarray) -> np.ndarray:
        return np.asarray(x * 1.1 + [12.0, -9, 5] + 2 * np.sin(x / 20))

    refined = Surface(motion(ball(level=4).vertices), ball(level=4).faces)
    along = between(prior, refined, source_motion=motion)
    assert np.abs(along.fields["height"] - smooth(ball(level=4).vertices)).mean() < 0.01
    nearest = between(prior, refined, reach=np.inf)
    assert np.abs(nearest.fields["height"] - smooth(ball(level=4).vertices)).mean() > 0.2
    back = between(along, ball(level=3), target_motion=motion)
    assert np.abs(back.fields["height"] - prior.fields["height"]).mean() < 0.02
    assert np.abs(back.fields["place"] - prior.fields["place"]).mean() < 0.3
    far = between(prior, refined, reach=1.0)
    assert np.isnan(far.fields["height"]).any()
    assert np.isnan(far.fields["place"]).all(axis=1).any()


def test_between_surfaces_a_label_in_floating_point_is_no_mean() -> None:
    coarse, fine = ball(level=2), ball(level=3)
    region = np.where(coarse.vertices[:, 0] > 0, 1.0, 32.0)
    found = between(replace(coarse, fields={"region": region, "force": region}), fine).fields
    assert set(np.unique(found["region"])) == {1.0, 32.0}
    assert len(np.unique(found["force"])) > 2


def test_a_vertex_without_a_value_leaves_no_gap_where_it_has_no_say() -> None:
    source = ball(level=3)
    height = smooth(source.vertices)
    height[7] = np.nan
    source = Surface(source.vertices, source.faces, {"height": height, "lat": height})
    for cycles in (None, {"lat": CYCLE}):
        copy = between(source, Surface(source.vertices, source.faces), cycles=cycles)
        assert (
            np.flatnonzero(np.isnan(copy.fields["height"])).tolist()
            == np.flatnonzero(np.isnan(copy.fields["lat"])).tolist()
            == [7]
        )


def test_times_between_corners_do_not_run_through_the_whole_cycle() -> None:
    source = ball(level=3)
    lat = np.mod(np.arctan2(source.vertices[:, 1], source.vertices[:, 0]) / (2 * np.pi) * CYCLE, CYCLE)
    source = Surface(source.vertices, source.faces, {"lat": lat})
    target = ball(level=4)
    away = np.hypot(target.vertices[:, 0], target.vertices[:, 1]) > 8
    truth = np.arctan2(target.vertices[:, 1], target.vertices[:, 0]) / (2 * np.pi) * CYCLE

    def worst(cycles: dict[str, float]) -> float:
        error = between(source, target, cycles=cycles).fields["lat"] - truth
        return float(np.abs(np.mod(error + CYCLE / 2, CYCLE) - CYCLE / 2)[away].max())

    assert worst({"lat": CYCLE}) < 0.03 * CYCLE
    assert worst({}) > 0.2 * CYCLE


def test_stiffness_is_the_dirichlet_energy() -> None:
    """On a plane the energy of a linear function is area times slope squared; in 2D, length times slope
    squared.
    """
    x, y = np.meshgrid(np.linspace(0, 3, 7), np.linspace(0, 2, 5), indexing="ij")
    index = np.arange(35).reshape(7, 5)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    plane = Surface(
        np.column_stack([x.ravel(), y.ravel(), np.zeros(35)]),
        np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])]),
    )
    u = 2 * x.ravel() - y.ravel()
    assert u @ stiffness(plane) @ u == pytest.approx(5 * 6.0)
    ring = outline(np.array([[0.0, 0], [2, 0], [2, 1], [0, 1]]))
    height = ring.vertices[:, 0] / 2
    assert height @ stiffness(ring) @ height == pytest.approx(2 * 2 * 0.25)


def test_columns_of_points_become_fields() -> None:
    surface = ball(level=3)
    xyz = sampled(surface, 60)
    kinds = np.array(["eam"] * 50 + ["ablation"] * 10)
    columns = {
        "bipolar": np.where(kinds == "eam", 1.5, 99.0),
        "lat": np.full(60, np.nan),
        "name": np.array(["a"] * 60),
    }
    fields = with_electrical(surface, Points(xyz, kinds, columns)).fields
    assert list(fields) == ["bipolar"]
    assert np.nanmax(np.abs(fields["bipolar"] - 1.5)) < 1e-9
    with pytest.raises(InputError, match="did you mean 'gaussian'"):
        to_surface(xyz, columns["bipolar"], surface, method="gausian")
    for odd in ({"reach": 0.0}, {"cycle": np.inf}):
        with pytest.raises(InputError, match="must be positive"):
            to_surface(xyz, columns["bipolar"], surface, **odd)
    with pytest.raises(InputError, match=r"must be \(k, 3\) and \(k,\)"):
        to_surface(xyz[:, :2], columns["bipolar"], surface)


def test_whole_numbers_are_carried_and_a_lone_value_off_the_wall_leaves_it_empty() -> None:
    surface = ball(level=3)
    xyz = np.vstack([sampled(surface, 50), np.zeros((1, 3))])
    middle = np.where(np.arange(51) == 50, 1.5, np.nan)  # measured in the middle of the chamber alone
    fields = with_electrical(
        surface, Points(xyz, np.array(["eam"] * 51), {"lat": np.full(51, 30), "bipolar": middle})
    ).fields
    assert np.nanmax(np.abs(fields["lat"] - 30.0)) < 1e-9
    assert np.isnan(fields["bipolar"]).all()


def test_real_voltages_reach_the_real_wall(shared_data: Path) -> None:
    from o3dls.io.case_reader import read_case

    case = read_case(shared_data / "real/kit_mri_to_eam")
    assert case.truth is not None
    assert case.truth.surface is not None
    measured = case.points.of("eam")
    values = np.asarray(measured.columns["bipolar"])
    every_other = np.arange(len(values)) % 2 == 0
    carried = to_surface(measured.xyz[every_other], values[every_other], case.truth.surface)
    wall = project(measured.xyz[~every_other], case.truth.surface)
    predicted = np.einsum("nk,nk->n", wall.weights, carried.values[case.truth.surface.faces[wall.face]])
    known = np.isfinite(predicted)
    error = np.abs(predicted - values[~every_other])[known]
    spread = np.abs(values - values.mean())
    assert error.mean() < spread.mean()
