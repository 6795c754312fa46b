"""The benchmark of activation: walls are where a registration puts them, tables count by the true speed."""

from __future__ import annotations

import numpy as np
import pytest
from tiny import sphere

from benchmarks.activation import OVER, Judged, misplace, table_of_speeds
from benchmarks.activation_peers import blur_speed
from data_synth.waves import Wave
from o3dls.evaluation.activation.harmonics import Harmonics

RADIUS = 25.0
BALL = sphere(RADIUS, 20)


def test_a_wall_is_misplaced_by_as_much_as_its_samples_say_but_is_none_of_them() -> None:
    moved = [misplace(BALL, seed, 1.5) for seed in (1, 2)]
    off = np.stack([wall.vertices - BALL.vertices for wall, _ in moved])
    samples = moved[0][1]
    assert samples.std() == pytest.approx(1.5, rel=0.1)
    assert np.sqrt((off**2).mean()) == pytest.approx(1.5, rel=0.4)
    assert np.abs(samples - off[0]).mean(axis=(1, 2)).min() > 0.3
    near = np.linalg.norm(BALL.vertices - BALL.vertices[0], axis=1) < 0.2 * OVER
    assert np.abs(off[0][near] - off[0][0]).max() < 1.5


@pytest.mark.parametrize("cycle", [None, 2.0 * np.pi * RADIUS / 0.5])
def test_blurred_times_tell_the_speed_where_it_is_even_and_a_faster_one_where_waves_meet(
    cycle: float | None,
) -> None:
    x, y, z = BALL.vertices.T
    angle = np.arccos(np.clip(z / RADIUS, -1.0, 1.0)) if cycle is None else np.arctan2(y, x)
    time = RADIUS * angle / 0.5
    wave = Wave(time if cycle is None else time % cycle, np.full(len(time), 0.5), cycle)
    found = blur_speed(Harmonics.of(BALL, np.ones(len(time), dtype=bool), 20), wave)
    even = np.abs(z) < 0.2 * RADIUS
    assert np.median(found[even]) == pytest.approx(0.5, rel=0.05)
    if cycle is None:
        assert found[z.argmin()] > 1.0


def test_speeds_are_counted_by_the_true_one() -> None:
    true = np.array([0.25, 0.25, 0.75, 0.75])
    speeds = {
        "area": np.ones(4),
        "told": np.array([1.0, 0.0, 1.0, 1.0]),
        "true": true,
        "speed": 2.0 * true,
        "held": np.array([0.0, 0.0, 1.0, 0.0]),
        "exact": 1.5 * true,
    }
    rows = [line.split() for line in table_of_speeds([Judged("focus", 250, {}, speeds)]).splitlines()]
    assert rows[1] == ["250", "points", "0.2", "to", "0.3", "50", "2.00", "0", "1.50"]
    assert rows[2] == ["250", "points", "0.7", "to", "0.8", "100", "2.00", "50", "1.50"]
    assert [row[0] for row in rows[3:]] == ["all", "all"]
