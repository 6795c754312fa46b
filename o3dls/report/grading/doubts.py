"""Parts of the last surface not to rely on: regions that left-out points contradict, parts of the mapped wall
of which the model is clearly less sure, and regions that are mostly without points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import Array, Ints, Mask
from ...evaluation.next_places import MEAN_OVER_SD
from ...evaluation.regions import VALVE, short_word, word
from ...geometry.surface import Surface
from ..mapping.place_words import name_place
from ..mapping.wall_regions import wall_regions
from ..subject import Subject
from .check import Check, worst_grade
from .expected_error import at_least, contradicted_regions
from .worse_parts import WorsePart, worse_parts

NAMED = 3  # on the first screen and in the pictures; the tables have all
UNMAPPED = 0.5  # share of a region without points from which its shape is that of the image


@dataclass(frozen=True, eq=False)
class Doubt:
    """A doubt is a part not to rely on: its name, its error with the reason, a place (3,) on its wall, what
    stands there in the pictures (its name if empty), the region that it is or lies in (empty where regions
    are not known), and whether it is a part without points.
    """

    name: str
    said: str
    place: Array
    label: str = ""
    region: str = ""
    unmapped: bool = False


def doubted_regions(subject: Subject, found: Sequence[Check]) -> list[Doubt]:
    """Return the parts not to rely on, the worst of each kind first; none where a check failed, as then all
    is in doubt. Parts and regions without points are named where these are known.
    """
    if worst_grade(found) == "bad":
        return []
    surface = subject.last.estimate.surface
    of = wall_regions(subject, surface)
    if of is None:
        return list(_worse(subject, surface, None))
    return [
        *_contradicted(subject, surface, of),
        *_worse(subject, surface, of),
        *_unmapped(subject, surface, of),
    ]


def _worse(subject: Subject, surface: Surface, of: Ints | None) -> list[Doubt]:
    """List the parts of the mapped wall of which the model is less sure than of the rest, but for those of
    regions that are named as a whole.
    """
    named = [*contradicted_regions(subject), VALVE]  # which is no wall
    tree = cKDTree(surface.vertices)
    found = [(one, None if of is None else int(of[tree.query(one.place)[1]])) for one in worse_parts(subject)]
    kept = [(one, region) for one, region in found if region not in named]
    return [_name_part(subject, k, *one) for k, one in enumerate(kept)]


def _name_part(subject: Subject, k: int, part: WorsePart, region: int | None) -> Doubt:
    """Name the part with number k by its letter in the pictures, its region and its landmarks."""
    letter, inside = chr(ord("A") + k), "" if region is None else word(region)
    where = ", ".join(filter(None, [f"place {letter}", name_place(subject, part.place, inside)]))
    error = f"{part.error:.1f} {subject.unit}"
    return Doubt(where, f"{error} by the model", part.place, f"{letter}: {error}", inside)


def _contradicted(subject: Subject, surface: Surface, of: Ints) -> Iterator[Doubt]:
    for region, one in contradicted_regions(subject).items():
        said = f"{one.distance:.1f} {subject.unit} at {one.count} left-out points"
        name = word(region)
        yield Doubt(name, said, _middle_of(surface, of == region), short_word(region), name)


def _unmapped(subject: Subject, surface: Surface, of: Ints) -> list[Doubt]:
    """List the regions that are mostly without points and that no point contradicts, the worst first, with
    the error that the model expects.
    """
    unit = subject.unit
    sd, far = (surface.fields.get(name) for name in (f"sd_{unit}", "prior_only"))
    if sd is None or far is None:
        return []
    errors = {}
    for region in np.setdiff1d(of, list(contradicted_regions(subject))):
        area = np.where((of == region) & np.isfinite(sd), surface.vertex_areas, 0.0)
        if area.sum() > 0 and area @ far > UNMAPPED * area.sum():
            errors[region] = MEAN_OVER_SD * float(area @ np.nan_to_num(sd) / area.sum())
    worst = sorted(errors.items(), key=lambda item: -item[1])
    return [
        Doubt(
            word(int(region)),
            f"no points, {at_least(subject)}{error:.1f} {unit} by the model",
            _middle_of(surface, (of == region) & (far > 0)),
            short_word(int(region)),
            region=word(int(region)),
            unmapped=True,
        )
        for region, error in worst
    ]


def _middle_of(surface: Surface, part: Mask) -> Array:
    """Return the vertex (3,) of a part that lies nearest to its middle."""
    at, area = surface.vertices[part], surface.vertex_areas[part]
    return np.asarray(at[np.linalg.norm(at - area @ at / area.sum(), axis=1).argmin()])
