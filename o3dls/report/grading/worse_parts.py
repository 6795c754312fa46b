"""Parts of the mapped wall of which the model is clearly less sure than of the rest, where that matters.

Parts whose left-out points lie far off are not among them: on cases with known truth, the surface, which has
these points, is as near to the wall there as elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...arrays import Array, Mask
from ...evaluation.interpolation import REACH
from ...evaluation.next_places import MEAN_OVER_SD
from ..subject import Subject

WORSE = 2.0  # times the mean of the mapped wall: less is hardly seen in the pictures
NOTABLE = 2.0  # mm: less than the tip of an ablation catheter is wide (7 to 8 F, 2.3 to 2.7 mm)
APART = 2 * REACH  # mm from part to part
SMALLEST = 0.005  # of the wall: smaller parts by the model are rims of the wall without points


@dataclass(frozen=True, eq=False)
class WorsePart:
    """A worse part has a place (3,) on the wall, and the error in mm that the model expects there."""

    place: Array
    error: float


@lru_cache(maxsize=1)  # pictures and answers name the same parts
def worse_parts(subject: Subject) -> list[WorsePart]:
    """Return the parts, the worst first; none in 2D and in pixels."""
    if subject.case.dimension == 2 or subject.unit != "mm":
        return []
    return sorted(_list_parts(subject), key=lambda one: -one.error)


def _list_parts(subject: Subject) -> Iterator[WorsePart]:
    """List the parts of the mapped wall where the model expects at least twice the mean error of it, and an
    error that matters.
    """
    surface = subject.last.estimate.surface
    sd, far = (surface.fields.get(name) for name in (f"sd_{subject.unit}", "prior_only"))
    if sd is None or far is None:
        return
    area = np.where((far == 0) & np.isfinite(sd), surface.vertex_areas, 0.0)
    if not area.any():
        return
    error = MEAN_OVER_SD * np.nan_to_num(sd)
    worse = (area > 0) & (error >= WORSE * (area @ error) / area.sum())
    for k, part in _choose_apart(surface.vertices, error, worse):
        if area[part].sum() >= SMALLEST * surface.area:
            mean = float(np.average(error[part], weights=area[part]))
            if mean >= NOTABLE:
                yield WorsePart(surface.vertices[k], mean)


def _choose_apart(places: Array, value: Array, worse: Mask) -> Iterator[tuple[int, Mask]]:
    """Choose the worst of the places (n, 3) that are worse, each with those (n,) near it, then the worst of
    the rest, and so on.
    """
    while worse.any():
        k = int(np.where(worse, value, -np.inf).argmax())
        part = worse & (np.linalg.norm(places - places[k], axis=1) <= APART)
        yield k, part
        worse = worse & ~part
