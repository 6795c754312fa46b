"""Where a catheter has been: on the body of an atrium and a way into its veins, not all of them, or on a part
of it only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from o3dls import InputError, Surface

from . import wall
from .chamber import Chamber
from .motion import direction
from .sampling import Mask
from .shapes import Array

REACH = 12.0  # mm beyond the body, as far as catheters go into a vein
SHARES: Mapping[str, float] = {"all": 1.0, "skipped": 1.0, "half": 0.5, "threequarters": 0.75}
SAID: Mapping[str, str] = {
    "all": "all veins visited",
    "skipped": "one vein not visited",
    "half": "half of the chamber visited",
    "threequarters": "three quarters of the chamber visited",
}


@dataclass(frozen=True)
class Visits:
    """Which wall is visited: `all` the body and every vein, all but one vein that is `skipped`, or `half` or
    `threequarters` of it all, behind a plane or within a way from a place; veins no deeper than `reach` mm.
    Raises InputError for another word.
    """

    where: str = "all"
    reach: float = REACH

    def __post_init__(self) -> None:
        if self.where not in SHARES:
            raise InputError(f"visits '{self.where}': must be one of {', '.join(SHARES)}")

    def __str__(self) -> str:
        return f"{SAID[self.where]}, to {self.reach:g} mm"

    def missed(self, rng: np.random.Generator, truth: Surface, parts: Chamber) -> Mask:
        """Faces (m,) of a closed surface with these parts where the catheter was not: those with a corner in
        such a place.
        """
        seen = parts.depth <= self.reach
        if self.where == "skipped":
            seen &= parts.tube != _skipped(rng, parts, self.reach)
        if SHARES[self.where] < 1.0:
            seen &= _part(rng, truth, seen, SHARES[self.where])
        return np.asarray(~seen[truth.faces].all(axis=1))


def _skipped(rng: np.random.Generator, parts: Chamber, reach: float) -> int:
    """The number of a tube that is longer than catheters go, all equally probable, or of the longest."""
    long = [k for k in range(parts.tubes) if parts.depth[parts.tube == k].max() > reach]
    return int(rng.choice(long)) if long else 0


def _part(rng: np.random.Generator, truth: Surface, of: Mask, share: float) -> Mask:
    """Vertices (n,) of a share of the wall `of`: on one side of a random plane, or nearest along the wall to
    a random place of it.
    """
    areas = np.where(of, wall.vertex_areas(truth), 0.0)
    start = int(rng.choice(len(areas), p=areas / areas.sum()))
    plane = truth.vertices @ direction(rng)
    along: Array = plane if rng.uniform() < 0.5 else wall.ways(truth, np.array([start]))[0]
    order = np.argsort(along, kind="stable")
    part = np.zeros(len(areas), dtype=bool)
    part[order] = np.cumsum(areas[order]) <= share * areas.sum()
    return part
