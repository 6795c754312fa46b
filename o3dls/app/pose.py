"""The pose of the prior as pages work it out, by pairs, by a search or by hand; and how it is written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from .worker import Message, Tell

if TYPE_CHECKING:
    from ..arrays import Array
    from ..case import Case

FEWEST_PAIRS = 3
MOST_PAIRS = 100
INIT = "init.csv"
SURE = 0.95  # below it the stage global_pose warns as well


def fit_pairs(pairs: Any) -> Message:
    """Return the pose (4, 4) that brings places of the prior to those of the map, with the error of each pair
    in mm, and its error under the fit to the others (None where these fix no pose).

    Raises InputError where the pairs are no pairs, or fix no pose.
    """
    from ..geometry.similarity import fit_similarity
    from ..registration.landmarks import determined, errors, leave_one_out

    if not isinstance(pairs, list) or len(pairs) > MOST_PAIRS:
        raise InputError(f"pairs: must be a list of at most {MOST_PAIRS} pairs of places")
    prior, measured = (_read_places(pairs, side) for side in ("prior", "map"))
    if not (determined(prior) and determined(measured)):
        raise InputError(
            f"{len(pairs)} pairs: at least {FEWEST_PAIRS} that do not lie on one line are needed for a pose"
        )
    T_map_prior = fit_similarity(prior, measured, scale=False)
    alone = leave_one_out(prior, measured, np.ones(len(prior)), scale=False)
    left_out = [None if np.isnan(one) else float(one) for one in alone]
    misses = errors(prior, measured, T_map_prior).tolist()
    return {"T": T_map_prior.tolist(), "misses": misses, "left_out": left_out}


def read_pose(given: Any) -> Array:
    """Return a pose (4, 4) that a page sends. Raises InputError where it is none."""
    from ..geometry.similarity import is_pose

    try:
        T_map_prior = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        T_map_prior = np.zeros(0)
    if not is_pose(T_map_prior, 3):
        raise InputError("T: must be a pose: four rows of four numbers, a rotation with scale and shift")
    return T_map_prior


def find_pose(folder: Path, tell: Tell) -> Message:
    """Search all rotations for the pose of a case, as the stage global_pose does."""
    from ..io.case_reader import read_case
    from ..pipeline.start import start_estimate
    from ..stages.global_pose import GlobalPose

    case = read_case(folder).visible()
    found = GlobalPose()(case, start_estimate(case))
    return {"T": found.T_map_prior.tolist()} | _describe(found.facts["confidence"], "The pose was found")


def judge_pose(folder: Path, T_map_prior: Array, tell: Tell) -> Message:
    """Say how sure the points are of a pose (4, 4), against all other poses that a search finds."""
    from ..io.case_reader import read_case

    return _describe(_confidence(read_case(folder).visible(), T_map_prior), "The points fit this pose")


def write_pose(folder: Path, T_map_prior: Array, tell: Tell) -> Message:
    """Write a pose into the case as init.csv, in the units of the case."""
    from ..io.atomic import write_file
    from ..io.case_reader import read_case
    from ..io.case_settings import open_folder
    from ..io.manifest import noted

    case = read_case(folder)
    if len(case.landmark_pairs()[0]) >= FEWEST_PAIRS:
        raise InputError(f"{folder}: its landmarks give the pose, and come before {INIT}; correct them there")
    written = T_map_prior.copy()
    written[:3, 3] /= open_folder(folder, {}).scale()
    with noted(folder):
        rows = "".join(",".join(map(repr, row)) + "\n" for row in written.tolist())
        write_file(folder / INIT, rows, within=folder)
    return {"written": (folder / INIT).as_posix()}


def _confidence(case: Case, T_map_prior: Array) -> float:
    """Return the probability that a pose, refined, fits better than each other one; 0 where ICP finds nothing
    near it.
    """
    from ..registration.global_pose import angle_of, candidates, confidence, refined
    from ..registration.match import SurfaceMatcher
    from ..registration.search import APART
    from ..stages.icp import fitted_places
    from ..stages.pose_checks import STARTS, asked_places

    places, _ = fitted_places(case)
    points = places[asked_places(len(places))]
    surface = SurfaceMatcher(case.prior)
    own = refined(points, surface, T_map_prior, scale=True)
    if own is None:
        return 0.0
    rivals = candidates(points, surface, starts=STARTS, scale=True)
    others = [one for one in rivals if angle_of(one.T_map_prior, own.T_map_prior) > APART]
    return min((confidence(own.costs, one.costs, points) for one in others), default=1.0)


def _describe(sure: float, said: str) -> Message:
    advice = "" if sure >= SURE else "; look whether veins and appendage lie on their points, or mark pairs"
    return {"confidence": sure, "said": f"{said} with confidence {sure:.2f}{advice}."}


def _read_places(pairs: Sequence[Any], side: str) -> Array:
    """Read one side of pairs {prior: [x, y, z], map: [x, y, z]}."""
    try:
        found = np.array([one[side] for one in pairs], dtype=np.float64)
    except (TypeError, KeyError, ValueError):
        found = np.zeros(0)
    if found.ndim != 2 or found.shape[1] != 3 or not np.isfinite(found).all():
        raise InputError(f"pairs: {side}: must be three finite numbers each, in mm")
    return found
