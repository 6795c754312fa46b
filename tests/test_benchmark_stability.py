"""The benchmark of stability changes what it says, and tells two results apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tiny import ball_case, sphere

from benchmarks.stability import compared, moved_start, table, variants
from o3dls.estimate import Estimate
from o3dls.geometry.similarity import apply, similarity
from o3dls.geometry.surface import Surface
from o3dls.run_warning import RunWarning


def test_a_start_is_moved_by_two_millimetres_and_turned_by_two_degrees() -> None:
    prior = apply(similarity(np.eye(3), np.array([100.0, 0.0, 0.0]), 1.0), sphere().vertices)
    T = moved_start(np.eye(4), prior, np.random.default_rng(3))
    middle = prior.mean(axis=0)
    assert np.linalg.norm(apply(T, middle[None])[0] - middle) == pytest.approx(2.0)
    assert np.degrees(np.arccos((np.trace(T[:3, :3]) - 1.0) / 2.0)) == pytest.approx(2.0)


def test_points_are_turned_round_and_few_are_left_out() -> None:
    case = ball_case(1000)
    found = [(name, variant) for name, variant, _ in variants(case, np.eye(4), seed=1)]
    assert [name for name, _ in found] == ["as it is", "start", "start", "order", "left out"]
    assert np.array_equal(found[3][1].points.xyz, case.points.xyz[::-1])
    assert (found[4][1].points.type == "eam").sum() == 950
    assert [name for name, *_ in variants(ball_case(200), np.eye(4), seed=1)][-1] == "order"


def test_results_apart_and_of_another_structure_are_counted() -> None:
    ball = sphere()
    first = Estimate(ball, np.eye(4), "")
    near = replace(first, surface=ball.with_vertices(ball.vertices * 1.005))
    spike = ball.vertices.copy()
    spike[0] *= 1.5
    far = replace(first, surface=ball.with_vertices(spike), warnings=(RunWarning("topology-changed", "x"),))
    two = Surface(
        np.vstack([ball.vertices, 0.1 * ball.vertices]),
        np.vstack([ball.faces, ball.faces + len(ball.vertices)]),
    )
    rows = [
        {"case": name, "what": "start", **compared(first, other)}
        for name, other in {"near": near, "far": far, "two": replace(first, surface=two)}.items()
    ]
    assert [row["same"] for row in rows] == [True, False, False]
    assert rows[0]["apart"] == pytest.approx(0.1, rel=0.02)
    said = table([*rows, {"case": "none", "error": "no points"}])
    assert said.splitlines()[-1] == "none: no points"
    cells = next(line for line in said.splitlines() if line.startswith("all")).split()
    assert cells[1] == "3"
    assert cells[-3:] == ["2", "0", "1"]  # the spike's run says what was changed, which is a note
