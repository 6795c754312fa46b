"""Maps of several hearts are laid on one atrium and averaged."""

from __future__ import annotations

import numpy as np
import pytest

from o3dls.arrays import Array
from o3dls.evaluation.segments.division import SEGMENTS
from o3dls.evaluation.segments.mean_map import HeartMap, average_maps, average_segments
from tests.evaluation.test_segments import divided


def heart(stretch: float, more: float, seen: Array | None = None) -> HeartMap:
    """Values that depend on the place by its coordinates alone, and on the heart."""
    _, division, coordinates = divided(stretch)
    values = 1.0 + coordinates.alpha + 0.5 * coordinates.beta + 0.2 * coordinates.sheet + more
    if seen is not None:
        values[~seen] = np.nan
    return HeartMap(f"{stretch}", coordinates, division.segment, values)


def test_the_mean_of_two_hearts_lies_between_them() -> None:
    on = divided(1.1)[2]
    found = average_maps([heart(1.0, 0.0), heart(1.2, 0.6)], on)
    wall = on.sheet >= 0
    asked = 1.0 + on.alpha + 0.5 * on.beta + 0.2 * on.sheet + 0.3
    inner = wall & (found.hearts == 2)
    assert inner.sum() > 0.95 * wall.sum()
    assert np.median(np.abs(found.mean - asked)[inner]) < 0.002
    assert np.quantile(np.abs(found.mean - asked)[inner], 0.95) < 0.1  # beside borders of sheets
    assert np.median(found.spread[inner]) == pytest.approx(0.6 / np.sqrt(2.0), abs=0.002)
    assert np.isnan(found.mean[~wall]).all()
    assert not found.hearts[~wall].any()


def test_unmapped_wall_counts_in_no_mean() -> None:
    whole = divided()[2]
    left = whole.surface.vertices[:, 0] > 0
    found = average_maps([heart(1.0, 0.0), heart(1.0, 1.0, left)], whole)
    wall = whole.sheet >= 0
    right = wall & (found.hearts == 1)
    assert not (right & left).sum() > 0.05 * wall.sum()
    assert np.allclose(found.mean[right], heart(1.0, 0.0).values[right], atol=1e-9)
    assert np.isnan(found.spread[right]).all()


def test_a_segment_is_averaged_over_the_hearts_that_map_half_of_it() -> None:
    _, division, coordinates = divided()
    area = coordinates.surface.vertex_areas
    first = heart(1.0, 0.0).values
    hidden = (division.segment == 3) & (coordinates.surface.vertices[:, 2] > -100)
    rows = average_segments([heart(1.0, 0.0), heart(1.0, 0.6), heart(1.0, 9.0, ~hidden)])
    assert [row.segment for row in rows] == list(SEGMENTS)[1:]
    dome, others = next(row for row in rows if row.segment == 3), [row for row in rows if row.segment != 3]
    own = area * (division.segment == 3)
    assert dome.hearts == 2
    assert dome.mean == pytest.approx(own @ np.nan_to_num(first) / own.sum() + 0.3)
    assert dome.spread == pytest.approx(0.6 / np.sqrt(2.0))
    half = 12.706 * 0.6 / 2.0  # Student's with one degree of freedom, and sd over the root of two is 0.3
    assert dome.high - dome.mean == pytest.approx(half, rel=1e-3)
    assert all(row.hearts == 3 for row in others)


def test_one_heart_has_no_spread() -> None:
    (dome,) = (row for row in average_segments([heart(1.0, 0.0)]) if row.segment == 3)
    assert dome.hearts == 1
    assert np.isnan([dome.spread, dome.low, dome.high]).all()
