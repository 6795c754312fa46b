"""What changed between two maps is found, and nothing is where nothing changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tiny import sphere

from o3dls.arrays import Array, Mask
from o3dls.errors import InputError
from o3dls.evaluation.changes.map_values import MOST, MapValues, values_on_prior
from o3dls.evaluation.changes.reach import Differences, draw_reach
from o3dls.evaluation.changes.regions import ChangedRegion, find_regions, redraw_regions, stands_out
from o3dls.evaluation.changes.shape_change import compare_shapes
from o3dls.evaluation.changes.value_change import ValueChange, compare_values
from o3dls.evaluation.changes.value_process import learn_process, places
from o3dls.geometry.similarity import apply, similarity
from o3dls.geometry.twist import rotation
from tests.chamber import sampled

RADIUS = 20.0
BALL = sphere(RADIUS, 24)
ALL = np.ones(len(BALL.vertices), dtype=bool)
STILL = np.zeros((30, len(BALL.vertices), 3))
CAP = 14.0  # mm: height above which there is a patch
CAP_AREA = 2.0 * np.pi * RADIUS * (RADIUS - CAP)
GAIN = 1.2


def voltage(at: Array, *, scar: bool) -> Array:
    healthy = 2.0 * np.exp(0.3 * np.sin(at[:, 0] / 8.0))
    return np.where(scar & (at[:, 2] > CAP), 0.3, healthy)


def measured(seed: int, *, scar: bool = False, gain: float = 1.0, errors: Array = STILL) -> MapValues:
    rng = np.random.default_rng(seed)
    at = sampled(BALL, 300, seed, 0.5)
    values = gain * voltage(at, scar=scar) * np.exp(0.15 * rng.normal(size=300))
    return values_on_prior(BALL, BALL, (at, values), errors, ratio=True)


def compared(first: MapValues, second: MapValues, wall: Mask = ALL) -> ValueChange:
    return compare_values(BALL, BALL, (first, second), wall, ratio=True, seed=4)


@pytest.fixture(scope="module")
def scarred() -> ValueChange:
    return compared(measured(71_201), measured(55_830, scar=True, gain=GAIN))


def test_a_new_scar_is_found_with_its_area_and_its_values(scarred: ValueChange) -> None:
    assert len(scarred.regions) == 1
    region = scarred.regions[0]
    assert region.area == pytest.approx(CAP_AREA, rel=0.15)
    assert region.areas.min() < CAP_AREA < region.areas.max()
    middle = BALL.vertices[:, 2] > RADIUS - 3.0
    assert np.nanmedian(scarred.after[middle]) == pytest.approx(0.3, rel=0.3)
    assert np.nanmedian(scarred.high[middle]) < 0.0
    assert np.array_equal(scarred.changed == 1.0, region.inside)
    assert np.exp(region.change) == pytest.approx(0.15, rel=0.5)
    assert region.changes.max() < 0.0


def test_areas_are_of_the_wall_that_is_shown(scarred: ValueChange) -> None:
    """A heart that is 1.5 times as large in the map as in its image has 2.25 times the area."""
    maps = measured(71_201), measured(55_830, scar=True, gain=GAIN)
    grown = BALL.with_vertices(1.5 * BALL.vertices)
    found = compare_values(BALL, grown, maps, ALL, ratio=True, seed=4)
    assert found.regions[0].area == pytest.approx(2.25 * scarred.regions[0].area)
    assert found.regions[0].areas == pytest.approx(2.25 * scarred.regions[0].areas)
    assert np.array_equal(found.changed, scarred.changed, equal_nan=True)


def test_what_differs_everywhere_is_one_number_and_no_change(scarred: ValueChange) -> None:
    ratio, low, high = scarred.everywhere
    assert low < GAIN < high
    assert ratio == pytest.approx(GAIN, rel=0.05)
    elsewhere = BALL.vertices[:, 2] < 5.0
    assert np.nanmean(np.abs(np.log(scarred.after / scarred.before)[elsewhere])) < 0.12


def test_equal_hearts_are_unchanged() -> None:
    """One in twenty pairs may have a region, which is small."""
    for seed in (3_000, 3_002):
        found = compared(measured(seed), measured(seed + 1, gain=GAIN))
        assert sum(one.area for one in found.regions) < 0.02 * BALL.area


def test_where_a_map_has_no_points_no_change_is_said() -> None:
    seen = measured(9_118, scar=True)
    low = seen.at(BALL, BALL.vertices)[:, 2] < 5.0
    half = MapValues(seen.face[low], seen.weights[low], seen.values[low], seen.count[low], STILL)
    found = compared(measured(40_077), half)
    top = BALL.vertices[:, 2] > CAP
    assert np.isnan(found.change[top]).all()
    assert np.isnan(found.changed[top]).all()
    assert np.isfinite(found.change[BALL.vertices[:, 2] < 0.0]).mean() > 0.95
    with pytest.raises(InputError, match="no part of the wall has points of both maps"):
        compared(measured(40_077), half, top)


def test_an_error_of_place_makes_steep_values_less_sure() -> None:
    """A step of the values that both maps have, under a motion that may be off by 3 mm across it."""
    rng = np.random.default_rng(12_090)
    slid = np.tile(rng.normal(size=(30, 1, 1)) * [3.0, 0.0, 0.0], (1, len(BALL.vertices), 1))
    steep = np.abs(BALL.vertices[:, 0]) < 2.0
    flat = np.abs(BALL.vertices[:, 0]) > 14.0
    widths = []
    for errors in (STILL, slid):
        maps = []
        for seed in (16_002, 16_003):
            at = sampled(BALL, 300, seed)
            values = 0.1 * np.random.default_rng(seed).normal(size=300) + np.tanh(at[:, 0] / 2.0)
            maps.append(values_on_prior(BALL, BALL, (at, values), errors, ratio=False))
        found = compare_values(BALL, BALL, (maps[0], maps[1]), ALL, ratio=False, seed=4)
        width = found.high - found.low
        widths.append((np.nanmean(width[steep]), np.nanmean(width[flat])))
    assert widths[1][0] > 1.15 * widths[0][0]
    assert widths[1][1] < 1.1 * widths[0][1]


def test_a_region_is_cut_where_a_third_of_its_change_is_left() -> None:
    z = BALL.vertices[:, 2]
    change = -np.clip(z - 5.0, 0.0, None)
    rng = np.random.default_rng(3_071)
    regions = find_regions(BALL, change, 0.5 * rng.normal(size=(200, len(z))), ALL)
    assert len(regions) == 1
    height = 5.0 + 0.36 * 15.0
    assert regions[0].area == pytest.approx(2.0 * np.pi * RADIUS * (RADIUS - height), rel=0.03)
    assert regions[0].change < 0.0


def told(seed: int, count: int = 300) -> Differences:
    """Points of a cap that is lower by 2, measured with a noise of 0.3."""
    at = sampled(BALL, count, seed)
    value = np.where(at[:, 2] > CAP, -2.0, 0.0) + 0.3 * np.random.default_rng(seed).normal(size=count)
    wall = places(BALL.vertices, BALL.vertices / RADIUS)
    return Differences(wall, places(at, at / RADIUS), value, np.full(count, 0.09))


def test_the_area_of_a_change_is_neither_too_large_nor_too_small_and_in_its_interval() -> None:
    """Few points leave a wide interval, and by themselves no bias."""
    about, off, held = BALL.vertices[:, 2] > RADIUS - 3.0, list[float](), 0
    for seed in range(10):
        rng = np.random.default_rng((21_007, seed))
        areas = draw_reach(BALL.faces, about, ALL, told(40_100 + seed, 150), -2.0, rng) @ BALL.vertex_areas
        low, high = np.quantile(areas / CAP_AREA, [0.025, 0.975])
        off.append(float(areas.mean()) / CAP_AREA - 1.0)
        held += bool(low <= 1.0 <= high)
    assert np.mean(off) == pytest.approx(0.0, abs=0.1)
    assert held >= 8


def test_a_region_in_two_parts_is_one_with_the_area_of_both() -> None:
    z, x = BALL.vertices[:, 2], BALL.vertices[:, 0]
    change = np.where(z > CAP, -2.0, 0.0)
    parts = [
        ChangedRegion(inside, float(BALL.vertex_areas @ inside), np.ones(2), -2.0, np.ones(2))
        for inside in ((z > CAP + 1.0) & (x > 3.0), (z > CAP + 1.0) & (x < -3.0))
    ]
    errors = 0.1 * np.random.default_rng(8_080).normal(size=(100, len(z)))
    found = redraw_regions(BALL, parts, change, errors, ALL, told(40_200))
    assert len(found) == 1
    assert found[0].area == pytest.approx(CAP_AREA, rel=0.15)
    assert BALL.vertex_areas @ found[0].inside == pytest.approx(found[0].area, rel=0.03)
    assert found[0].change == pytest.approx(-2.0, rel=0.2)


def test_where_no_point_differs_there_is_no_region() -> None:
    seen = told(40_201)
    same = replace(seen, value=np.zeros(len(seen.value)))
    about = BALL.vertices[:, 2] > RADIUS - 1.0
    region = ChangedRegion(about, 1.0, np.ones(2), -1.5, np.ones(2))
    change, errors = np.where(about, -1.5, 0.0), np.zeros((5, len(about)))
    areas = [one.area for one in redraw_regions(BALL, [region], change, errors, ALL, same)]
    assert sum(areas) < 0.03 * CAP_AREA


def test_of_pairs_without_a_change_one_in_twenty_stands_out() -> None:
    rng = np.random.default_rng(60_311)
    errors = rng.normal(size=(400, len(ALL)))
    share = np.mean([stands_out(one, errors, ALL).any() for one in rng.normal(size=(400, len(ALL)))])
    assert share == pytest.approx(0.05, abs=0.03)


def test_many_points_are_averaged_near_each_other() -> None:
    at = sampled(BALL, 3 * MOST, 5_505)
    found = values_on_prior(BALL, BALL, (at, at[:, 2]), STILL, ratio=False)
    assert len(found.values) == MOST
    assert found.count.sum() == 3 * MOST
    assert np.abs(found.values - found.at(BALL, BALL.vertices)[:, 2]).mean() < 1.0


def test_noise_and_length_of_the_values_are_learnt() -> None:
    at = sampled(BALL, 350, 77_120)
    where = places(at, at / RADIUS)
    noise = 0.3 * np.random.default_rng(77_121).normal(size=350)
    process = learn_process([(where, np.sin(at[:, 0] / 6.0) + noise, np.ones(350))], 1)
    assert process.noise == pytest.approx(0.3, rel=0.2)
    with pytest.raises(InputError, match="all the same"):
        learn_process([(where, np.ones(350), np.ones(350))], 1)


def test_a_wall_that_lies_elsewhere_is_not_displaced_and_one_that_grew_is() -> None:
    rng = np.random.default_rng(90_233)
    errors = tuple(0.3 * rng.normal(size=(100, len(ALL), 3)) for _ in range(2))
    pose = similarity(rotation(np.array([0.3, -0.2, 0.9])), np.array([40.0, -3.0, 8.0]))
    bump = np.clip(BALL.vertices[:, 2] - CAP, 0.0, None)
    grown = BALL.vertices + bump[:, None] * BALL.vertex_normals
    still = compare_shapes(BALL, apply(pose, BALL.vertices), errors, ALL)
    assert not still.changed.any()
    assert np.abs(still.change).max() < 1e-9
    found = compare_shapes(BALL, apply(pose, grown), errors, ALL)
    assert found.changed[bump > 4.0].all()
    assert not found.changed[BALL.vertices[:, 2] < 0.0].any()
    # less what the wall as a whole is shifted by
    assert found.change[bump.argmax()] == pytest.approx(bump.max(), abs=1.0)
