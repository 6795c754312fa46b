"""The motion of an estimate as files for programs of images: ITK's transforms, there and back, and volumes of
its deviation and of where it is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...arrays import Array, Mask
from ...errors import InputError
from ...geometry.similarity import apply, inverse
from .placed import lps_pose, recorded

if TYPE_CHECKING:
    from ...motion.off_wall.field import OffWall
    from ...motion.off_wall.grid import GridMotion
    from ..run import Run

FADES = (
    "on the wall it is the motion that was fitted; beside it, the posterior mean of a vector Gaussian "
    "process given the wall's motion; it fades with the distance and is the similarity alone from {:.3g} mm "
    "outside the box around the prior on"
)
CONVENTION = (
    "ITK: resamples what lies on the image onto the map, so it takes points of the map to the image; Slicer "
    "turns it around on reading, and moves what hangs under it from the image onto the map. The inverse file "
    "does the opposite. Of the parts of a .h5 the last acts first; of a .tfm and its field, the .tfm acts "
    "first, and in the inverse the field"
)


@dataclass(frozen=True, eq=False)
class MotionOnGrid:
    """A motion on a grid is in LPS and mm, with the field that it samples; turn (4, 4) leads from the prior's
    frame to LPS, turn_map from the map's.
    """

    field: OffWall
    grid: GridMotion
    spacing: float
    turn: Array
    turn_map: Array

    def facts(self) -> dict[str, Any]:
        """Return how exact the motion is on the wall, where it fails, and how far it goes."""
        motion = self.field.motion
        wall = apply(self.turn, motion.prior.vertices)
        moved = apply(self.turn_map, motion.moved.vertices)
        there = np.linalg.norm(self.grid.forward(wall) - moved, axis=1)
        back = np.linalg.norm(self.grid.inverse(self.grid.forward(wall)) - wall, axis=1)
        failed = self.grid.failed
        return {
            "spacing_mm": self.spacing,
            "wall_error_mm": round(float(there.max()), 4),
            "wall_error_p99_mm": round(float(np.percentile(there, 99)), 4),
            "inverse_error_mm": round(float(back.max()), 4),
            "inverse_residual_mm": round(float(self.grid.residual[~failed].max(initial=0.0)), 6),
            "nodes_without_inverse": int(failed.sum()),
            "field": FADES.format(self.field.reach),
            "direction": CONVENTION,
        }

    def sentences(self) -> list[str]:
        """Return what a user must hear of it."""
        facts = self.facts()
        return [
            f"grid of {self.spacing:g} mm: misses the motion of the wall by at most "
            f"{facts['wall_error_mm']:.2g} mm, at 99 % of its vertices by at most "
            f"{facts['wall_error_p99_mm']:.2g} mm; its inverse misses by at most "
            f"{facts['inverse_error_mm']:.2g} mm there, and by {facts['inverse_residual_mm']:.2g} mm at its "
            "nodes",
            FADES.format(self.field.reach),
        ]

    def failures(self) -> list[str]:
        """Return sentences on where the motion has no inverse, and whether it is that of no field."""
        said = [self.field.not_followed] if self.field.not_followed else []
        failed = self.grid.failed
        if not failed.any():
            return said
        places = self.grid.there.nodes[failed]
        folded = int((self.grid.there.folded & failed).sum())
        middle = ", ".join(f"{value:.0f}" for value in np.median(places, axis=0))
        return [
            *said,
            f"the motion has no inverse at {len(places)} nodes ({folded} where it folds) around LPS "
            f"({middle}) mm of the image: there the inverse file is wrong, and what is known is 0",
        ]


class Written(NamedTuple):
    """This is what a format that holds both sides has to say: facts for the sidecar, sentences on how exact
    it is, and on where it fails.
    """

    facts: dict[str, Any]
    sentences: list[str]
    failures: list[str]


def motion_mistake(run: Run, name: str) -> str | None:
    """Say why an estimate has no motion to write."""
    if run.estimates[name].motion is not None:
        return None
    return (
        f"estimate '{name}' has no motion but its pose; name one behind deform, or write the pose with "
        "--format tfm"
    )


def motion_on_grid(run: Run, name: str, spacing: float) -> MotionOnGrid:
    """Return the motion of an estimate on a grid. Raises InputError where it has none."""
    from ...motion.off_wall.field import off_wall
    from ...motion.off_wall.grid import on_grid

    if why := motion_mistake(run, name):
        raise InputError(f"export: {why}")
    case, estimate = run.case, run.estimates[name]
    field = off_wall(recorded(case, estimate))
    turn, turn_map, pose = lps_pose(case, estimate)
    return MotionOnGrid(field, on_grid(field, spacing, turn, pose), spacing, turn, turn_map)


def deviation(motion: MotionOnGrid) -> tuple[Array, Mask, Array]:
    """Return the deviation of a motion and where it is known (nx, ny, nz), and the affine (4, 4) of both."""
    from ...motion.off_wall.grid import grid_nodes, grid_of
    from ...motion.off_wall.settings import SETTINGS

    affine, shape = grid_of(motion.field, SETTINGS.coarser * motion.spacing, motion.turn)
    lps = grid_nodes(affine, shape)
    at = apply(inverse(motion.turn), lps)
    known = motion.field.known(at) & motion.grid.good(lps)
    return motion.field.sd(at).reshape(shape), known.reshape(shape), affine


def write_itk(path: Path, run: Run, name: str, spacing: float) -> Written:
    """Write a motion as transforms of ITK: `path` and its inverse, `.h5`, or `.tfm` with NRRD fields beside
    it; and volumes of its deviation and of where it is known.
    """
    from ...io.images.volumes import write_volume
    from ...io.scenes.displacements import check_itk

    check_itk(path)
    motion = motion_on_grid(run, name, spacing)
    grid = motion.grid
    other = beside(path, "inverse")
    _write_pair(path, inverse(grid.T_map_prior), (grid.back.values, grid.back.affine), field_first=False)
    _write_pair(other, grid.T_map_prior, (grid.there.values, grid.there.affine), field_first=True)
    sd, known, affine = deviation(motion)
    write_volume(beside(path, "sd", ".nrrd"), sd, affine, space="LPS")
    write_volume(beside(path, "known", ".nrrd"), known, affine, space="LPS")
    files = {
        "inverse": other.name,
        "sd_mm": beside(path, "sd", ".nrrd").name,
        "known": beside(path, "known", ".nrrd").name,
    }
    facts = {**motion.facts(), "files": files, "volumes": "on the image, in LPS"}
    return Written(facts, motion.sentences(), motion.failures())


def beside(path: Path, what: str, suffix: str | None = None) -> Path:
    """Return the name of a file that belongs to another one."""
    return path.with_name(f"{path.stem}_{what}{suffix or path.suffix}")


def _write_pair(path: Path, matrix: Array, field: Any, *, field_first: bool) -> None:
    """Write a matrix and a field, of which the field acts first or last."""
    from ...io.scenes.displacements import write_composite, write_vectors
    from ...io.transforms import write_transform

    if path.suffix.lower() == ".h5":
        write_composite(path, [matrix, field] if field_first else [field, matrix])
        return
    write_transform(path, inverse(matrix), "LPS")  # which ITK's file turns around
    write_vectors(beside(path, "field", ".nrrd"), *field)
