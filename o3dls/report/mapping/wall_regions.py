"""Regions of the last surface, its landmarks in the map, and where in these words a place lies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ...arrays import Array, Ints
from ...evaluation.distances import moved
from ...evaluation.regions import regions
from ...geometry.surface import Surface
from ...registration.landmark_names import partners
from ..subject import Subject
from .views import orientation

FIELD = "region"


def landmarks_in_map(subject: Subject) -> dict[str, Array]:
    """Return named places (3,) in the map: as marked there, and those of the prior alone where the last
    estimate brings them.
    """
    case = subject.case
    marks = case.points.of("landmark")
    names = [str(name) for name in marks.columns.get("name", ())]
    paired = partners(list(case.prior_landmarks), names)
    prior = [name for k, name in enumerate(case.prior_landmarks) if k not in paired]
    found = dict(zip(names, marks.xyz, strict=True))
    if prior:
        at = moved(subject.last.estimate, np.array([case.prior_landmarks[name] for name in prior]))
        found = dict(zip(prior, at, strict=True)) | found
    return found


def wall_regions(subject: Subject, surface: Surface) -> Ints | None:
    """Return the region of each vertex (n,) of a surface in the map; None in 2D, in pixels, and where the
    patient's axes or the veins are not known.
    """
    if subject.case.dimension == 2 or subject.unit != "mm":
        return None
    seen = orientation(subject)
    if not seen.patient:
        return None
    return regions(surface, np.array([seen.left, seen.front, seen.up]), landmarks_in_map(subject))


def with_regions(subject: Subject, surfaces: Mapping[str, Surface]) -> dict[str, Surface]:
    """Return the surfaces, each with its regions as a field, where they are known."""
    found = {name: wall_regions(subject, surface) for name, surface in surfaces.items()}
    return {
        name: surface
        if (of := found[name]) is None
        else replace(surface, fields={**surface.fields, FIELD: of.astype(np.float64)})
        for name, surface in surfaces.items()
    }
