"""Paired differences: right mean, honest interval, blocks that hang together in space."""

from __future__ import annotations

import numpy as np
import pytest

from o3dls.evaluation.statistics import (
    MOST_BLOCKS,
    Difference,
    difference_over_cases,
    paired_difference,
    spatial_blocks,
)

SEED = 20_771


def test_difference_is_that_of_the_means() -> None:
    rng = np.random.default_rng(SEED)
    a = rng.uniform(1, 2, 300)
    b = rng.uniform(0, 1, 300)
    xyz = rng.normal(size=(300, 3))
    found = paired_difference(a, b, xyz)
    assert found.mean == pytest.approx(b.mean() - a.mean())
    assert found.low < found.mean < found.high
    assert found.clear
    assert found.percent == pytest.approx(100 * (b.mean() - a.mean()) / a.mean())


def test_equal_distances_cannot_be_told_apart() -> None:
    rng = np.random.default_rng(SEED)
    a = rng.uniform(1, 2, 300)
    xyz = rng.normal(size=(300, 3))
    found = paired_difference(a, a + rng.normal(0, 0.3, 300), xyz)
    assert found.low < 0 < found.high
    assert not found.clear


def test_neighbours_that_err_together_widen_the_interval() -> None:
    """6000 samples of 30 patches, each with one error of its own, say no more than 30 measurements do."""
    rng = np.random.default_rng(SEED)
    patches = rng.normal(size=(30, 3)) * 40
    which = rng.integers(30, size=6000)
    xyz = patches[which] + rng.normal(size=(6000, 3))
    change = rng.normal(0, 1.0, 30)[which]
    found = paired_difference(np.ones(6000), 1 + change, xyz)
    assert found.high - found.low > 0.5 * 2 * 1.96 / np.sqrt(30)


def test_interval_holds_the_true_difference_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(SEED)
    hits = 0
    for _ in range(120):
        xyz = rng.normal(size=(150, 3))
        found = paired_difference(np.ones(150), 1 + 0.2 + rng.normal(0, 1, 150), xyz)
        hits += found.low <= 0.2 <= found.high
    assert 0.85 <= hits / 120 <= 1.0  # 95 % less what a bootstrap of some 30 blocks is known to miss


def test_few_points_give_no_interval() -> None:
    rng = np.random.default_rng(SEED)
    found = paired_difference(rng.uniform(size=9), rng.uniform(size=9), rng.normal(size=(9, 3)))
    assert np.isnan(found.low)
    assert not found.clear


def of_cases(changes: list[float]) -> list[Difference]:
    return [Difference(2.0, 2.0 + by, by, by - 0.1, by + 0.1, 50, 10) for by in changes]


def test_difference_over_cases_is_that_of_the_paired_t_test() -> None:
    from scipy.stats import ttest_1samp

    changes = [-0.5, 0.1, -0.3, -0.2, -0.9]
    found = difference_over_cases(of_cases(changes))
    expected = ttest_1samp(changes, 0.0).confidence_interval(0.95)
    assert found.mean == pytest.approx(np.mean(changes))
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))
    assert (found.first, found.second) == pytest.approx((2.0, 2.0 + np.mean(changes)))
    assert found.n == 5


def test_interval_over_few_cases_holds_the_true_difference_as_often_as_it_says() -> None:
    rng = np.random.default_rng(SEED)
    found = [difference_over_cases(of_cases(list(0.3 + rng.normal(size=5)))) for _ in range(1000)]
    hits = np.mean([one.low <= 0.3 <= one.high for one in found])
    assert abs(hits - 0.95) < 3 * np.sqrt(0.95 * 0.05 / 1000)  # three standard errors; resampling has 0.84


def test_one_case_gives_no_interval_over_cases() -> None:
    found = difference_over_cases(of_cases([-0.5]))
    assert np.isnan(found.low)
    assert not found.clear


@pytest.mark.parametrize("n", [1, 2, 15, 40, 250, 6000])
def test_blocks_are_compact_and_number_from_zero(n: int) -> None:
    xyz = np.random.default_rng(SEED).normal(size=(n, 3))
    labels = spatial_blocks(xyz)
    assert set(labels) == set(range(labels.max() + 1))
    assert labels.max() < MOST_BLOCKS
    if n >= 250:
        inside = np.mean([xyz[labels == k].var(axis=0).sum() for k in range(labels.max() + 1)])
        assert inside < 0.5 * xyz.var(axis=0).sum()


def test_coinciding_points_are_one_block() -> None:
    assert spatial_blocks(np.zeros((40, 3))).max() == 0
