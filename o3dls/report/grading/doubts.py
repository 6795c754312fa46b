"""Regions of the last surface not to rely on: those that left-out points contradict, then those that are
mostly without points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Ints, Mask
from ...evaluation.next_places import MEAN_OVER_SD
from ...evaluation.regions import word
from ...geometry.surface import Surface
from ..mapping.wall_regions import wall_regions
from ..subject import Subject
from .check import Check, worst_grade
from .expected_error import contradicted_regions

NAMED = 3  # on the first screen and in the pictures; the tables have all
UNMAPPED = 0.5  # share of a region without points from which its shape is that of the image


@dataclass(frozen=True, eq=False)
class Doubt:
    """A doubt is a region not to rely on: its name, its error with the reason, and a place (3,) on its
    wall.
    """

    name: str
    said: str
    place: Array


def doubted_regions(subject: Subject, found: Sequence[Check]) -> list[Doubt]:
    """Return the regions not to rely on, the worst first; none where a check failed, as then all is in
    doubt.
    """
    surface = subject.last.estimate.surface
    of = None if worst_grade(found) == "bad" else wall_regions(subject, surface)
    return [] if of is None else [*_contradicted(subject, surface, of), *_unmapped(subject, surface, of)]


def _contradicted(subject: Subject, surface: Surface, of: Ints) -> Iterator[Doubt]:
    for region, one in contradicted_regions(subject).items():
        said = f"{one.distance:.1f} {subject.unit} at {one.count} left-out points"
        yield Doubt(word(region), said, _middle_of(surface, of == region))


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
            f"no points, {error:.1f} {unit} by the model",
            _middle_of(surface, (of == region) & (far > 0)),
        )
        for region, error in worst
    ]


def _middle_of(surface: Surface, part: Mask) -> Array:
    """Return the vertex (3,) of a part that lies nearest to its middle."""
    at, area = surface.vertices[part], surface.vertex_areas[part]
    return np.asarray(at[np.linalg.norm(at - area @ at / area.sum(), axis=1).argmin()])
