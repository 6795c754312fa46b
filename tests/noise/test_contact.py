"""Belief in points: Bayes point by point, exact over runs, lower for what lies inside and for what hardly
presses.
"""

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest

from o3dls.arrays import Array
from o3dls.noise.contact import (
    Contact,
    _smooth_chain,
    company_odds,
    contact_density,
    isolation_odds,
    label_energy,
    update_contact,
)
from o3dls.noise.settings import ContactSettings

PLAIN = Contact(depth=8.0, scatter=32.0, outlier_fraction=0.1, inside_fraction=0.9)


def belief(residual: Array, contact: Contact = PLAIN, odds: Array | None = None) -> tuple[Array, Contact]:
    residual = np.asarray(residual, dtype=float)
    return update_contact(
        residual, np.ones(len(residual)), np.ones(len(residual)) if odds is None else odds, contact
    )


def test_without_runs_each_point_is_judged_by_bayes() -> None:
    residual = np.random.default_rng(61_819).normal(size=50) * 4
    touching = contact_density(residual, np.ones(50))
    floating = PLAIN.outlier_density(residual)
    weights, _ = belief(residual)
    np.testing.assert_allclose(weights, 0.9 * touching / (0.9 * touching + 0.1 * floating), rtol=1e-9)


@pytest.mark.parametrize("persistence", [0.0, 0.3, 0.8])
def test_the_chain_is_the_sum_over_all_labellings(persistence: float) -> None:
    rng = np.random.default_rng(27_644)
    n = 7
    share = 0.2
    touching, floating = rng.uniform(0.01, 1.0, n), rng.uniform(0.01, 1.0, n)
    stay = share + persistence * (1 - share)
    step = np.array([[1 - share * (1 - persistence), share * (1 - persistence)], [1 - stay, stay]])
    total = 0.0
    touches = np.zeros(n)
    pairs = 0.0
    for labels in product((0, 1), repeat=n):
        p = (share if labels[0] else 1 - share) * np.prod(
            [floating[i] if s else touching[i] for i, s in enumerate(labels)]
        )
        p *= np.prod([step[a, b] for a, b in pairwise(labels)])
        total += p
        touches += p * (1 - np.array(labels))
        pairs += p * sum(a and b for a, b in pairwise(labels))
    weights, together = _smooth_chain(touching, floating, share, persistence)
    np.testing.assert_allclose(weights, touches / total, rtol=1e-9)
    assert together == pytest.approx(pairs / total, rel=1e-9)


def test_inside_is_doubted_more_than_outside_and_far_more_than_near() -> None:
    depth = np.linspace(0.0, 8.0, 40)
    inside, outside = belief(-depth)[0], belief(depth)[0]
    assert (inside[1:] < outside[1:]).all()
    assert (np.diff(inside) < 0).all()
    assert inside[0] > 0.9
    assert inside[-1] < 1e-6


def test_little_force_lowers_belief_and_much_raises_it() -> None:
    residual = np.full(3, -2.5)
    weak, plain, strong = update_contact(residual, np.ones(3), np.array([4.0, 1.0, 0.25]), PLAIN)[0]
    assert weak < plain < strong


def test_runs_of_floating_points_are_recognised_and_doubt_spreads_within_them() -> None:
    """The catheter drifts off in runs: a shallow point between deep ones is doubted more than the same point
    on its own.
    """
    rng = np.random.default_rng(39_119)
    residual = rng.normal(size=300)
    runs = np.zeros(300, dtype=bool)
    for start in (40, 120, 200, 260):
        runs[start : start + 8] = True
    residual[runs] = -rng.uniform(2.5, 9.0, runs.sum())
    residual[[44, 90]] = -2.0  # one in a run, one alone
    contact = PLAIN
    for _ in range(10):
        weights, contact = belief(residual, contact)
    assert contact.persistence > 0.4
    assert weights[44] < 0.5 * weights[90]
    scattered = rng.permutation(residual)
    plain = PLAIN
    for _ in range(10):
        _, plain = belief(scattered, plain)
    assert plain.persistence < 0.25
    assert contact.outlier_fraction == pytest.approx(runs.mean(), abs=0.04)


@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_odds_that_all_points_share_say_nothing(factor: float) -> None:
    """Round after round: a share that kept the odds in it would run away."""
    residual = np.where(np.arange(220) % 11 == 5, -7.0, np.random.default_rng(5).normal(size=220))  # no runs
    plain = odd = PLAIN
    for _ in range(40):
        expected, plain = belief(residual, plain)
        found, odd = belief(residual, odd, np.full(220, factor))
    np.testing.assert_allclose(found, expected, atol=0.02)


def test_belief_knows_no_unit() -> None:
    residual = np.random.default_rng(9_973).normal(size=60) * 3
    ones = np.ones(60)
    mm, _ = update_contact(residual, ones, ones, Contact(8.0, 32.0, 0.1, 0.9, 0.2))
    metres, _ = update_contact(residual / 1000, ones / 1e6, ones, Contact(0.008, 0.032, 0.1, 0.9, 0.2))
    np.testing.assert_allclose(mm, metres, rtol=1e-9)


def test_the_energy_of_beliefs_is_least_at_the_beliefs_found() -> None:
    """Belief is the minimiser of surprise plus its own cost: any other belief costs more."""
    residual = np.random.default_rng(18_013).normal(size=40) * 3
    ones = np.ones(40)
    weights, _ = belief(residual)

    def total(w: Array) -> float:
        touching = contact_density(residual, ones)
        return label_energy(w, residual, ones, PLAIN) - float((w * np.log(touching)).sum())

    rng = np.random.default_rng(77_041)
    for _ in range(20):
        assert total(weights) <= total(np.clip(weights + rng.normal(size=40) * 0.05, 1e-6, 1 - 1e-6)) + 1e-9


@pytest.mark.parametrize("outside", [0, 25])
def test_the_share_of_stray_points_inside_is_where_the_energy_is_least(outside: int) -> None:
    """... for these beliefs, the prior's ten points among them; where many lie outside, they are cheaper to
    doubt.
    """
    rng = np.random.default_rng(90_523)
    residual = np.concatenate(
        [rng.normal(size=60), rng.uniform(-20.0, -5.0, 20), rng.uniform(5.0, 40.0, outside)]
    )
    ones = np.ones(len(residual))
    contact = PLAIN
    for _ in range(200):
        weights, contact = update_contact(residual, ones, ones, contact)

    def energy(inside: float) -> float:
        return label_energy(weights, residual, ones, replace(contact, inside_fraction=inside))

    slope = (energy(contact.inside_fraction + 1e-5) - energy(contact.inside_fraction - 1e-5)) / 2e-5
    assert abs(slope) < 1e-3
    assert energy(contact.inside_fraction) < min(
        energy(contact.inside_fraction - 0.05), energy(contact.inside_fraction + 0.02)
    )
    assert (contact.inside_fraction < 0.7) == (outside > 0)


def test_the_energy_of_the_beliefs_is_that_of_the_mixture_also_with_odds() -> None:
    residual = np.random.default_rng(7).normal(size=40) * 3
    ones = np.ones(40)
    odds = np.where(np.arange(40) < 20, 4.0, 0.25)
    weights, _ = update_contact(residual, ones, odds, PLAIN)
    touching = contact_density(residual, ones)
    floating = PLAIN.outlier_density(residual)
    off = PLAIN.outlier_fraction * odds / (1.0 - PLAIN.outlier_fraction + PLAIN.outlier_fraction * odds)
    exact = -np.log((1.0 - off) * touching + off * floating).sum()
    assert label_energy(weights, residual, odds, PLAIN) - weights @ np.log(touching) == pytest.approx(exact)


def test_a_point_that_is_alone_inside_is_more_likely_an_outlier_than_one_on_a_wall() -> None:
    rng = np.random.default_rng(3)
    wall = rng.normal(size=(2000, 3))
    wall *= 30.0 / np.linalg.norm(wall, axis=1)[:, None]
    alone = rng.uniform(-12.0, 12.0, size=(20, 3))
    odds = isolation_odds(np.vstack([wall, alone]), 30.0, ContactSettings())
    assert (odds >= 1.0).all()
    assert np.median(odds[:2000]) < 1.2  # half of the balls hold the median count or more
    assert odds[2000:].min() > 2.0 * np.quantile(odds[:2000], 0.95)
    metres = isolation_odds(np.vstack([wall, alone]) / 1000.0, 0.03, ContactSettings())
    np.testing.assert_allclose(metres, odds)
    sparse = isolation_odds(np.vstack([wall[::10], alone[::10]]), 30.0, ContactSettings())
    np.testing.assert_array_equal(sparse, np.ones(len(sparse)))  # the ball is as large as the chamber


def test_a_crowd_of_points_is_not_held_to_be_alone() -> None:
    rng = np.random.default_rng(4)
    wall = rng.uniform(0.0, 100.0, size=(400, 3)) * [1.0, 1.0, 0.0]
    crowd = rng.normal(size=(40, 3)) * 3.0 + [50.0, 50.0, -20.0]
    odds = isolation_odds(np.vstack([wall, crowd]), 50.0, ContactSettings())
    assert np.median(odds[400:]) == 1.0


@pytest.mark.parametrize("count", [0, 1, 2])
def test_of_hardly_any_points_none_is_alone(count: int) -> None:
    np.testing.assert_array_equal(
        isolation_odds(np.zeros((count, 3)), 1.0, ContactSettings()), np.ones(count)
    )


def company(floating: int, side: float, fraction: float = 0.1, *, either_side: bool = False) -> Array:
    """The odds of a point that touches, and of one that floats, among sixteen of which so many are off the
    wall on one side.
    """
    contact = replace(PLAIN, outlier_fraction=fraction)
    weights = np.r_[1.0, 0.0, np.zeros(floating), np.ones(16 - floating)]
    residual = np.r_[0.0, side, np.full(floating, side), np.zeros(16 - floating)]
    near = np.broadcast_to(np.arange(2, 18), (18, 16))
    return company_odds(near, weights, residual, contact, either_side=either_side)[:2]


def test_a_point_among_floating_ones_is_more_likely_to_float_and_one_on_a_sheet_is_not() -> None:
    assert company(3, -5.0).tolist() == [1.0, 1.0]  # as many as in a poor map
    most, nearly_all = company(12, -5.0), company(16, -5.0)
    assert (nearly_all > most).all()
    # (12 + 2 x .1) of 18 float: odds of 12.2 to 5.8 where they are 1 to 9 else
    np.testing.assert_allclose(most, 9.0 * 12.2 / 5.8)


def test_points_outside_are_no_company_and_neighbours_raise_no_belief() -> None:
    assert company(12, 5.0).tolist() == [1.0, 1.0]  # of a vein that the prior lacks: a wall, not a cloud
    assert (company(12, 5.0, either_side=True) == company(12, -5.0)).all()  # where two fits are compared
    assert company(9, -5.0, fraction=0.6).min() >= 1.0
    alone = company_odds(np.zeros((1, 0), dtype=np.int64), np.ones(1), np.zeros(1), PLAIN)
    assert alone.tolist() == [1.0]
