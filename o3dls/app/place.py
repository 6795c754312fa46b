"""Where the prior stands before a run: by landmarks, by the pose in the case, or by pairs of a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from .worker import Message, Tell

if TYPE_CHECKING:
    from ..arrays import Array
    from ..case import Case
    from ..estimate import Estimate
    from ..report.subject import Subject

KEY = "start"
FEWEST_PAIRS = 3
INIT = "init.csv"
BESIDE = 1.1  # how far apart they stand, over what keeps them from touching
UNPLACED = (
    "Nothing says yet where the prior stands in the map; in the picture it stands beside the points. Name at "
    "least three pairs of places, or leave it: a run then searches for the pose."
)
NEAR_PRIOR = "The prior is used as it stands: neither landmarks nor init.csv move it."


def start_of(case: Case) -> tuple[Estimate, str]:
    """Return where the prior stands at the start, with a sentence on how that is known. Where nothing gives
    the pose, it stands beside the points, so that both can be seen.
    """
    from ..pipeline.start import pose_unknown, start_estimate

    start = start_estimate(case.visible())
    if not pose_unknown(case):
        given = case.init is not None or len(case.landmark_pairs()[0]) >= FEWEST_PAIRS
        return start, start.status if given else NEAR_PRIOR
    return _stand_beside(case, start), UNPLACED


def _stand_beside(case: Case, start: Estimate) -> Estimate:
    """Return the prior on the left of the points, as the first view shows both."""
    from ..report.mapping.views import orientation

    to_the_right = orientation(placed(case, start)).left  # the patient's left is on the right of a picture
    xyz, vertices = case.points.of("eam").xyz, case.prior.vertices
    wide = np.ptp(xyz @ to_the_right) + np.ptp(vertices @ to_the_right)
    T_map_prior = np.eye(4)
    T_map_prior[:3, 3] = xyz.mean(axis=0) - vertices.mean(axis=0) - BESIDE * wide / 2 * to_the_right
    return replace(start, T_map_prior=T_map_prior, surface=case.prior.transformed(T_map_prior))


def drawn(case: Case, start: Estimate) -> dict[str, Any]:
    """Return what the viewer draws, in a picture that holds all points as well."""
    from ..report.drawing.scene import scene

    places = np.vstack([case.points.xyz, start.surface.vertices])
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


def fit_pairs(pairs: Sequence[Any]) -> tuple[Array, list[float], list[float | None]]:
    """Return the pose (4, 4) that brings places of the prior to those of the map, with the error of each pair
    in mm, and its error under the fit to the others (None where these fix no pose).

    Raises InputError where the pairs are no pairs, or fix no pose.
    """
    from ..geometry.similarity import fit_similarity
    from ..registration.landmarks import determined, errors, leave_one_out

    prior, measured = (_read_places(pairs, side) for side in ("prior", "map"))
    if not (determined(prior) and determined(measured)):
        raise InputError(
            f"{len(pairs)} pairs: at least {FEWEST_PAIRS} that do not lie on one line are needed for a pose"
        )
    T_map_prior = fit_similarity(prior, measured, scale=False)
    alone = leave_one_out(prior, measured, np.ones(len(prior)), scale=False)
    left_out = [None if np.isnan(one) else float(one) for one in alone]
    return T_map_prior, errors(prior, measured, T_map_prior).tolist(), left_out


def place(folder: Path, pairs: Sequence[Any], tell: Tell) -> Message:
    """Write the pose of the pairs into the case as init.csv, in the units of the case."""
    from ..io.atomic import write_file
    from ..io.case_reader import read_case
    from ..io.case_settings import open_folder
    from ..io.manifest import noted

    T_map_prior, misses, left_out = fit_pairs(pairs)
    case = read_case(folder)
    if len(case.landmark_pairs()[0]) >= FEWEST_PAIRS:
        raise InputError(f"{folder}: its landmarks give the pose, and come before {INIT}; correct them there")
    written = T_map_prior.copy()
    written[:3, 3] /= open_folder(folder, {}).scale()
    with noted(folder):
        rows = "".join(",".join(map(repr, row)) + "\n" for row in written.tolist())
        write_file(folder / INIT, rows, within=folder)
    return {"misses": misses, "left_out": left_out}


def _read_places(pairs: Sequence[Any], side: str) -> Array:
    """Read one side of pairs {prior: [x, y, z], map: [x, y, z]}."""
    try:
        found = np.array([one[side] for one in pairs], dtype=np.float64)
    except (TypeError, KeyError, ValueError):
        found = np.zeros(0)
    if found.ndim != 2 or found.shape[1] != 3 or not np.isfinite(found).all():
        raise InputError(f"pairs: {side}: must be three finite numbers each, in mm")
    return found
