"""Distances of lesions on a ball, and how they change with what the samples move."""

from __future__ import annotations

import numpy as np
import pytest
from tiny import sphere

from o3dls.arrays import Array
from o3dls.evaluation.measures.intervals import WIDER
from o3dls.evaluation.measures.lesions import Lesions, Scar, draw_lesions, find_border
from o3dls.evaluation.measures.numbers import Quantity
from o3dls.geometry.twist import rotation
from o3dls.motion.wall.samples import SurfaceSamples

RADIUS = 20.0
BALL = sphere(RADIUS, 60)
HEIGHT = 10.0  # of the border of a scar about the pole
MESHED = 0.1  # mm: faces lie inside of the ball
ANGLE = 0.1


def on_ball(*polar: float) -> Array:
    """Places (n, 3) at angles from the pole, in one plane."""
    return RADIUS * np.array([[np.sin(a), 0.0, np.cos(a)] for a in polar])


def still(count: int = 30) -> SurfaceSamples:
    at = np.repeat(BALL.vertices[None], count, axis=0)
    return SurfaceSamples(BALL, at, np.ones(at.shape[:2], dtype=bool))


def turned(angle: float) -> SurfaceSamples:
    """All samples are turned away from the pole, in the plane of `on_ball`."""
    at = np.repeat((BALL.vertices @ rotation(np.array([0.0, angle, 0.0])).T)[None], 5, axis=0)
    return SurfaceSamples(BALL, at, np.ones(at.shape[:2], dtype=bool))


def lesions(xyz: Array, noise: float = 0.0, lines: tuple[str, ...] = ()) -> Lesions:
    return Lesions(tuple("abcdefgh"[: len(xyz)]), xyz, np.full(len(xyz), noise), lines)


def measured(samples: SurfaceSamples, given: Lesions, **scars: Scar) -> tuple[dict, dict]:
    naive, drawn = draw_lesions(samples, given, scars, np.random.default_rng(6_113))
    named = {(one.what, one.where): value for one, value in naive.items()}
    return named, {(one.what, one.where): value for one, value in drawn.items()}


def test_gaps_are_those_of_neighbours_in_a_line_and_the_largest_of_each() -> None:
    at = on_ball(0.2, 0.5, 1.2, 1.5, 1.6)
    naive, drawn = measured(still(), lesions(at, lines=("roof", "roof", "roof", "floor", "floor")))
    chord = {
        pair: 2.0 * RADIUS * np.sin(0.5 * turn) for pair, turn in (("ab", 0.3), ("bc", 0.7), ("de", 0.1))
    }
    assert naive["gap", "a to b"] == pytest.approx(chord["ab"], abs=MESHED)
    assert naive["largest gap", "roof"] == pytest.approx(chord["bc"], abs=MESHED)
    assert naive["largest gap", "floor"] == pytest.approx(chord["de"], abs=MESHED)
    assert ("gap", "c to d") not in naive
    for name, value in naive.items():
        assert drawn[name] == pytest.approx(value)


def test_without_lines_each_lesion_has_the_gap_to_its_nearest() -> None:
    naive, _ = measured(still(), lesions(on_ball(0.2, 0.5, 1.2, 1.4)))
    assert {where for what, where in naive if what == "gap"} == {"a to b", "c to d"}
    assert not any(what == "largest gap" for what, _ in naive)
    assert measured(still(), lesions(on_ball(0.2)))[0] == {}


def test_a_distance_to_a_scar_is_that_to_its_border_and_none_within() -> None:
    polar = np.arccos(HEIGHT / RADIUS)
    scar = Scar(HEIGHT - BALL.vertices[:, 2], of_wall=True)
    naive, _ = measured(still(), lesions(on_ball(polar + 0.4, polar - 0.4)), scar=scar)
    assert naive["distance to scar", "a"] == pytest.approx(2.0 * RADIUS * np.sin(0.2), abs=2.0 * MESHED)
    assert naive["distance to scar", "b"] == 0.0


def test_a_scar_of_the_wall_goes_with_it_and_one_of_the_map_stays() -> None:
    polar = np.arccos(HEIGHT / RADIUS)
    beyond = HEIGHT - BALL.vertices[:, 2]
    scars = {"wall": Scar(beyond, of_wall=True), "map": Scar(beyond, of_wall=False)}
    _, drawn = measured(turned(ANGLE), lesions(on_ball(polar + 0.4)), **scars)
    # the axis of the turn leads the pole towards the lesion, by more than in the sample
    nearer = 2.0 * RADIUS * np.sin(0.5 * (0.4 - WIDER * ANGLE))
    assert drawn["distance to wall", "a"] == pytest.approx(nearer, abs=3.0 * MESHED)
    assert drawn["distance to map", "a"] == pytest.approx(2.0 * RADIUS * np.sin(0.2), abs=2.0 * MESHED)
    _, drawn = measured(turned(-0.5), lesions(on_ball(polar - 0.4)), **scars)
    assert (drawn["distance to wall", "a"] > 0.0).all()
    assert (drawn["distance to map", "a"] == 0.0).all()


def test_there_is_no_distance_to_a_scar_that_there_is_not() -> None:
    naive, drawn = measured(still(), lesions(on_ball(0.3)), scar=Scar(np.ones(len(BALL.vertices)), True))
    assert naive == drawn == {}


def test_intervals_of_gaps_hold_the_true_ones() -> None:
    """Of lesions that were measured with the noise that they state, 95 %."""
    rng, held = np.random.default_rng(11_587), list[bool]()
    names = "abcdefgh"
    for _ in range(30):
        polar = np.cumsum(rng.uniform(0.2, 0.4, len(names)))
        true = on_ball(*polar)
        given = lesions(true + rng.normal(size=true.shape), 1.0, ("line",) * len(names))
        drawn = draw_lesions(still(200), given, {}, rng)[1]
        for k in range(len(names) - 1):
            gap = drawn[Quantity("gap", f"{names[k]} to {names[k + 1]}", "mm")]
            low, high = np.quantile(gap, [0.025, 0.975])
            held.append(bool(low <= np.linalg.norm(true[k] - true[k + 1]) <= high))
    assert 0.90 < np.mean(held) < 0.99


def test_a_border_lies_where_the_field_is_zero_and_not_beside_what_is_unknown() -> None:
    field = BALL.vertices[:, 2] - HEIGHT
    ends, share = find_border(BALL, field)
    first, last = BALL.vertices[ends, 2].T
    heights = first + share * (last - first)
    assert heights == pytest.approx(HEIGHT)
    field[BALL.vertices[:, 0] > 0.0] = np.nan
    ends, _ = find_border(BALL, field)
    assert len(ends)
    assert (BALL.vertices[ends, 0] <= 0.0).all()
