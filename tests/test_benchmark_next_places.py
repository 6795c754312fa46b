"""The benchmark of proposed places measures on the true wall, and draws at random on the chamber alone."""

from __future__ import annotations

import numpy as np

from benchmarks.next_places import chamber, with_points
from data_synth.atrium import atrium


def test_further_points_lie_on_the_true_wall_but_for_noise() -> None:
    case = atrium(8_101, points=40, noise=1.5)
    truth = case.truth
    assert truth is not None
    assert truth.held_out is not None
    noise = np.array([[0.5, 0.0, 0.0], [0.0, -0.5, 0.0]])
    more = with_points(case, truth.held_out[:2] * 1.02, noise)
    added = more.points.xyz[-2:] - noise
    assert len(more.points) == len(case.points) + 2
    assert (more.points.type[-2:] == "eam").all()
    assert all((np.linalg.norm(truth.held_out - at, axis=1) < 1e-9).any() for at in added)
    assert np.array_equal(more.points.xyz[:-2], case.points.xyz)
    wall = chamber(case)
    assert 0.4 * len(truth.held_out) < len(wall) < 0.9 * len(truth.held_out)  # veins are a third of the wall
