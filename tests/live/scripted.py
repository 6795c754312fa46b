"""The events of a short session with the demo case, as its engine would send them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import o3dls
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.io.case_reader import read_case
from o3dls.live.display import Display
from o3dls.stages.deform import Deform
from o3dls.stages.landmarks import Landmarks

Event = dict[str, Any]
FIRST = 20  # points of the first fit


@dataclass
class Script:
    """What is sent of each moment."""

    unplaced: Event
    scene: Event
    points: list[Event]
    surfaces: list[Event]  # after each point beyond the first fit
    weights: list[Event]


def script(more: int = 3) -> Script:
    """A session of the demo case: landmarks, a fit to the first points, and `more` points one by one."""
    case = replace(read_case(Path(o3dls.__file__).parent / "demo_case"), truth=None)
    display = Display(case.prior)
    unplaced = display.scene(_with(case, 0), None)
    begun = _with(case, FIRST)
    estimate = Deform()(begun, Landmarks()(begun, Estimate(case.prior, np.eye(4), "")))
    scene = display.scene(begun, estimate)
    found = Script(unplaced, scene, [], [], [])
    eam = case.points.of("eam")
    for k in range(FIRST + more):
        values = {"bipolar": float(eam.columns["bipolar"][k])}
        xyz = eam.xyz[k].tolist()
        point = {"id": k + 1, "xyz": xyz, "type": "eam", "values": values, "weight": None, "distance": None}
        found.points.append({"event": "point", **point})
        if k >= FIRST:
            now = _with(case, k + 1)
            estimate = Deform().update(now, estimate)
            found.surfaces.append(display.surface(now, estimate, k + 1))
            found.weights.append(_weights(now, estimate))
    return found


def state(points: int = 20, **more: Any) -> Event:
    """A plausible state, less or more what a test asks for."""
    places = ([-8.0, -17.0, 4.0], [12.0, 18.0, 6.0], [-15.0, 3.0, -12.0])
    history = [[n, 1.6 - 0.02 * n, 3.1 - 0.04 * n] for n in range(10, points + 1)]
    content = {
        "points": points,
        "fitted": points,
        "mapped_mm": history[-1][1],
        "unmapped_mm": history[-1][2],
        "history": history,
        "next": [
            {"xyz": at, "before": 1.8, "after": 1.8 - 0.1 / k, "gain": 0.09 / k}
            for k, at in enumerate(places, 1)
        ],
        "warnings": [{"code": "few-points", "stage": "deform", "text": "20 points are few for a motion"}],
        "fit": "idle",
        "source": "connected",
        "status": "converged",
    }
    return {"event": "state", **content, **more}


def _with(case: Case, count: int) -> Case:
    """The case with its landmarks and so many of its mapping points."""
    rows = np.flatnonzero(case.points.type == "eam")[:count]
    marks = np.flatnonzero(case.points.type == "landmark")
    return replace(case, points=case.points.select(np.concatenate([marks, rows])))


def _weights(case: Case, estimate: Estimate) -> Event:
    from o3dls.evaluation.distances import distances

    eam = case.points.of("eam").xyz
    weights = [] if estimate.weights is None else [round(float(one), 3) for one in estimate.weights]
    gaps = distances(eam, estimate.surface).tolist()
    return {"event": "weights", "ids": list(range(1, len(eam) + 1)), "weights": weights, "distances": gaps}
