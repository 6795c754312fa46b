"""Choose each peer's setting per group on development cases: python -m benchmarks.tune FOLDER... (about an
hour for all groups).

Every setting of peers.GRIDS is tried on the first case of a group, the best quarter on the others; the lowest
mean symmetric distance to the truth wins and is written to benchmarks/tuned.json, with the number of settings
tried. Real cases are tuned on themselves, in the peers' favour. Make development cases (seeds below 1000) as
`python -m benchmarks.accuracy --help` shows. Crossed atria share one setting per number of points
(`cross_250`, whatever the noise), families one per name and strength (`family_flow_1`).
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from itertools import groupby
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.cases import Listed, find, tuned_as
from benchmarks.peers import FAILURES, GRIDS, PEERS, applicable
from benchmarks.scores import truth_distances
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.geometry.surface import Surface
from o3dls.pipeline.start import start_estimate
from o3dls.stages.icp import ICP

TUNED = Path(__file__).with_name("tuned.json")
SAMPLES = 4000
KEPT = 0.25  # share of the settings that go on to the second case


def tuned() -> dict[str, dict[str, dict[str, Any]]]:
    """Settings by group and peer."""
    found: dict[str, dict[str, dict[str, Any]]] = json.loads(TUNED.read_text()) if TUNED.is_file() else {}
    return found


def pose_of(case: Case) -> Array:
    """The pose that every non-rigid method starts from: our robust similarity ICP."""
    return ICP()(case.visible(), start_estimate(case.visible())).T_map_prior


def cost(case: Case, surface: Surface) -> float:
    """Mean symmetric distance between a surface and the truth."""
    there, back = truth_distances(case, surface, SAMPLES)
    return float(there.mean() + back.mean()) / 2.0


def tune(cases: list[tuple[Case, Array]], peer: str) -> dict[str, Any]:
    """The best of a peer's grid over the cases of one group."""
    settings = list(GRIDS[peer])
    costs = np.zeros(len(GRIDS[peer]))
    for k, (case, pose) in enumerate(cases):
        if k == 1:
            best = np.argsort(costs, kind="stable")[: max(1, int(KEPT * len(settings)))]
            settings = [settings[i] for i in best]
            costs = costs[best]
        costs = costs + np.array([_tried(case, pose, peer, setting) for setting in settings])
    winner = int(costs.argmin())
    return {
        "parameters": settings[winner],
        "cost": round(float(costs[winner]) / len(cases), 4),
        "tried": len(GRIDS[peer]),
        "cases": len(cases),
    }


def _tried(case: Case, pose: Array, peer: str, setting: Mapping[str, Any]) -> float:
    # a setting that fails has lost, and says so
    try:
        return cost(case, PEERS[peer](case, pose, **setting))
    except FAILURES as error:
        print(f"{case.name}: {peer} {setting}: {error}", file=sys.stderr)
        return float("inf")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="+", type=Path, help="case folders, or folders of them")
    parser.add_argument(
        "--again", action="store_true", help="tune groups that benchmarks/tuned.json has already"
    )
    parser.add_argument("--peer", choices=PEERS, action="append", help="only these; default: all")
    arguments = parser.parse_args()
    listed = sorted(find(arguments.folders), key=lambda c: tuned_as(c.group))
    for group, members in groupby(listed, key=lambda c: tuned_as(c.group)):
        _tune_group(group, list(members), arguments.peer or list(PEERS), arguments.again)


def _tune_group(group: str, members: list[Listed], peers: list[str], again: bool) -> None:
    cases = [(case, pose_of(case)) for case in (m.read() for m in members)]
    for peer in applicable(cases[0][0]):
        if peer in peers and (again or peer not in tuned().get(group, {})):
            begin = perf_counter()
            found = tune(cases, peer)
            print(f"{group}: {peer}: {found}, {perf_counter() - begin:.0f} s", flush=True)
            merged = tuned()
            merged.setdefault(group, {})[peer] = found
            TUNED.write_text(json.dumps(merged, indent=1, sort_keys=True) + "\n")


if __name__ == "__main__":
    main()
