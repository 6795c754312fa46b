"""What an experiment is: independent tasks, each giving rows of numbers and the shapes that its figures
show.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..adapters.self_intersections import self_intersections
from ..arrays import Array
from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..evaluation.distances import distances, measure
from ..evaluation.validity import components, flipped_faces
from ..geometry.surface import Surface
from ..pipeline.pipeline import Pipeline
from ..report.grading.wrong_poses import WrongPose, wrong_poses

# The rule: what a generator makes and what a method may set is chosen on development seeds; the page has
# other seeds, on which nothing was ever chosen. They are the second hundred decimals of pi, five at a time,
# so that nobody picked them either (the first hundred served until the patients' walls were given their
# ripple). Where a claim fails on them, improve on development seeds, and take the next hundred.
SEEDS = (
    82148,
    8651,
    32823,
    6647,
    9384,
    46095,
    50582,
    23172,
    53594,
    8128,
    48111,
    74502,
    84102,
    70193,
    85211,
    5559,
    64462,
    29489,
    54930,
    38196,
)
DEVELOPMENT = range(5000, 5060)

Row = dict[str, Any]


@dataclass(frozen=True)
class Scope:
    """The scope says how much is computed: all seeds or a few, and where third-party data lie."""

    quick: bool = False
    data: Path | None = None

    def seeds(self, full: int, quick: int = 1) -> tuple[int, ...]:
        return SEEDS[: quick if self.quick else full]


@dataclass(frozen=True, eq=False)
class Outcome:
    """An outcome has rows of numbers, and shapes by name: surfaces, or points (n, d)."""

    rows: Sequence[Row]
    shapes: Mapping[str, Surface | Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Task:
    """A task is a piece of an experiment that runs in a process of its own: a module-level function and its
    arguments.
    """

    experiment: str
    label: str
    work: Callable[..., Outcome]
    arguments: tuple[Any, ...]

    def __call__(self) -> Outcome:
        found = self.work(*self.arguments)
        return Outcome([{"experiment": self.experiment, **row} for row in found.rows], found.shapes)


def score(case: Case, pipeline: Pipeline, estimates: Mapping[str, Estimate], name: str) -> Row:
    """Score an estimate: mean distances by set, the spread of those that matter, validity, and the seconds of
    all stages that led to it; and what is wrong with its pose, beside the best one.
    """
    estimate = estimates[name]
    sets = measure(case, estimate, pipeline.fitted(name))
    row: Row = {"method": name} | {key: float(values.mean()) for key, values in sets.items()}
    row |= {
        f"{key}_p95": float(np.percentile(sets[key], 95.0))
        for key in ("held_out", "truth_to_surface")
        if key in sets
    }
    if "surface_to_truth" in sets:
        row["assd"] = (row["truth_to_surface"] + row["surface_to_truth"]) / 2.0
    if wrong := _find_wrong_pose(case, estimates, name):
        row |= {
            "wrong_pose_apart": wrong.apart,
            "wrong_pose_mean": wrong.difference.second,
            "best_pose": wrong.best,
            "best_pose_mean": wrong.difference.first,
        }
    return (
        row
        | judged(estimate.surface)
        | {"unit": case.units, "seconds": sum(estimates[one].seconds for one in pipeline.chain(name))}
    )


def _find_wrong_pose(case: Case, estimates: Mapping[str, Estimate], name: str) -> WrongPose | None:
    """Find out whether a pose is wrong beside all that were found; None for what is more than a pose, too."""
    posed = {
        one: found
        for one, found in estimates.items()
        if one not in ("given", "start") and found.only_posed(case.prior)
    }
    if name not in posed:
        return None
    positions = case.points.of("eam").xyz
    found = wrong_poses(
        case.prior.vertices,
        {one: estimate.T_map_prior for one, estimate in posed.items()},
        {one: distances(positions, estimate.surface) for one, estimate in posed.items()},
        positions,
    )
    return next((one for one in found if one.name == name), None)


def truth_of(case: Case) -> Surface:
    """Return the true surface of a synthetic case."""
    if case.truth is None or case.truth.surface is None:
        raise InputError(f"case {case.name}: has no true surface to be compared with")
    return case.truth.surface


def judged(surface: Surface) -> Row:
    """Count a surface's pieces and folds, and say whether it is closed."""
    return {
        "components": components(surface),
        "self_intersections": self_intersections(surface),
        "flipped_faces": flipped_faces(surface),
        "watertight": surface.watertight,
    }


def with_truth_distance(surface: Surface, truth: Surface) -> Surface:
    """Return the surface with its distance to truth per vertex, for pictures."""
    from dataclasses import replace

    return replace(surface, fields={"distance_to_truth": distances(surface.vertices, truth)})


def mean_sd(values: Array, digits: int = 2) -> str:
    """Write mean ± standard deviation for a table."""
    if len(values) == 0:
        return "–"
    return f"{values.mean():.{digits}f}" + (f" ± {values.std():.{digits}f}" if len(values) > 1 else "")
