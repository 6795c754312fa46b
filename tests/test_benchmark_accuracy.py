"""The benchmark of accuracy tells handles that points show from those that they do not, and runs the other
methods that are asked for.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import meshed, sampled, torus_distance
from tiny import ball_case

from benchmarks import accuracy
from benchmarks.accuracy import HANDLES, count_handles, count_shown, topology_scores, topology_table
from o3dls.case import Points, Truth
from o3dls.estimate import Estimate

SEED = 51_907
NOISE = 0.6


TORUS = meshed(torus_distance(), 24.0)


@pytest.mark.parametrize(("count", "number"), [(4000, 1), (30, 0)])
def test_a_handle_counts_as_shown_by_many_points_and_not_by_few(count: int, number: int) -> None:
    points = sampled(TORUS, count, NOISE, SEED)
    measured = Points(points, np.full(count, "eam"))
    case = replace(ball_case(), points=measured, truth=Truth(surface=TORUS))
    assert count_handles(TORUS) == 1
    assert count_shown(case, NOISE) == number


def test_only_what_points_show_is_right_or_wrong() -> None:
    told = {"lost": (0, 1, 1, 0), "not shown": (0, 1, 0, 0), "cut": (1, 0, 0, 0)}
    records = [{"case": case, **dict(zip(HANDLES, numbers, strict=True))} for case, numbers in told.items()]
    *rows, last = topology_table([*records, {"case": "as the prior"}]).splitlines()
    said = {case: next(row for row in rows if row.startswith(case)) for case in told}
    assert said["lost"].endswith("wrong")
    assert said["not shown"].endswith("points do not show it")
    assert said["cut"].endswith("right")
    assert not any("as the prior" in row for row in rows)
    assert last == "1 of 2 right where points show that the topology differs"
    assert topology_table([{"case": "as the prior"}]) == ""


def test_handles_are_counted_where_prior_and_truth_differ_and_the_noise_is_known() -> None:
    points = sampled(TORUS, 30, NOISE, SEED)
    case = replace(ball_case(), points=Points(points, np.full(30, "eam")), truth=Truth(surface=TORUS))
    assert topology_scores("cross_30_1_even", case, TORUS) == dict(zip(HANDLES, (0, 1, 0, 1), strict=True))
    assert topology_scores("la", case, TORUS) == {}
    assert topology_scores("cross_30_1_even", replace(case, prior=TORUS), TORUS) == {}


def test_only_the_other_methods_that_are_asked_for_are_run(monkeypatch: pytest.MonkeyPatch) -> None:
    case = ball_case()
    methods = {name: lambda case, pose: case.prior.transformed(pose) for name in ("one", "two", "three")}
    monkeypatch.setattr(accuracy, "PEERS", methods)
    monkeypatch.setattr(accuracy, "applicable", lambda _: list(methods))
    monkeypatch.setattr(accuracy, "tuned", lambda: {"g": {n: {"parameters": {}} for n in ("one", "two")}})
    start = Estimate(case.prior, np.eye(4), "")
    found = [name for name, *_ in accuracy.peers(case, "g", ("two", "three"), start, 1.0)]
    assert found == ["two"]  # three is not tuned
