"""The true errors of estimates and of the peers on one case, for benchmarks.verdict."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.cases import Listed, tuned_as
from benchmarks.scores import on_wall, truth_distances
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import distances, sample
from o3dls.evaluation.interpolation import REACH
from o3dls.geometry.surface import Surface

Record = dict[str, Any]
SAMPLES = 8000
SLOW = {"pycpd": 1200, "nricp_sumner": 1200}  # points, above which a peer is left out
TUNED_POINTS = (100, 250, 1000, 4000, 20_000)  # of the crossed atria, on which all peers are tuned


def true_errors(case: Case, estimates: Mapping[str, Estimate]) -> Record:
    """Mean errors of every estimate (mm, see `errors_of`), the noise of points that truly touch the wall (rms
    distance), and the share of the mapping points that do not.
    """
    assert case.truth is not None
    assert case.truth.surface is not None
    touching = case.points.xyz[on_wall(case)]
    noise = np.sqrt((distances(touching, case.truth.surface) ** 2).mean())
    outliers = 1.0 - len(touching) / max(1, int((case.points.type == "eam").sum()))
    errors = {name: errors_of(case, estimate.surface) for name, estimate in estimates.items()}
    return {"errors": errors, "noise": float(noise), "outlier_fraction": float(outliers)}


def errors_of(case: Case, surface: Surface) -> dict[str, float]:
    """Mean distances: `t2s` truth to surface, `s2t` back, `ssd` of both, `hd95`; `mapped` and `unmapped` are
    both directions on what lies within 10 mm of a mapping point, and on the rest.
    """
    assert case.truth is not None
    assert case.truth.surface is not None
    there, back = truth_distances(case, surface, SAMPLES)
    found = {"t2s": there.mean(), "s2t": back.mean(), "ssd": 0.5 * (there.mean() + back.mean())}
    found["hd95"] = max(np.percentile(there, 95.0), np.percentile(back, 95.0))
    sides = [_split(case, case.truth.surface, surface), _split(case, surface, case.truth.surface)]
    for name, part in zip(("mapped", "unmapped"), zip(*sides, strict=True), strict=True):
        if all(len(gaps) for gaps in part):
            found[name] = np.mean([gaps.mean() for gaps in part])
    return {name: float(value) for name, value in found.items()}


def _split(case: Case, source: Surface, target: Surface) -> tuple[Array, Array]:
    """Distances of samples of one surface from another: near mapping points, and far from all."""
    from scipy.spatial import cKDTree

    at = sample(source, SAMPLES)
    gap = distances(at, target)
    near = cKDTree(case.points.of("eam").xyz).query(at)[0] <= REACH
    return gap[near], gap[~near]


def peers_errors(listed: Listed, pose: list[list[float]], names: list[str]) -> dict[str, float]:
    """Mean error (both directions) of the named peers as tuned for the group, or else for crossed atria of as
    many points; from a pose.
    """
    from benchmarks.peers import FAILURES, PEERS, applicable, tuned

    case = listed.read()
    settings = tuned().get(tuned_as(listed.group)) or tuned()[_like(case)]
    found = {}
    for name in applicable(case):
        if name not in {*names} & settings.keys() or len(case.points.of("eam")) > SLOW.get(name, np.inf):
            continue
        try:
            surface = PEERS[name](case.visible(), np.array(pose), **settings[name]["parameters"])
        except FAILURES as error:
            print(f"{case.name}: {name} failed: {error}", file=sys.stderr)
            continue
        found[name] = errors_of(case, surface)["ssd"]
    return found


def _like(case: Case) -> str:
    """The crossed atria with the nearest number of points."""
    n = max(1, len(case.points.of("eam")))
    return f"cross_{min(TUNED_POINTS, key=lambda other: abs(np.log(other / n)))}"
