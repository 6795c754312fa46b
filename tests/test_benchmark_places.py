"""The benchmarks of places and of numbers judge errors that are drawn from what is stated as calibrated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm

from benchmarks.measures import Judged, judge_case, table
from benchmarks.places import _judge_errors, place_errors
from benchmarks.places import table as table_of_places
from o3dls import Deform, Pipeline
from o3dls.case import Case, Truth
from o3dls.evaluation.statistics import band
from tests.chamber import chamber, measured

MANY = 20_000
STRETCH = np.diag([1.0, 1.15, 0.95, 1.0])


def stretched() -> Case:
    """A chamber that was stretched since it was imaged, and where each of its vertices truly went."""
    prior = chamber(16)
    true = prior.vertices @ STRETCH[:3, :3].T
    truth = Truth(prior.with_vertices(true), correspondence=(prior.vertices, true))
    return replace(measured(prior, STRETCH, 120, noise=1.0), truth=truth)


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_ellipsoids_hold_as_many_errors_as_their_size_says(factor: float) -> None:
    rng = np.random.default_rng(40_733)
    root = np.array([[2.0, 0.0, 0.0], [0.7, 0.5, 0.0], [-0.3, 0.2, 1.2]])
    error = factor * rng.normal(size=(MANY, 3)) @ root.T
    normals = rng.normal(size=(MANY, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    found = _judge_errors(error, normals, np.broadcast_to(root @ root.T, (MANY, 3, 3)))
    for part in ("q", "q_along", "q_wall"):
        assert found[part].mean() == pytest.approx(factor**2, rel=0.04)
    assert found["in_95"].mean() == pytest.approx(share_within(factor), abs=0.01)
    for part in ("along", "wall"):
        ranks = [found[f"rank_{part}_{k}"].mean() for k in range(5)]
        edge = norm.cdf(norm.ppf(0.2) / factor)  # more at the ends, where errors are larger than stated
        assert ranks == pytest.approx(
            [edge, norm.cdf(norm.ppf(0.4) / factor) - edge, ranks[2], ranks[1], edge], abs=0.01
        )
        assert sum(ranks) == pytest.approx(1.0)


def share_within(factor: float) -> float:
    """Share of Gaussian errors, `factor` times too large, in an ellipsoid for 95 % of those with tails."""
    return float(chi2.cdf((band(0.95, 3) / factor) ** 2, 3))


@pytest.fixture(scope="module")
def case() -> Case:
    return stretched()


def test_places_and_numbers_of_a_case_are_judged(case: Case) -> None:
    estimate = Pipeline([Deform()], folds=0).run(case).estimates["deform"]
    found = place_errors(case, estimate)
    assert found["mapped"] == pytest.approx(1.0, abs=0.05)
    assert found["error"] ** 2 >= found["along"] ** 2 + found["in_wall"] ** 2 - 1.0
    assert 0.5 < found["in_95"] <= 1.0
    rows = table_of_places([{"group": "chamber", "stage": "deform", **found}]).splitlines()
    assert len(rows) == 2
    assert f"{100 * found['in_95']:.1f}" in rows[1]

    judged = dict[str, Judged]()
    assert min(judge_case(case, estimate, judged)) > 0.0
    assert {"volume", "area", "share below", "distance", "gap", "distance to scar"} <= judged.keys()
    assert judged["volume"].true == [pytest.approx(case.truth.surface.volume / 1000.0)]  # type: ignore[union-attr]
    assert len(judged["distance"].within) == 15
    assert all(0.0 <= rank <= 1.0 for one in judged.values() for rank in one.rank)
    assert len(table(judged).splitlines()) == 1 + len(judged)


def test_a_number_that_lies_outside_of_its_samples_is_told() -> None:
    one = Judged()
    drawn = np.linspace(9.0, 11.0, 101)
    one.take(10.0, 10.2, drawn, drawn + 5.0)
    one.take(12.0, 9.0, drawn, drawn)
    assert one.within == [1.0, 0.0]
    assert one.cells("volume")[2:] == ["50.0", "0.0", "-11.50", "17.73", "50 0 0 0 50"]
