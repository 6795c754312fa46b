"""Masks widened and distances from them, beside SciPy's."""

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, distance_transform_edt

from o3dls.levelset.grid.masks import gaps, widened


def some(share: float) -> np.ndarray:
    return np.random.default_rng(4).random((17, 12, 23)) < share


@pytest.mark.parametrize("share", [0.002, 0.1, 0.6])
@pytest.mark.parametrize("reach", [1.0, 2.5, 6.4, 40.0])
def test_gaps_are_euclidean_distances_within_reach(share: float, reach: float) -> None:
    mask = some(share)
    expected = distance_transform_edt(~mask)
    np.testing.assert_array_equal(gaps(mask, reach), np.where(expected <= reach, expected, np.inf))


def test_nothing_is_near_an_empty_mask() -> None:
    assert np.isinf(gaps(some(0.0), 5.0)).all()


@pytest.mark.parametrize("corners", [False, True])
@pytest.mark.parametrize("steps", [1, 2])
def test_widened_masks_are_dilated(*, corners: bool, steps: int) -> None:
    mask = some(0.02)
    around = np.ones((3, 3, 3), dtype=bool) if corners else None
    expected = binary_dilation(mask, around, iterations=steps)
    np.testing.assert_array_equal(widened(mask, steps, corners=corners), expected)
    assert not np.array_equal(mask, expected)
