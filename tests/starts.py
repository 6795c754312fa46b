"""Cases of a prior and points, with the estimate that a stage starts from: posed, or with a motion fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from fields import wall

from o3dls.arrays import Array
from o3dls.case import Case, Points
from o3dls.estimate import Estimate
from o3dls.geometry.surface import Surface
from o3dls.motion.fit import fit_motion


def started(
    prior: Surface, points: Array, sigma: float, *, fitted: bool = True, units: str = "mm"
) -> tuple[Case, Estimate]:
    case = Case("case", prior, Points(points, np.full(len(points), "eam")), units=units)
    pose = np.eye(prior.dimension + 1)
    surface = replace(prior, fields={f"sd_{units}": np.ones(len(prior.vertices)), **prior.fields})
    start = Estimate(surface, pose, "moved")
    if fitted:
        fit = fit_motion(prior.vertices, prior.faces, pose, wall(points))
        start = replace(start, motion=fit.motion, sigma=sigma, weights=np.ones(len(points)), fit=fit)
    return case, start
