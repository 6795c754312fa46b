"""Vein wall that a result lost is told by its depth beyond the body, and counted beyond what T lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import meshed, sampled, torus_distance
from tiny import ball_case

from benchmarks.scores import DEPTH, VEIN, vein_scores, vein_table
from o3dls.case import Case, Truth
from o3dls.geometry.surface import Surface

SEED = 33_907
TORUS = meshed(torus_distance(), 24.0)


def deep(surface: Surface, depth: float) -> Case:
    """A case whose truth has wall at x > 0 that is `depth` mm deep in a vein, of which half was mapped."""
    vein = surface.vertices[:, 0] > 0.0
    truth = replace(surface, fields={DEPTH: np.where(vein, depth, 0.0), VEIN: np.where(vein, 0, -1)})
    at = sampled(surface, 2000, 0.0, SEED)
    return replace(ball_case(), truth=Truth(truth, at, at[:, 1] > 0.0))


def moved(by: float) -> Surface:
    """The wall at x > 0 moved out along z by some mm, the rest where it is."""
    shift = np.where(TORUS.vertices[:, 0] > 0.0, by, 0.0)
    return TORUS.with_vertices(TORUS.vertices + shift[:, None] * np.array([0.0, 0.0, 1.0]))


def test_nothing_is_lost_where_the_result_is_the_truth() -> None:
    found = vein_scores(deep(TORUS, 10.0), TORUS)
    assert found["vein_lost"] == 0.0
    assert max(found[key] for key in found) < 0.1


@pytest.mark.parametrize(("depth", "lost"), [(10.0, 0.75), (30.0, 0.0)])
def test_wall_far_from_the_result_is_lost_up_to_25_mm_deep(depth: float, lost: float) -> None:
    found = vein_scores(deep(TORUS, depth), moved(60.0))  # a quarter is nearer than 6 mm to what has stayed
    assert found["vein_lost"] == pytest.approx(lost, abs=0.1)


def test_mapped_and_unmapped_wall_are_told_apart() -> None:
    found = vein_scores(deep(TORUS, 10.0), TORUS.with_vertices(TORUS.vertices + np.array([0.0, 0.5, 0.0])))
    assert set(found) >= {"t2s_mapped", "s2t_mapped", "t2s_unmapped", "s2t_unmapped"}
    assert 0.1 < found["t2s_mapped"] < 0.5
    assert 0.1 < found["s2t_unmapped"] < 0.5


def test_a_truth_that_does_not_say_what_is_vein_has_no_score() -> None:
    assert vein_scores(ball_case(), TORUS) == {}


def test_the_table_has_a_row_for_each_group_and_method_and_for_groups_together() -> None:
    def row(method: str, group: str, seed: int, lost: float) -> dict[str, object]:
        found = {"method": method, "group": group, "case": f"{group}_{seed}"}
        return {**found, "vein_lost": lost, "t2s": 1.0 + lost, "s2t": 1.0}

    groups = ("unvisited_all_100_even", "unvisited_half_350_even")
    records = [
        row(method, group, 1, lost)
        for group in groups
        for method, lost in (("icp", 0.0), ("deform", 0.1), ("level_set", 0.3))
    ]
    lines = vein_table(records).splitlines()
    assert len(lines) == 1 + 3 * (2 + 2 + 1 + 1)
    joint = [line.split() for line in lines if line.startswith("unvisited_* ") and "level_set" in line]
    assert joint[0][2:6] == ["2", "20.0", "(20.0)", "2"]
    assert vein_table([{"group": "la", "method": "icp", "case": "la_1"}]) == ""
