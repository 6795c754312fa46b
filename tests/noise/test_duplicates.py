"""Which points are one place: copies, beats of one contact and merged maps; and no points that chance brought
together.
"""

from __future__ import annotations

import numpy as np
import pytest

from o3dls.arrays import Array, Ints
from o3dls.case import Points
from o3dls.noise.duplicates import distinct_places, duplicate_distance

SIZE = 20.0  # rms radius of the sphere


def mapped(count: int, noise: float = 1.0, seed: int = 60_331) -> Array:
    """Points (count, 3) at random on the sphere's wall, displaced by noise."""
    rng = np.random.default_rng(seed)
    at = rng.normal(size=(count, 3))
    return SIZE * at / np.linalg.norm(at, axis=1, keepdims=True) + noise * rng.normal(size=(count, 3))


def points(*xyz: Array, type: str = "eam") -> Points:
    return Points(np.vstack(xyz), np.full(sum(len(x) for x in xyz), type))


def apart(points: Points, size: float) -> float:
    return duplicate_distance(points.xyz, points.type, size)


def places(points: Points, within: float) -> tuple[Ints, Ints]:
    return distinct_places(points.xyz, points.type, within)


@pytest.mark.parametrize("noise", [0.1, 1.0, 2.0])
@pytest.mark.parametrize("count", [40, 250, 5_000])
def test_points_at_random_are_places_of_their_own(count: int, noise: float) -> None:
    assert apart(points(mapped(count, noise)), SIZE) == 0.0


def contours(noise: float) -> Array:
    """Points (1000, 3) at random along nine contours of the sphere, displaced by noise."""
    rng = np.random.default_rng(70_117)
    height = rng.choice(np.linspace(-0.9, 0.9, 9), 1000)
    turn = rng.uniform(0.0, 2.0 * np.pi, 1000)
    flat = np.sqrt(1.0 - height**2)
    at = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), height])
    return SIZE * at + noise * rng.normal(size=at.shape)


@pytest.mark.parametrize("noise", [0.0, 0.3, 1.0])
def test_points_along_contours_are_places_of_their_own(noise: float) -> None:
    assert apart(points(contours(noise)), SIZE) == 0.0


@pytest.mark.parametrize("noise", [0.3, 1.0])
def test_copies_of_points_along_contours_are_found(noise: float) -> None:
    assert apart(points(contours(noise), contours(noise).round(2)), SIZE) > 0.0


@pytest.mark.parametrize("copies", ["twice", "some", "contacts"])
def test_points_closer_than_noise_leaves_them_are_one_place(copies: str) -> None:
    xyz = mapped(250)
    jitter = np.random.default_rng(9).normal(size=(250, 3))
    more = {
        "twice": xyz.round(2),
        "some": np.repeat(xyz[:25], 4, axis=0) + 0.2 * jitter[:100],
        "contacts": xyz[3] + 0.3 * jitter[:60],
    }
    every = points(xyz, more[copies])
    within = apart(every, SIZE)
    assert within > 0.5
    rows, place = places(every, within)
    of = {"twice": np.arange(250), "some": np.repeat(np.arange(25), 4), "contacts": np.full(60, 3)}[copies]
    assert (rows[place[250:]] == rows[place[:250][of]]).mean() > 0.95
    assert len(rows) > 0.9 * 250  # few that chance brought together go with them


@pytest.mark.parametrize("within", [0.0, 1.5])
def test_later_points_leave_the_places_of_earlier_ones(within: float) -> None:
    xyz = mapped(400)
    every = points(xyz, xyz[:50] + 0.3)
    first, place = places(every.select(np.arange(300)), within)
    rows, of_point = places(every, within)
    np.testing.assert_array_equal(rows[: len(first)], first)
    np.testing.assert_array_equal(of_point[:300], place)
    assert (np.linalg.norm(every.xyz[rows[of_point]] - every.xyz, axis=1) <= within).all()


def test_types_have_places_of_their_own_and_points_inside_share_only_equal_ones() -> None:
    xyz = mapped(40)
    near = xyz + 0.1
    kinds = np.repeat(["eam", "ablation", "inside", "inside", "inside"], 40)
    every = Points(np.vstack([xyz, near, xyz, near, near]), kinds)
    rows, place = places(every, 0.5)
    np.testing.assert_array_equal(rows, np.arange(160))
    np.testing.assert_array_equal(place[160:], place[120:160])


def test_points_inside_do_not_show_that_others_are_copies() -> None:
    every = Points(
        np.vstack([mapped(100), np.zeros((500, 3)) + 0.1 * mapped(500)]),
        np.repeat(["eam", "inside"], [100, 500]),
    )
    assert apart(every, SIZE) == 0.0


def test_the_distance_goes_with_the_unit_and_an_outline_has_places_too() -> None:
    xyz = mapped(250)
    every = points(xyz, xyz.round(2))
    assert apart(points(1e-3 * every.xyz), 1e-3 * SIZE) == pytest.approx(1e-3 * apart(every, SIZE))
    turn = np.random.default_rng(3).uniform(0.0, 2.0 * np.pi, 60)
    flat = SIZE * np.column_stack([np.cos(turn), np.sin(turn)]) + np.random.default_rng(4).normal(
        size=(60, 2)
    )
    assert apart(points(flat), SIZE) == 0.0
    assert apart(points(flat, flat + 0.01), SIZE) > 0.0
