"""The benchmark of topology tells handles that points show from such as they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import meshed, sampled, torus_distance
from tiny import ball_case

from benchmarks.topology import Row, handles, shown
from o3dls.case import Points, Truth

SEED = 51_907
NOISE = 0.6


TORUS = meshed(torus_distance(), 24.0)


@pytest.mark.parametrize(("count", "number"), [(4000, 1), (30, 0)])
def test_a_handle_counts_as_shown_by_many_points_and_not_by_few(count: int, number: int) -> None:
    points = sampled(TORUS, count, NOISE, SEED)
    measured = Points(points, np.full(count, "eam"))
    case = replace(ball_case(), points=measured, truth=Truth(surface=TORUS))
    assert handles(TORUS) == 1
    assert shown(case, NOISE) == number


def test_only_what_points_show_is_right_or_wrong() -> None:
    assert Row("lost", prior=0, truth=1, shown=1, result=0).differs
    assert not Row("lost", prior=0, truth=1, shown=1, result=0).right
    assert not Row("not shown", prior=0, truth=1, shown=0, result=0).differs
    assert Row("cut", prior=1, truth=0, shown=0, result=0).right
