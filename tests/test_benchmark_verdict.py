"""The benchmark of the verdict: what is bad, how well grades tell it, and that a run is graded without its
truth.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import mannwhitneyu, spearmanr

from benchmarks import verdict
from benchmarks.cases import Listed
from benchmarks.verdict import KEPT, auc, rank_correlation, reasons, table, write_csv
from benchmarks.verdict_statistics import predict_blocks
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.resources import demo_case

SEED = 771_302


def record(case: str, grade: str, error: float, expected: float | None, **more: Any) -> dict[str, Any]:
    checks = [{"name": "Volume change", "grade": grade, "said": ""}]
    return {
        "group": "made",
        "case": case,
        "grade": grade,
        "final": "level_set",
        "checks": checks,
        "warnings": [],
        "headline": None if expected is None else {"all": expected},
        "truth": {"errors": {"level_set": {"ssd": error}}, "noise": 1.0},
    } | more


@pytest.mark.parametrize(
    ("error", "expected", "peers", "why"),
    [
        (1.9, 1.0, {}, []),
        (2.1, 1.0, {}, ["headline"]),
        (2.1, None, {}, []),
        (1.3, 1.0, {"poisson": 1.0, "thin-plate": 3.0}, ["peer"]),
        (1.1, 1.0, {"poisson": 1.0}, []),
        (2.1, 1.0, {"poisson": 1.0}, ["headline", "peer"]),
    ],
)
def test_bad_is_twice_the_headline_or_a_fifth_above_the_best_peer(
    error: float, expected: float | None, peers: dict[str, float], why: list[str]
) -> None:
    assert reasons(record("a", "good", error, expected, peers=peers)) == why


def test_auc_is_that_of_mann_and_whitney_and_ties_count_half() -> None:
    assert auc([2.0, 2.0], [0.0, 1.0]) == 1.0
    assert auc([1.0], [1.0]) == 0.5
    assert np.isnan(auc([], [1.0]))
    rng = np.random.default_rng(SEED)
    bad, good = rng.integers(0, 3, 40), rng.integers(0, 3, 70)
    assert auc(bad, good) == pytest.approx(mannwhitneyu(bad, good).statistic / (40 * 70))


def test_rank_correlation_is_spearmans_with_ties() -> None:
    rng = np.random.default_rng(SEED)
    grades, errors = rng.integers(0, 3, 50).tolist(), rng.uniform(size=50).tolist()
    assert rank_correlation(grades, errors) == pytest.approx(spearmanr(grades, errors).statistic)
    assert np.isnan(rank_correlation([1, 1, 1], [1.0, 2.0, 3.0]))


def test_the_table_counts_false_alarms_and_leaves_out_what_was_refused() -> None:
    warned = {"warnings": [{"code": "large-noise", "stage": "start", "sentence": ""}]}
    records = [
        record("a", "bad", 5.0, 1.0, **warned),
        record("b", "good", 5.0, 1.0),
        record("c", "amber", 1.0, 1.0, **warned),
        {"group": "made", "case": "d", "error": "the pose is unknown"},
    ]
    rows = {line.split("  ")[0]: line.split() for line in table(records).splitlines()}
    assert rows["all"][1:6] == ["3", "2", "1/0/1", "0/1/0", "0.50"]
    assert rows["Volume change: CHECK"][-2:] == ["0", "1"]
    assert rows["Volume change: FAIL"][-2:] == ["1", "0"]
    assert rows["large-noise"][1:] == ["1", "1"]
    assert "refused (1): d" in table(records)


def test_every_case_is_a_row_of_the_csv(tmp_path: Path) -> None:
    refused = {"group": "made", "case": "b", "error": "why"}
    write_csv(tmp_path / "t.csv", [record("a", "amber", 5.0, 1.0, stats={"far_reach": 21.0}), refused])
    one, other = csv.DictReader((tmp_path / "t.csv").open())
    assert (one["grade"], one["bad"], one["true"], one["far_reach"]) == ("amber", "headline", "5.0", "21.0")
    assert (other["grade"], other["error"]) == ("refused", "why")
    write_csv(tmp_path / "b.csv", [record("a", "amber", 5.12345, 1.0)], brief=True)
    (one,) = csv.DictReader((tmp_path / "b.csv").open())
    assert tuple(one) == KEPT
    assert one["true"] == "5.123"


def test_rows_left_out_together_are_predicted_as_by_the_rest_alone() -> None:
    rng = np.random.default_rng(SEED)
    at = np.sort(rng.uniform(0.0, 10.0, 30))
    covariance = np.exp(-0.5 * (at[:, None] - at) ** 2) + 0.1 * np.eye(30)
    z = np.linalg.cholesky(covariance) @ rng.normal(size=30)
    inverse = np.linalg.inv(covariance)
    block, rest = np.arange(8, 14), np.r_[0:8, 14:30]
    by_rest = covariance[np.ix_(block, rest)] @ np.linalg.inv(covariance[np.ix_(rest, rest)])
    away = z[block] - by_rest @ z[rest]
    found = predict_blocks("x", inverse, inverse @ z, [block])
    assert found["x_mm"] == pytest.approx(np.abs(away).mean())
    left = covariance[np.ix_(block, block)] - by_rest @ covariance[np.ix_(rest, block)]
    assert found["x_chi"] == pytest.approx(away @ np.linalg.solve(left, away) / 6)


def test_lines_of_one_case_are_joined(tmp_path: Path) -> None:
    path = tmp_path / "r.jsonl"
    path.write_text('{"case": "a", "grade": "good"}\n{"case": "a", "peers": {"poisson": 1.0}}\n')
    assert verdict.read_records(path) == {"a": {"case": "a", "grade": "good", "peers": {"poisson": 1.0}}}


def test_a_run_is_graded_without_its_truth_and_again_from_its_folder(tmp_path: Path) -> None:
    found = verdict.judged(Listed("demo", "demo", demo_case()), keep=tmp_path)
    assert found["points"] > 100
    assert found["truth"]["errors"]["level_set"]["ssd"] < found["truth"]["errors"]["icp"]["ssd"]
    assert not list((tmp_path / "demo" / "case").glob("truth*"))
    assert "Calibration" not in [check["name"] for check in found["checks"]]  # which needs the truth
    assert found["stats"]["left_8_mm"] > 0.0
    again = verdict.graded_again(found | {"grade": "?", "checks": []}, tmp_path)
    assert (again["grade"], again["checks"]) == (found["grade"], found["checks"])


def test_a_case_that_is_refused_says_why(tmp_path: Path) -> None:
    case = read_case(demo_case())
    metres = replace(case.points, xyz=0.001 * case.points.xyz)
    write_case(tmp_path / "made", replace(case, points=metres))
    found = verdict.judged(Listed("made", "made", tmp_path / "made"))
    assert "grade" not in found
    assert "# units=m" in found["error"]
