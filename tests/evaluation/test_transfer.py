"""Electrical values reach the wall: known fields come back, nothing is claimed where no point is near."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from o3dls.case import Points
from o3dls.errors import InputError
from o3dls.evaluation.electrical import with_electrical
from o3dls.evaluation.interpolation import REACH, to_surface
from o3dls.evaluation.projection import project
from o3dls.evaluation.transfer import between
from o3dls.geometry.surface import Surface

SEED = 92_551
POINTS = 250
OF_RANGE = 0.10  # mean error of a smooth field, in units of its range


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


def test_a_smooth_field_comes_back_and_nothing_is_claimed_far_away() -> None:
    surface = ball()
    xyz = sampled(surface)
    carried = to_surface(xyz, smooth(project(xyz, surface).foot), surface)
    known = np.isfinite(carried)
    truth = smooth(surface.vertices)
    assert np.abs(carried - truth)[known].mean() < OF_RANGE * np.ptp(truth)
    nearest = np.linalg.norm(surface.vertices[:, None] - project(xyz, surface).foot[None], axis=2).min(axis=1)
    np.testing.assert_array_equal(known, nearest <= REACH)
    assert 0.5 < known.mean() < 0.95


def test_a_constant_stays_one() -> None:
    surface = ball(level=3)
    xyz = sampled(surface, 60)
    carried = to_surface(xyz, np.full(60, 2.5), surface)
    np.testing.assert_allclose(carried[np.isfinite(carried)], 2.5, atol=1e-6)


def test_missing_values_and_points_off_the_wall_do_not_count() -> None:
    surface = ball(level=3)
    xyz = sampled(surface, 60)
    values = smooth(xyz)
    more = np.vstack([xyz, xyz[:5], np.zeros((1, 3))])
    worse = np.concatenate([values, np.full(5, np.nan), [1e9]])
    np.testing.assert_allclose(to_surface(xyz, values, surface), to_surface(more, worse, surface))
    with pytest.raises(InputError, match="none of 1 points has a value and lies within 10 mm"):
        to_surface(np.zeros((1, 3)), np.ones(1), surface)


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
    source = Surface(source.vertices, source.faces, {"height": height})
    copy = between(source, Surface(source.vertices, source.faces))
    assert np.flatnonzero(np.isnan(copy.fields["height"])).tolist() == [7]


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
    predicted = np.einsum("nk,nk->n", wall.weights, carried[case.truth.surface.faces[wall.face]])
    known = np.isfinite(predicted)
    error = np.abs(predicted - values[~every_other])[known]
    spread = np.abs(values - values.mean())
    assert error.mean() < spread.mean()
