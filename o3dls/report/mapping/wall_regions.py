"""Regions of the last surface, its landmarks in the map, and where in these words a place lies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Ints
from ...case import Case
from ...estimate import Estimate
from ...evaluation.distances import moved
from ...evaluation.next_places import Advice, suggest
from ...evaluation.regions import regions, unvisited, valve_of
from ...geometry.surface import Surface
from ...registration.landmark_names import partners
from ..subject import Subject
from .views import orientation

FIELD = "region"


def landmarks_in_map(subject: Subject) -> dict[str, Array]:
    """Return named places (3,) in the map by the last estimate."""
    return named_places(subject.case, subject.last.estimate)


def named_places(case: Case, estimate: Estimate) -> dict[str, Array]:
    """Return named places (3,) in the map: as marked there, and those of the prior alone where an estimate
    brings them.
    """
    marks = case.points.of("landmark")
    names = [str(name) for name in marks.columns.get("name", ())]
    paired = partners(list(case.prior_landmarks), names)
    prior = [name for k, name in enumerate(case.prior_landmarks) if k not in paired]
    found = dict(zip(names, marks.xyz, strict=True))
    if prior:
        at = moved(estimate, np.array([case.prior_landmarks[name] for name in prior]))
        found = dict(zip(prior, at, strict=True)) | found
    return found


def advised(case: Case, estimate: Estimate, k: int, reachable: NDArray[np.bool_] | None = None) -> Advice:
    """Choose at most k places for one more point, with landmarks taken for what they are: none in the mitral
    valve, which is no wall, and one in each vein or appendage that has no point. Raises InputError as
    `suggest`.
    """
    surface = estimate.surface
    if case.dimension == 2 or case.units != "mm":
        return suggest(case, estimate, k, reachable=reachable)
    places = named_places(case, estimate)
    wall = ~valve_of(surface, places)
    parts = unvisited(surface, places, estimate.corrected(case).points.of("eam").xyz)
    allowed = wall if reachable is None else wall & reachable
    return suggest(case, estimate, k, reachable=allowed, unvisited=parts)


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
    """Return the surfaces, each with its regions as a field, where they are known. Surfaces with the same
    faces have the same place of the prior at each vertex, and so the regions of the last of them.
    """
    of_faces: dict[bytes, Ints | None] = {}
    keys = {name: surface.faces.tobytes() for name, surface in surfaces.items()}
    last = subject.last.estimate.surface  # whose regions other sections have asked for, or will
    for name, surface in reversed(list(surfaces.items())):
        if keys[name] not in of_faces:
            same = np.array_equal(last.faces, surface.faces)
            of_faces[keys[name]] = wall_regions(subject, last if same else surface)
    return {
        name: surface
        if (of := of_faces[keys[name]]) is None
        else replace(surface, fields={**surface.fields, FIELD: of.astype(np.float64)})
        for name, surface in surfaces.items()
    }
