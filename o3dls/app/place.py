"""Where the prior stands before a run, and how it is shown with the points: overlaid, or beside them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .pose import FEWEST_PAIRS

if TYPE_CHECKING:
    from ..case import Case
    from ..estimate import Estimate
    from ..report.subject import Subject

KEY = "start"
BESIDE = 1.1  # how far apart they stand, over what keeps them from touching
UNPLACED = (
    "Nothing says yet where the prior stands in the map; in the picture it stands beside the points. Mark "
    "three pairs of places or more, or let the pose be found. If you leave it, the run searches for it."
)
NEAR_PRIOR = "The prior is used as it stands: neither landmarks nor init.csv move it."


def start_of(case: Case) -> tuple[Estimate, Estimate, str]:
    """Return the prior where it stands at the start and beside the points, with a sentence on how the start
    is known. Where nothing gives the pose, both are beside the points, so that both objects can be seen.
    """
    from ..pipeline.start import pose_unknown, start_estimate

    start = start_estimate(case.visible())
    beside = _stand_beside(case, start)
    if pose_unknown(case):
        return beside, beside, UNPLACED
    given = case.init is not None or len(case.landmark_pairs()[0]) >= FEWEST_PAIRS
    return start, beside, start.status if given else NEAR_PRIOR


def _stand_beside(case: Case, start: Estimate) -> Estimate:
    """Return the prior on the left of the points, as the first view shows both."""
    from ..report.mapping.views import orientation

    to_the_right = orientation(placed(case, start)).left  # the patient's left is on the right of a picture
    xyz, vertices = case.points.of("eam").xyz, case.prior.vertices
    wide = np.ptp(xyz @ to_the_right) + np.ptp(vertices @ to_the_right)
    T_map_prior = np.eye(4)
    T_map_prior[:3, 3] = xyz.mean(axis=0) - vertices.mean(axis=0) - BESIDE * wide / 2 * to_the_right
    return replace(start, T_map_prior=T_map_prior, surface=case.prior.transformed(T_map_prior))


def drawn(case: Case, start: Estimate, beside: Estimate) -> dict[str, Any]:
    """Return what the viewer draws at the start, in a picture that holds all points and the prior beside them
    as well.
    """
    from ..report.drawing.scene import scene

    places = np.vstack([case.points.xyz, start.surface.vertices, beside.surface.vertices])
    centre = (places.min(axis=0) + places.max(axis=0)) / 2
    radius = float(np.linalg.norm(places - centre, axis=1).max())
    return scene(placed(case, start)) | {
        "framesPoints": True,
        "centre": centre.tolist(),
        "radius": radius,
    }


def placed(case: Case, start: Estimate) -> Subject:
    """Make what the report's viewer draws of a case: the prior where it stands, and all points."""
    from ..evaluation.distances import distances
    from ..report.subject import Result, Subject
    from ..runs.run import Run
    from ..runs.scoring import provenance

    shown = replace(start, surface=replace(start.surface, fields={}), motion=None, weights=None)
    gaps = {f"distance_{KEY}_{case.units}": distances(case.points.xyz, shown.surface)}
    known = {key: case.points.columns[key] for key in ("name", "id") if key in case.points.columns}
    points = replace(case.points, columns={**known, **gaps})
    run = Run(
        replace(case, points=points, truth=None),
        {KEY: shown},
        fitted={KEY: ("eam",)},
        scores={KEY: {"ablation": {}}},  # so that `fitted` is the eam points alone
        validity={KEY: {}},
        provenance=provenance(case, {"stage": []}),
        points=points,
    )
    return Subject({KEY: Result(KEY, KEY, run)}, [KEY], [run], [])
