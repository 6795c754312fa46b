"""Altered cases: each has wrong what it says and nothing else; leaks hang together with the atrium and reach
far from it; errors along a path go together and have the size that was asked for.
"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.cases import KINDS
from data_synth import Mapping, atrium, family, pose, wall
from data_synth.altered import ALTERATIONS, LOST, MISMARKED, altered
from data_synth.atrium import anatomy
from data_synth.catheter import Path, walked
from data_synth.faulty_maps import (
    BODY,
    BREATH,
    CROWDED,
    FOLD,
    OFF,
    OTHERS,
    SHIFTED,
    SIDES,
    SIZE,
    crowded,
    folded,
    shuffled,
)
from data_synth.meshing import mesh
from data_synth.segmentation import BALL, OVERLAP, VOXEL, coarse, leaked, solid
from o3dls import Case, InputError, Surface
from o3dls.arrays import Array
from o3dls.evaluation.distances import distances
from o3dls.geometry.components import component_areas

SEED = 40_217
COARSE = 3.0  # mm between vertices: fast
LEAST_REACH = 2 * BALL[0] - OVERLAP[1] - 3.0  # mm: of the smallest ball, and what meshing takes


@pytest.fixture(scope="module")
def rest() -> Surface:
    return mesh(anatomy(np.random.default_rng(SEED)).shape, (-50, -45, -42), (50, 45, 48), COARSE)


@pytest.fixture(scope="module")
def good(rest: Surface) -> Case:
    return family(rest, SEED, how=Mapping(200, 1.0, False, 0.05))


@pytest.mark.parametrize("into", ["ventricle", "aorta"])
def test_a_leak_is_one_piece_with_the_atrium_and_reaches_far_beyond(into: str, rest: Surface) -> None:
    found = leaked(np.random.default_rng(SEED), rest, "aorta" if into == "aorta" else "ventricle")
    assert found.watertight
    assert len(component_areas(found)[1]) == 1
    beyond = solid(rest)(found.vertices)
    assert beyond.max() > LEAST_REACH
    assert solid(found)(rest.vertices).max() < 0.7  # mm: what was there is still there


def test_a_coarse_segmentation_lacks_ends_and_is_elsewhere_within_a_voxel(rest: Surface) -> None:
    found = coarse(np.random.default_rng(SEED), rest)
    assert found.watertight
    away = distances(rest.vertices, found)
    assert away.max() > 5.0
    assert np.median(away) < 0.5 * max(VOXEL)
    assert distances(found.vertices, rest).max() < 12.0  # mm: the lids of the ends lie within the old veins


@pytest.mark.parametrize("kind", ALTERATIONS)
def test_an_alteration_is_drawn_by_its_seed_and_leaves_the_wall_as_it_is(kind: str, good: Case) -> None:
    one, again = (altered(good, kind, SEED) for _ in range(2))
    assert np.array_equal(one.points.xyz, again.points.xyz)
    assert np.array_equal(one.prior.vertices, again.prior.vertices)
    assert one.truth is not None
    assert good.truth is not None
    assert one.truth.surface is good.truth.surface
    assert one.truth.outliers is not None
    assert (one.points.type[one.truth.outliers] == "eam").all()


def test_points_of_a_shift_lie_off_together(good: Case) -> None:
    for kind in ("later", "side"):
        moves = altered(good, kind, SEED).points.xyz - good.points.xyz
        length = np.linalg.norm(moves, axis=1)
        moved = length > 1.0
        assert 0.4 < moved[good.points.type == "eam"].mean() < 0.6
        assert not moved[good.points.type == "landmark"].any()
        assert SHIFTED[0] - 0.01 < length[moved].min() <= length[moved].max() < SHIFTED[1] + 0.01
        assert np.ptp(moves[moved], axis=0).max() < 0.01


def test_landmarks_are_swapped_or_one_is_off(good: Case) -> None:
    marks = good.points.type == "landmark"
    swapped = altered(good, "swapped", SEED).points.xyz[marks]
    assert (swapped != good.points.xyz[marks]).any(axis=1).sum() == 2
    assert np.allclose(np.sort(swapped, axis=0), np.sort(good.points.xyz[marks], axis=0))
    off = np.linalg.norm(altered(good, "mismarked", SEED).points.xyz[marks] - good.points.xyz[marks], axis=1)
    assert (off > 0.01).sum() == 1
    assert MISMARKED[0] - 0.01 < off.max() < MISMARKED[1] + 0.01


def test_a_lost_pose_is_off_by_as_much_as_it_says(good: Case) -> None:
    found = altered(good, "lost", SEED)
    assert found.init is not None
    assert not found.landmark_pairs()[0]
    assert good.truth is not None
    assert good.truth.correspondence is not None
    true = pose.similarity_of(*good.truth.correspondence)
    turn = found.init[:3, :3] @ np.linalg.inv(true[:3, :3])
    angle = np.degrees(np.arccos((np.trace(turn / np.cbrt(np.linalg.det(turn))) - 1.0) / 2.0))
    assert angle == pytest.approx(LOST[1], abs=0.1)
    middle = good.truth.correspondence[0].mean(axis=0)[None]
    shift = np.linalg.norm(pose.under(found.init, middle) - good.truth.correspondence[1].mean(axis=0))
    assert shift == pytest.approx(LOST[0], abs=0.1)


def test_a_mirrored_prior_is_wound_outwards_with_its_landmarks_where_they_were(good: Case) -> None:
    found = altered(good, "mirrored", SEED)
    assert found.prior.volume == pytest.approx(good.prior.volume)
    for name, at in found.prior_landmarks.items():
        (before,) = distances(good.prior_landmarks[name][None], good.prior)
        assert distances(at[None], found.prior)[0] == pytest.approx(before, abs=1e-6)


def test_points_of_one_side_float_or_push_and_are_known_not_to_touch(good: Case) -> None:
    for kind, sign in (("floating", -1.0), ("tented", 1.0)):
        found = altered(good, kind, SEED)
        moved = np.flatnonzero((found.points.xyz != good.points.xyz).any(axis=1))
        length = np.linalg.norm(found.points.xyz[moved] - good.points.xyz[moved], axis=1)
        assert length.max() < OFF[1] + 0.01
        assert 0.3 * SIDES[kind] < len(moved) / 200 < 2.0 * SIDES[kind]
        assert found.truth is not None
        assert found.truth.outliers is not None
        assert np.isin(moved, found.truth.outliers).all()
        assert found.truth.surface is not None
        deepest = moved[length > 5.0]
        assert (sign * solid(found.truth.surface)(found.points.xyz[deepest]) > 0.0).mean() > 0.9


def test_on_one_side_the_wall_is_folded_or_as_many_points_float(good: Case) -> None:
    rng = np.random.default_rng
    fold, crowd = folded(rng(SEED), good), crowded(rng(SEED), good)
    assert good.truth is not None
    assert fold.truth is not None
    assert crowd.truth is not None
    assert good.truth.surface is not None
    assert fold.truth.surface is not None
    there = (fold.points.xyz != good.points.xyz).any(axis=1)
    assert 0.3 * CROWDED < there.mean() < 2.0 * CROWDED
    assert (there | (crowd.points.xyz == good.points.xyz).all(axis=1)).all()  # the same points
    on = np.setdiff1d(np.flatnonzero(there), good.truth.outliers)
    assert distances(fold.points.xyz[on], fold.truth.surface).max() < 4.0  # noise of 1 mm, edges
    assert distances(fold.points.xyz[on], good.truth.surface).max() > FOLD - 3.0
    assert crowd.truth.surface is good.truth.surface
    assert distances(crowd.points.xyz[on], good.truth.surface).max() > FOLD + 1.0
    assert crowd.truth.outliers is not None
    assert np.isin(np.flatnonzero(there), crowd.truth.outliers).all()


def test_a_breath_moves_all_along_one_direction_and_landmarks_not(good: Case) -> None:
    moves = altered(good, "breathing", SEED).points.xyz - good.points.xyz
    assert not moves[good.points.type == "landmark"].any()
    spread = np.linalg.svd(moves, compute_uv=False)
    assert spread[1] < 0.01 * spread[0]
    assert BREATH[0] - 0.5 < np.linalg.norm(moves, axis=1).max() < BREATH[1] + 0.01


def test_parts_of_a_map_are_where_they_say(good: Case) -> None:
    assert len(altered(good, "quarter", SEED).points.of("eam")) == 50
    found = altered(good, "veins", SEED)
    assert found.truth is not None
    assert found.truth.surface is not None
    centre, radius = wall.body(found.truth.surface)
    assert np.linalg.norm(found.points.of("eam").xyz - centre, axis=1).max() < BODY * radius
    assert 100 < len(found.points.of("eam")) < 200
    assert len(found.points.of("landmark")) == 4


def test_a_scaled_map_is_larger_and_another_chambers_points_are_outliers(good: Case) -> None:
    size = [np.ptp(case.points.xyz, axis=0) for case in (altered(good, "scaled", SEED), good)]
    assert size[0] / size[1] == pytest.approx(SIZE, abs=1e-3)
    beside = altered(good, "beside", SEED)
    assert beside.truth is not None
    assert beside.truth.outliers is not None
    assert good.truth is not None
    assert good.truth.outliers is not None
    more = len(beside.truth.outliers) - len(good.truth.outliers)
    assert more == len(beside.points) - len(good.points) == round(OTHERS * 200)
    assert beside.truth.surface is not None
    outside = solid(beside.truth.surface)(beside.points.xyz[-more:])
    assert (outside > 0.0).mean() > 0.9


def test_half_a_map_keeps_its_landmarks_and_knows_its_outliers(good: Case) -> None:
    found = altered(good, "half", SEED)
    assert len(found.points.of("eam")) == 100
    assert len(found.points.of("landmark")) == 4
    assert found.truth is not None
    assert found.truth.outliers is not None
    assert found.truth.surface is not None
    away = distances(found.points.xyz, found.truth.surface)
    on = np.setdiff1d(np.flatnonzero(found.points.type == "eam"), found.truth.outliers)
    assert away[on].max() < 5.0  # of a noise of 1 mm per axis


@pytest.mark.parametrize("rms", [1.5, 2.0])
def test_errors_along_a_path_go_together_and_have_their_size(rms: float, rest: Surface) -> None:
    points, inside = walked(np.random.default_rng(SEED), rest, Path(1000, rms, 0.05))
    on = np.setdiff1d(np.arange(1000), inside)
    assert len(inside) == 50
    # along the wall's normal the rms per axis is seen; feet on a curved wall are a little nearer
    assert 0.75 * rms < np.sqrt((distances(points.xyz[on], rest) ** 2).mean()) < 1.1 * rms
    group = points.columns["group"]
    within = [np.ptp(points.xyz[group == k], axis=0).max() for k in np.unique(group)[:-1]]
    assert np.median(within) < 25.0  # mm: neighbours, and some of them inside
    far = distances(rest.vertices, rest) * 0.0 + np.array(
        [np.linalg.norm(points.xyz - at, axis=1).min() for at in rest.vertices]
    )
    assert 0.05 < (far > 10.0).mean() < 0.6  # unvisited wall


def test_a_dragged_tip_goes_from_neighbour_to_neighbour_with_errors_that_last(rest: Surface) -> None:
    points, inside = walked(np.random.default_rng(SEED), rest, Path(800, 1.5, 0.0, dragged=True))
    assert len(inside) == 0
    assert set(points.columns) == {"time"}
    steps = np.linalg.norm(np.diff(points.xyz, axis=0), axis=1)
    pairs = np.linalg.norm(points.xyz - np.random.default_rng(1).permutation(points.xyz), axis=1)
    assert np.median(steps) < 0.2 * np.median(pairs)
    _, face, foot, _ = rest.closest_point.query(points.xyz)
    off = ((points.xyz - foot) * rest.face_normals[face]).sum(axis=1)
    assert 1.0 < np.sqrt((off**2).mean()) < 2.1  # pressure is along the normal alone
    assert np.corrcoef(off[:-1], off[1:])[0, 1] > 0.4
    assert abs(np.corrcoef(off[:-200], off[200:])[0, 1]) < 0.25


def test_an_unknown_alteration_is_refused_and_the_benchmark_knows_all(good: Case) -> None:
    with pytest.raises(InputError, match="no alteration 'lots': there are aorta"):
        altered(good, "lots", SEED)
    assert set(ALTERATIONS) < {kind for kind, _ in KINDS}


def test_a_phantom_can_be_altered_too() -> None:
    found = altered(atrium(SEED, points=60), "lost", SEED)
    assert found.init is not None
    assert len(found.points.of("ablation")) == 40


def test_a_map_in_no_order_has_the_same_points_and_no_times(good: Case) -> None:
    path = altered(good, "path", SEED)
    found = shuffled(np.random.default_rng(SEED), path)
    assert set(path.points.columns) - set(found.points.columns) == {"time", "group"}
    assert not np.array_equal(found.points.xyz, path.points.xyz)

    def sorted_points(case: Case) -> tuple[Array, Array]:
        assert case.truth is not None
        return tuple(np.sort(case.points.xyz[rows], axis=0) for rows in (slice(None), case.truth.outliers))

    for before, after in zip(sorted_points(path), sorted_points(found), strict=True):
        np.testing.assert_array_equal(before, after)
