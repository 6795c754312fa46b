"""Cases with something wrong, as happens to people: the segmentation leaked, the patient moved, the map is
another's. Each alteration takes a good case of any generator; what is true of the wall stays true.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from o3dls import Case, InputError, Surface

from . import motion as moves
from . import pose
from .case_points import kept, true_of, with_xyz
from .faulty_maps import (
    along_a_path,
    beside,
    breathing,
    half,
    one_side,
    quarter,
    scaled,
    shifted,
    without_veins,
)
from .segmentation import coarse, leaked

Rng = np.random.Generator
Alteration = Callable[[Rng, Case], Case]
LOST = (25.0, 40.0)  # mm and degrees by which a rough pose is off
MISMARKED = (15.0, 25.0)  # mm that a landmark is off


def altered(case: Case, kind: str, seed: int) -> Case:
    """The case with something wrong; equal seeds do equal things. Raises InputError for a kind that there is
    not.
    """
    if kind not in ALTERATIONS:
        raise InputError(f"no alteration '{kind}': there are {', '.join(ALTERATIONS)}")
    found = ALTERATIONS[kind](np.random.default_rng((seed, 7331)), case)
    return replace(found, name=f"{kind}_{seed}", notes=f"{kind}: {case.notes}")


def _leaked(rng: Rng, case: Case, into: str) -> Case:
    return replace(case, prior=leaked(rng, case.prior, "aorta" if into == "aorta" else "ventricle"))


def _segmented(rng: Rng, case: Case) -> Case:
    return replace(case, prior=coarse(rng, case.prior))


def _mirrored(rng: Rng, case: Case) -> Case:
    """Left and right of the prior exchanged, its landmarks too."""
    turn = np.array([-1.0, 1.0, 1.0])
    middle = case.prior.vertices.mean(axis=0)
    prior = Surface(middle + turn * (case.prior.vertices - middle), case.prior.faces[:, ::-1])
    marks = {name: middle + turn * (at - middle) for name, at in case.prior_landmarks.items()}
    truth = replace(true_of(case), correspondence=None)
    return replace(case, prior=prior, prior_landmarks=marks, truth=truth)


def _lost(rng: Rng, case: Case) -> Case:
    """No landmarks, and a rough pose that is off by 25 mm and 40 degrees."""
    pairs = true_of(case).correspondence
    if pairs is None:
        raise InputError(f"{case.name}: has no correspondence, which tells the pose")
    found = pose.similarity_of(*pairs)
    rigid = pose.matrix(found[:3, :3] / np.cbrt(np.linalg.det(found[:3, :3])), np.zeros(3))
    rigid[:3, 3] = (pairs[1] - pose.under(rigid, pairs[0])).mean(axis=0)
    turn, about = moves.turn(rng, np.deg2rad(LOST[1])), pairs[1].mean(axis=0)
    off = pose.matrix(turn, about - turn @ about + LOST[0] * moves.direction(rng))
    return replace(kept(case, case.points.type != "landmark"), prior_landmarks={}, init=off @ rigid)


def _swapped(rng: Rng, case: Case) -> Case:
    """Two of the measured landmarks have each other's names."""
    marks = np.flatnonzero(case.points.type == "landmark")
    one, other = rng.choice(marks, 2, replace=False)
    xyz = case.points.xyz.copy()
    xyz[[one, other]] = xyz[[other, one]]
    return with_xyz(case, xyz)


def _mismarked(rng: Rng, case: Case) -> Case:
    """One of the measured landmarks is 15 to 25 mm off."""
    xyz = case.points.xyz.copy()
    row = rng.choice(np.flatnonzero(case.points.type == "landmark"))
    xyz[row] += rng.uniform(*MISMARKED) * moves.direction(rng)
    return with_xyz(case, xyz)


ALTERATIONS: Mapping[str, Alteration] = {
    "aorta": partial(_leaked, into="aorta"),
    "ventricle": partial(_leaked, into="ventricle"),
    "segmented": _segmented,
    "mirrored": _mirrored,
    "lost": _lost,
    "later": partial(shifted, part="later"),
    "side": partial(shifted, part="side"),
    "swapped": _swapped,
    "mismarked": _mismarked,
    "scaled": scaled,
    "beside": beside,
    "path": along_a_path,
    "half": half,
    "quarter": quarter,
    "veins": without_veins,
    "floating": partial(one_side, kind="floating"),
    "tented": partial(one_side, kind="tented"),
    "breathing": breathing,
}
