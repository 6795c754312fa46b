"""Vein wall that a result lost is told by its depth beyond the body, and counted beyond what T lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.stats
from shapes import meshed, sampled, torus_distance
from tiny import ball_case

from benchmarks.said import table
from benchmarks.scores import DEPTH, QUANTILES, VEIN, Record, bands, vein_scores, vein_table
from o3dls.arrays import Array
from o3dls.case import Case, Points, Truth
from o3dls.estimate import Estimate
from o3dls.evaluation.statistics import BAND_68, BAND_95, band
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


def half_mapped(by: Array, deviation: Array) -> tuple[Case, Estimate]:
    """A torus as the true wall, mapped where x > 0, and a result off by as much at each vertex, with these
    deviations.
    """
    wall = TORUS.with_vertices(TORUS.vertices + by[:, None] * TORUS.vertex_normals)
    at = sampled(TORUS, 2000, 0.0, SEED)
    at = at[at[:, 0] > 0.0]
    case = replace(ball_case(), prior=TORUS, points=Points(at, np.full(len(at), "eam")), truth=Truth(TORUS))
    return case, Estimate(replace(wall, fields={"sd_mm": deviation}), np.eye(4), "moved by hand")


def test_bands_hold_what_they_should_of_errors_as_students_t_has_them() -> None:
    degrees = 8
    rng, n = np.random.default_rng(SEED), len(TORUS.vertices)
    widened = BAND_95 / scipy.stats.t.ppf(0.975, degrees)
    assert (band(0.68), band(0.95)) == pytest.approx((BAND_68, BAND_95), abs=1e-6)
    deviation = 0.01 * np.linspace(1.0, 2.0, n)
    found = bands(*half_mapped(widened * deviation * rng.standard_t(degrees, size=n), deviation))
    assert found["mapped_said95"] == pytest.approx(0.95)  # nothing doubts that there is wall
    for part in ("mapped", "unmapped"):  # to .03: thousands of vertices, and feet on a bent wall
        assert found[f"{part}68"] == pytest.approx(0.68, abs=0.03)
        assert found[f"{part}95"] == pytest.approx(0.95, abs=0.03)


def test_ellipsoids_hold_their_share_of_errors_in_space() -> None:
    """Errors in space of one common scale each, as a deviation that is uncertain makes them."""
    rng, degrees, n = np.random.default_rng(SEED), 8, 100_000
    scale = BAND_95 / scipy.stats.t.ppf(0.975, degrees)
    error = scale * rng.normal(size=(n, 3)) * np.sqrt(degrees / rng.chisquare(degrees, (n, 1)))
    for dimensions in (1, 2, 3):
        for share in (0.68, 0.95):
            within = np.linalg.norm(error[:, :dimensions], axis=1) <= band(share, dimensions)
            assert within.mean() == pytest.approx(share, abs=0.004)  # two standard errors and more


@pytest.mark.parametrize(("side", "hatched"), [(-1.0, 1.0), (1.0, 0.0)])
def test_the_worst_wall_is_told_from_the_rest(side: float, hatched: float) -> None:
    end = side * TORUS.vertices[:, 0] > np.quantile(side * TORUS.vertices[:, 0], 0.95)
    found = bands(*half_mapped(np.where(end, 0.5, 0.0), np.where(end, 3.0, 1.0)))
    assert found["worst_hatched"] == hatched
    assert found["worst_unsure"] == 1.0
    assert 0.1 < found["hatched"] < 0.5  # of the half without points, all but 10 mm beside the other


def test_what_is_said_ends_with_bands_and_the_worst_wall() -> None:
    found = {
        "mapped_said95": 0.9,
        "mapped68": 0.7,
        "mapped95": 0.96,
        "hatched": 0.13,
        "worst_hatched": 0.49,
        "worst_unsure": 0.62,
    }
    found |= {f"mapped_within_{q}": q / 50 for q in QUANTILES}
    errors = {"icp": {"ssd": 2.0, "mapped": 2.0}, "deform": {"ssd": 1.0, "mapped": 0.9}}
    record: Record = {"case": "one", "group": "one", "grade": "good", "final": "deform", "doubts": []}
    record |= {"headline": {"all": 1.0, "mapped": 0.8}, "truth": {"errors": errors, "bands": found}}
    said = table([record])
    assert "mapped wall within its 68 % band: 70.0 %, within its 95 % band: 96.0 % (1 cases)" in said
    assert "mapped wall said to be there and within its 95 % band: 90.0 %" in said
    assert "mapped wall: 50, 80, 90, 95, 99 % are within 1.00, 1.60, 1.80, 1.90, 1.98 deviations" in said
    assert "of the worst 1 % of the wall 49 % is hatched (of all wall 13 %) and 62 % is in the tenth" in said
