"""The way from one side of a run to the other, for places of any kind: from the prior's image to the map by
the motion, or back by its inverse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from ...arrays import Array, Mask
from ...errors import InputError
from ...geometry.similarity import TURN, apply, scale_of
from .motion_files import motion_mistake
from .placed import On, frame_of, recorded

if TYPE_CHECKING:
    from ...motion.off_wall.field import OffWall
    from ..run import Run

To = Literal["map", "image"]
MANY = 5  # places that a sentence counts, but does not name


class Carried(NamedTuple):
    """These are places (n, 3) on the other side; their deviation (n,); whether the wall tells where they are
    (n,); and where there is no inverse, or the motion folds (n,).
    """

    xyz: Array
    sd: Array
    known: Mask
    failed: Mask

    @property
    def columns(self) -> dict[str, Array]:
        """The values to write beside each place."""
        known = (self.known & ~self.failed).astype(np.float64)
        return {"sd_mm": np.where(self.failed, np.nan, self.sd), "motion_known": known}

    def sentences(self) -> list[str]:
        """Return what a user must hear of it."""
        known = int((self.known & ~self.failed).sum())
        said = [f"{len(self.xyz)} places, of which the wall tells {known}: the others follow the pose more"]
        sd = self.sd[~self.failed]
        if len(sd) and np.isfinite(sd).all():
            said.append(
                f"deviation of the motion there: median {np.median(sd):.2g}, at most {sd.max():.2g} mm"
            )
        return said

    def failures(self) -> list[str]:
        """Return a sentence on places that the motion does not lead to for certain, if there are any."""
        if not self.failed.any():
            return []
        rows = np.flatnonzero(self.failed)
        some = ", ".join(map(str, rows[:MANY].tolist())) + (", ..." if rows[MANY:].size else "")
        return [
            f"THE MOTION FOLDS OR HAS NO INVERSE at {len(rows)} places (from 0: {some}), which may lie "
            "elsewhere: sd_mm is empty there and motion_known 0"
        ]


@dataclass(frozen=True, eq=False)
class Way:
    """A way leads places from one side of a run to the other."""

    field: OffWall
    to: To
    frame_from: str
    frame_to: str

    def __call__(self, xyz: Array, space: str = "unknown") -> Carried:
        """Return places (n, 3), in mm, on the other side; `space` is their frame where their file states it,
        else that of their side.
        """
        at, field = self._on_side(xyz, space), self.field
        if self.to == "map":
            return Carried(field(at), field.sd(at), field.known(at), field.folded(at))
        found = field.inverse(at)
        sd = field.sd(found.places) / scale_of(field.T_map_prior)
        return Carried(found.places, sd, field.known(found.places), found.failed)

    def places(self, xyz: Array, space: str = "unknown") -> Array:
        """Return places (n, 3) on the other side, and nothing of how certain they are."""
        at = self._on_side(xyz, space)
        return self.field(at) if self.to == "map" else self.field.places(at)

    def _on_side(self, xyz: Array, space: str) -> Array:
        """Return places in the frame of the side that they come from."""
        turned = {space, self.frame_from} == {"LPS", "RAS"}
        return apply(TURN, xyz) if turned else np.asarray(xyz, dtype=np.float64)

    @property
    def back(self) -> Way:
        """The way in the other direction."""
        to: To = "image" if self.to == "map" else "map"
        return Way(self.field, to, self.frame_to, self.frame_from)

    def space_of(self, space: str) -> str:
        """Return the frame of what arrives, where things are in `space` at the start."""
        return self.frame_to if self.frame_to != "unknown" else space


def way_of(run: Run, name: str, to: To) -> Way:
    """Return the way of an estimate's motion. Raises InputError where it has none, or the run is in 2D."""
    from ...motion.off_wall.field import off_wall

    if run.case.dimension == 2:
        raise InputError("carry: the case is 2D, and files of images and meshes are in 3D")
    if why := motion_mistake(run, name):
        raise InputError(f"carry: {why}")
    sides: tuple[On, On] = ("prior", "map") if to == "map" else ("map", "prior")
    field = off_wall(recorded(run.case, run.estimates[name]))
    return Way(field, to, *(frame_of(run.case, side) for side in sides))
