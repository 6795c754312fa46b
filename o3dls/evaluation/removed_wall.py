"""How much wall a stage has taken away from a surface."""

from __future__ import annotations

from ..geometry.surface import Surface
from .distances import distances

FAR = (
    2.5  # mm from the new surface beyond which wall counts as removed: half of the shortest tube that matters
)


def removed_wall(before: Surface, after: Surface) -> dict[str, float]:
    """Return `removed_share` of the area of a surface that is far from what a stage made of it, and
    `removed_reach_mm`: how far its farthest place is, which is the length of a tube that was cut off.
    """
    gap = distances(before.vertices, after)
    area = before.vertex_areas
    far = gap > FAR
    reach = float(gap.max()) if far.any() else 0.0
    return {"removed_share": float(area[far].sum() / area.sum()), "removed_reach_mm": reach}
