"""Bands hold their share of errors, and wall that is not there is told from wall that is off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.stats
from shapes import meshed, sampled, torus_distance
from tiny import ball_case

from benchmarks.bands import LIKELY, QUANTILES, bands, bands_table, is_there
from benchmarks.said import table
from benchmarks.scores import Record
from o3dls.arrays import Array
from o3dls.case import Case, Points, Truth
from o3dls.estimate import Estimate
from o3dls.evaluation.statistics import BAND_68, BAND_95, band
from o3dls.geometry.surface import Surface

SEED = 33_907
TORUS = meshed(torus_distance(), 24.0)


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
    assert (found["wall_100"], found["said_100"]) == pytest.approx((1.0, 1.0))  # nothing doubts any wall
    for part in ("mapped", "mapped_there", "unmapped", "unmapped_there"):
        # to .03: thousands of vertices, and feet on a bent wall
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
    assert found["worst_hatched"] == pytest.approx(hatched)
    assert found["worst_unsure"] == pytest.approx(1.0)
    assert 0.1 < found["hatched"] < 0.5  # of the half without points, all but 10 mm beside the other


def stalked(radius: float, height: float = 0.0) -> Surface:
    """A ball with a tube of 4 mm radius that goes `height` beyond it."""

    def at(points: Array) -> Array:
        ball = np.linalg.norm(points, axis=1) - radius
        across, along = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
        tube = np.maximum(across - 4.0, np.abs(along - 0.5 * (radius + height)) - 0.5 * (radius + height))
        return np.asarray(np.minimum(ball, tube) if height else ball)

    return meshed(at, radius + height + 4.0, 1.5)


def test_a_tube_that_the_truth_lacks_is_not_there_and_a_wall_that_is_far_off_is() -> None:
    surface = stalked(20.0, 25.0)
    there = is_there(surface, stalked(20.0))
    height = surface.vertices[:, 2]
    assert not there[height > 27.0].any()  # from the mouth, 20 mm high, it is farther than a vein is wide
    assert there[height < 24.0].all()
    for radius in (6.0, 17.0):
        assert is_there(stalked(20.0), stalked(radius)).all()


def test_wall_that_is_doubted_and_not_there_spoils_no_band() -> None:
    surface, truth = stalked(20.0, 25.0), stalked(20.0)
    points = truth.vertices[truth.vertices[:, 2] < 0.0]
    case = replace(
        ball_case(), prior=surface, points=Points(points, np.full(len(points), "eam")), truth=Truth(truth)
    )
    tube = surface.vertices[:, 2] > 25.5
    fields = {"sd_mm": np.full(len(tube), 0.5), "existence": np.where(tube, 0.3, 0.97)}
    found = bands(case, Estimate(replace(surface, fields=fields), np.eye(4), "by hand"))
    assert found["unmapped95"] < 0.7  # the first 5 mm of the tube count as there
    assert found["unmapped_there95"] > 0.8
    assert found["there_40"] < 0.1 * found["wall_40"]
    assert found["said_40"] == pytest.approx(0.3 * found["wall_40"])
    assert found["there_100"] > 0.99 * found["wall_100"]
    assert found["wall_40"] + found["wall_100"] == pytest.approx(1.0)
    assert found["unmapped_said"] > found["unmapped_there"]


def test_what_is_said_ends_with_bands_and_the_worst_wall() -> None:
    found = {
        "mapped_said": 0.9,
        "mapped_there": 0.8,
        "mapped_there68": 0.72,
        "mapped_there95": 0.97,
        "mapped68": 0.7,
        "mapped95": 0.96,
        "hatched": 0.13,
        "worst_hatched": 0.49,
        "worst_unsure": 0.62,
    }
    found |= {f"mapped_within_{q}": q / 50 for q in QUANTILES}
    found |= {f"{name}_{100 * most:.0f}": 0.0 for name in ("wall", "said", "there") for most in LIKELY}
    found |= {"wall_80": 0.5, "said_80": 0.35, "there_80": 0.4}
    errors = {"icp": {"ssd": 2.0, "mapped": 2.0}, "deform": {"ssd": 1.0, "mapped": 0.9}}
    record: Record = {"case": "one", "group": "one", "grade": "good", "final": "deform", "doubts": []}
    record |= {"headline": {"all": 1.0, "mapped": 0.8}, "truth": {"errors": errors, "bands": found}}
    said = table([record])
    row = "| mapped | 1 | 72.0 | 97.0 | 70.0, 96.0 | 1.00, 1.60, 1.80, 1.90, 1.98 | 90.0 | 80.0 |"
    assert f"| all {row}" in said
    assert f"| one {row}" in said
    assert "unmapped" not in said  # this wall has none
    assert "existence up to 0.8: 50.00 % of the wall, 70 % of it is said to be there, 80 % is" in said
    assert said.count("existence up to") == 1  # classes without wall are left out
    assert "altered, mapped" not in said
    assert "of the worst 1 % of the wall 49 % is hatched (of all wall 13 %) and 62 % is in the tenth" in said


def test_bands_are_told_by_what_is_altered_the_least_first() -> None:
    known = {f"{name}_{100 * most:.0f}": 0.0 for name in ("wall", "said", "there") for most in LIKELY}
    held = (("scaled_250", 0.2), ("scaled_1000", 0.4), ("healthy_250", 0.98))
    records: list[Record] = [
        {"group": f"altered_{group}", "truth": {"bands": {**known, "mapped_there95": share}}}
        for group, share in held
    ]
    assert bands_table(records)[-1] == "altered, mapped, within 95 %: scaled 30.0 (2), healthy 98.0 (1)"
