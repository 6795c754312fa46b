"""What was measured and not fitted, and lies centimetres from a result: held-out points, ablation sites,
landmarks.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..evaluation.distances import distances
from ..run_warning import RunWarning
from .run import Run

# mm: more than noise or the pressure of a catheter explain; the middle of a vein is nearer to its wall
FAR = 20.0
OFF = 10.0  # mm: rarely exceeded by a site or a point on this wall
FEW_FAR, FEW_OFF = 0.01, 0.1  # shares of the points that may lie beyond FAR and OFF in a good result
FEW = f"up to {FEW_FAR:.0%} beyond {FAR:g} mm, {FEW_OFF:.0%} beyond {OFF:g} mm"
HALF = 0.5
SETS = {"held_out": "held-out points", "ablation": "ablation sites", "landmarks": "landmarks"}
log = logging.getLogger("o3dls")


@dataclass(frozen=True, eq=False)
class FarPoints:
    """These places were not fitted: the name of their set, and how far they lie from a surface (n,), in
    mm.
    """

    name: str
    distances: Array

    @property
    def doubtful(self) -> bool:
        """Whether some of the places lie so far off that result and points cannot both be right."""
        return self._share_beyond(FAR) > FEW_FAR or (self._of_wall and self._share_beyond(OFF) > FEW_OFF)

    @property
    def failed(self) -> bool:
        """Whether most of the places lie so far off."""
        return self._share_beyond(OFF if self._of_wall else FAR) >= HALF

    @property
    def short(self) -> str:
        return f"{len(self._far_distances)} of {len(self.distances)} {self.name}"

    @property
    def said(self) -> str:
        median = np.median(self._far_distances)
        where = f"more than {self._far_limit:g} mm from the surface, {median:.0f} mm in the median"
        return f"{self.short} lie {where}"

    @property
    def _far_limit(self) -> float:
        return FAR if self._share_beyond(FAR) > FEW_FAR else OFF

    @property
    def _far_distances(self) -> Array:
        return self.distances[self.distances > self._far_limit]

    @property
    def _of_wall(self) -> bool:
        """Whether the places were on the wall: landmarks may be the middle of the mouth of a vein."""
        return self.name != SETS["landmarks"]

    def _share_beyond(self, limit: float) -> float:
        return float((self.distances > limit).mean())


def far_points(run: Run, name: str) -> list[FarPoints]:
    """Return, by set, how far from the surface of an estimate lies what it was not fitted to; sets that are
    empty are left out, and all of them in pixels, which say no length.
    """
    if run.unit != "mm":
        return []
    column = f"distance_{name}_mm"
    marks = run.case.points.of("landmark").xyz
    sites = run.points.of("ablation").numbers(column) if "ablation" in run.scores[name] else np.zeros(0)
    sets = {
        "held_out": np.zeros(0) if run.held_out is None else run.held_out.numbers(column),
        "ablation": sites,
        "landmarks": distances(marks, run.estimates[name].surface) if len(marks) else np.zeros(0),
    }
    return [FarPoints(SETS[key], values) for key, values in sets.items() if len(values)]


def warned_of_far_points(run: Run) -> Run:
    """Return the run, with a warning on its last estimate for each set of which some lie centimetres off."""
    found = [
        RunWarning(
            "points-far-off", f"{one.said}: are they of this chamber, and is the pose right?", run.final
        )
        for one in far_points(run, run.final)
        if one.doubtful
    ]
    for warning in found:
        log.warning("%s", warning.sentence)
    last = run.estimates[run.final]
    warned = replace(last, warnings=(*last.warnings, *found))
    return replace(run, estimates={**run.estimates, run.final: warned}) if found else run
