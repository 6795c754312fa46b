"""How much wall a stage has taken away."""

from __future__ import annotations

import pytest
from shapes import ball_with_tube, meshed, round_distance

from o3dls.evaluation.removed_wall import removed_wall

BALL = meshed(round_distance(16.0), 20.0)
TUBED = meshed(ball_with_tube, 34.0)  # the tube ends 14 mm beyond the ball


def test_a_tube_that_was_cut_off_is_as_long_as_it_reaches() -> None:
    found = removed_wall(TUBED, BALL)
    assert found["removed_reach_mm"] == pytest.approx(14.0, abs=0.5)
    tube = TUBED.vertices[:, 0] > 16.0 + 2.5
    assert found["removed_share"] == pytest.approx(TUBED.vertex_areas[tube].sum() / TUBED.area, rel=0.1)


def test_wall_that_moved_a_little_is_not_removed() -> None:
    moved = BALL.with_vertices(1.05 * BALL.vertices)
    for after in (BALL, moved):
        assert removed_wall(BALL, after) == {"removed_share": 0.0, "removed_reach_mm": 0.0}
