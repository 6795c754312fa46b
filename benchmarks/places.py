"""Where places of the prior truly went, against where the motion brings them and what it says of its errors:
python -m benchmarks.places FOLDER...

Of each case with a true correspondence (phantoms, families of motion, unvisited ones) and each stage with a
posterior: the mean error in space, along the true wall's normal and in the wall; the share of places whose
truth lies in the 95 % ellipsoid, and in the 95 % bands along the normal and in the wall; all in mapped wall,
within 10 mm of a mapping point, and beside it in the rest. `q` is the mean squared Mahalanobis distance over
its 3 degrees of freedom: 1 where the ellipsoids are right, more where they are too small; `q normal` and
`q wall` the same of the part along the normal (1) and of that in the wall (2). Ranks are the histogram of the
true place among the posterior's samples, along the normal and along two directions in the wall, in fifths, in
percent (simulation-based calibration): 20 each where the posterior is calibrated, more at both ends where it
is too narrow. Places go with the motion,
which `level_set` leaves as it is: its row differs from that of `deform` where `topology` has fitted another.

    python -m benchmarks.cases families cases --data ../shared/data --judging
    python -m benchmarks.places cases
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import norm

from benchmarks.accuracy import ours
from benchmarks.cases import find
from benchmarks.scores import lay_out
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.evaluation.interpolation import REACH
from o3dls.evaluation.statistics import band
from o3dls.motion.posterior import wall_posterior

FIFTHS = 5
Record = dict[str, Any]
STAGES = ("icp", "deform", "level_set")
COLUMNS = ("error", "along", "in_wall", "in_95", "in_95_along", "in_95_wall", "q", "q_along", "q_wall")
UNMAPPED = tuple(f"{name}_unmapped" for name in COLUMNS)
RANKS = ("rank_along", "rank_wall")


def place_errors(case: Case, estimate: Estimate) -> Record:
    """Means over mapped wall, and over the rest with `_unmapped` behind the name."""
    truth = case.truth
    assert truth is not None
    assert truth.correspondence is not None
    prior, true = truth.correspondence
    at = estimate.motion(prior) if estimate.motion is not None else _carry_rigidly(estimate, prior)
    error = true - at
    normals = _normals_at(case, estimate, prior)
    terms = _split_errors(error, normals)
    posterior = wall_posterior(estimate.motion)
    if posterior is not None:
        terms |= _judge_errors(error, normals, posterior.at(at).covariance())
    mapped = cKDTree(case.points.of("eam").xyz).query(true)[0] <= REACH
    found: Record = {"mapped": float(mapped.mean())}
    for name, values in terms.items():
        found |= {name: float(values[mapped].mean())} if mapped.any() else {}
        found |= {f"{name}_unmapped": float(values[~mapped].mean())} if (~mapped).any() else {}
    return found


def _carry_rigidly(estimate: Estimate, prior: Array) -> Array:
    from o3dls.geometry.similarity import apply

    return apply(estimate.T_map_prior, prior)


def _normals_at(case: Case, estimate: Estimate, prior: Array) -> Array:
    """Normals (n, 3) of the moved prior at places (n, 3) of the prior."""
    moved = estimate.motion(case.prior.vertices) if estimate.motion is not None else None
    moved = _carry_rigidly(estimate, case.prior.vertices) if moved is None else moved
    near = cKDTree(case.prior.vertices).query(prior)[1]
    return np.asarray(case.prior.with_vertices(moved).vertex_normals[near])


def _split_errors(error: Array, normals: Array) -> dict[str, Array]:
    along = (error * normals).sum(axis=1)
    across = np.linalg.norm(error - along[:, None] * normals, axis=1)
    return {"error": np.linalg.norm(error, axis=1), "along": np.abs(along), "in_wall": across}


def _judge_errors(error: Array, normals: Array, covariance: Array) -> dict[str, Array]:
    """Squared Mahalanobis distances over degrees of freedom, and which are within 95 %: in space, along the
    normal, in the wall.
    """
    found = dict[str, Array]()
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    wall = np.stack([first, np.cross(normals, first)], axis=1)
    every = np.broadcast_to(np.eye(3), (len(error), 3, 3))
    for name, axes in (("", every), ("_along", normals[:, None]), ("_wall", wall)):
        part = np.einsum("nka,na->nk", axes, error)
        own = np.einsum("nka,nab,nlb->nkl", axes, covariance, axes)
        squared = np.einsum("nk,nk->n", part, np.linalg.solve(own, part[:, :, None])[:, :, 0])
        free = part.shape[1]
        found |= {f"q{name}": squared / free, f"in_95{name}": squared <= band(0.95, free) ** 2}
        if name:
            # the posterior is Gaussian: the share of its samples below the truth
            below = norm.cdf(part / np.sqrt(np.einsum("nkk->nk", own)))
            found |= {f"rank{name}_{k}": _in_fifth(below, k).mean(axis=1) for k in range(FIFTHS)}
    return found


def _in_fifth(share: Array, k: int) -> Array:
    return np.minimum(np.floor(FIFTHS * share), FIFTHS - 1) == k


def table(records: list[Record]) -> str:
    """A row for each group of cases and stage, with means of cases; shares in percent."""
    rows = [["group", "stage", "cases", *COLUMNS, *UNMAPPED, *RANKS]]
    groups = dict.fromkeys(record["group"] for record in records)
    for group in (*groups, *(["all"] if len(groups) > 1 else [])):
        for stage in STAGES:
            own = [r for r in records if group in (r["group"], "all") and r["stage"] == stage]
            if own:
                cells = [_show_mean(own, name) for name in (*COLUMNS, *UNMAPPED)]
                rows.append([group, stage, str(len(own)), *cells, *(_show_ranks(own, one) for one in RANKS)])
    return lay_out(rows)


def _show_mean(records: list[Record], name: str) -> str:
    values = [record[name] for record in records if name in record]
    if not values:
        return ""
    return f"{100 * np.mean(values):.1f}" if name.startswith("in_95") else f"{np.mean(values):.2f}"


def _show_ranks(records: list[Record], name: str) -> str:
    """The histogram of ranks, as the mean of cases."""
    parts = [[record[f"{name}_{k}"] for record in records if f"{name}_{k}" in record] for k in range(FIFTHS)]
    return " ".join(f"{100 * np.mean(part):.0f}" for part in parts) if all(parts) else ""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--records", type=Path, help="write a line of JSON for each case and stage here")
    asked = parser.parse_args()
    records = list[Record]()
    for listed in find(asked.folders):
        case = listed.read()
        if case.truth is None or case.truth.correspondence is None or case.dimension == 2:
            print(f"{listed.name}: has no true correspondence in space, left out", file=sys.stderr)
            continue
        for stage, estimate, _ in ours(case.visible(), None):
            if stage in STAGES:
                head = {"group": listed.group, "case": listed.name, "stage": stage}
                records.append(head | place_errors(case, estimate))
                if asked.records:
                    with asked.records.open("a", encoding="utf-8") as lines:
                        lines.write(json.dumps(records[-1]) + "\n")
        print(listed.name, file=sys.stderr, flush=True)
    print(table(records))


if __name__ == "__main__":
    main()
