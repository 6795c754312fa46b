"""Which sites of a study belong to one of its maps: systems list ablation sites of all chambers together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Array
from ...case import Points
from ...geometry.surface import Surface
from .imported import Imported, joined

REACH = 20.0  # mm from its shell and points: beyond the noise of any system no site is on that wall
GAPS = 3.0  # typical gaps between points that a map without a shell reaches beyond them, where that is more
NEARER = 3.0  # mm by which a site lies nearer to another map: two maps of one chamber differ by less


@dataclass(frozen=True, eq=False)
class Anatomy:
    """An anatomy is what a map shows of its chamber: the places of its points (n, 3) and its shell, where it
    has one.
    """

    points: Array
    shell: Surface | None = None

    @property
    def reach(self) -> float:
        """The distance from the map up to which a site may still be on its wall."""
        from scipy.spatial import cKDTree

        if self.shell is not None or len(self.points) < 2:
            return REACH
        gaps = np.asarray(cKDTree(self.points).query(self.points, k=2)[0])
        return max(REACH, GAPS * float(np.median(gaps[:, 1])))

    def distances(self, sites: Array) -> Array:
        """Return the distance of each site (n, 3) to the shell or the nearest point, whichever is nearer."""
        from scipy.spatial import cKDTree

        from ...geometry.closest_point import ClosestPoint

        found = np.full(len(sites), np.inf)
        if len(self.points):
            found = np.minimum(found, cKDTree(self.points).query(sites)[0])
        if self.shell is not None:
            found = np.minimum(found, ClosestPoint(self.shell.vertices, self.shell.faces).distance(sites))
        return found


def of_one_map(sites: Points, own: Anatomy, others: Sequence[Anatomy]) -> tuple[Points, str]:
    """Return the sites that lie on the chamber of a map, and a sentence on those that do not; empty where all
    do.

    A site is another's where it lies farther from this map than its `reach`, or clearly nearer to another
    one. A map that shows no chamber has all of them.
    """
    if len(sites) == 0 or (len(own.points) == 0 and own.shell is None):
        return sites, ""
    off = own.distances(sites.xyz)
    nearest = np.min([np.full(len(sites), np.inf), *(other.distances(sites.xyz) for other in others)], axis=0)
    apart = (off > own.reach) | (nearest < off - NEARER)
    if not apart.any():
        return sites, ""
    said = (
        f"{apart.sum()} of {len(sites)} ablation sites, which lie {off[apart].min():.0f} to "
        f"{off[apart].max():.0f} mm from the shell and the points of this map: they are of another chamber"
    )
    return sites.select(~apart), said


def take_sites(found: Imported, sites: Points, source: str, others: Sequence[Anatomy]) -> int:
    """Join the ablation sites that lie on this map to its points, and say which do not; gives their
    number.
    """
    own = Anatomy(found.points.of("eam").xyz, found.shell.surface if found.shell else None)
    sites, left = of_one_map(sites, own, others)
    found.points = joined(found.points, sites)
    if left:
        found.left.append(f"{source}: {left}")
    return len(sites)
