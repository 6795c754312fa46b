"""Where to map next, in the words of the report: places with their region and their nearest landmark."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...evaluation.next_places import Advice, Place
from ...evaluation.regions import word
from ...evaluation.wall_modes import wall_modes
from ..subject import Subject
from .place_words import describe_place, name_place, nearest_landmark
from .wall_regions import advised, landmarks_in_map, wall_regions

SHOWN = 3  # places in the report
HEAD = (
    "where",
    "error around it, now → with a point",
    "error of the wall, now → with a point",
    "nearest point",
    "place",
)


@dataclass(frozen=True)
class Located:
    """A located place has its region (empty where regions are not known), words for where it lies from the
    nearest landmark, fewer words for both, and that landmark with its distance (empty and None where there is
    none).
    """

    place: Place
    region: str
    beside: str
    name: str
    landmark: str
    landmark_distance: float | None

    @property
    def where(self) -> str:
        """Where the place is, in words such as `roof, 12 mm behind RSPV`."""
        return ", ".join(filter(None, [self.region, self.beside])) or "–"

    @property
    def gain(self) -> str:
        """The error that is expected around the place, without and with a point there."""
        return f"{self.place.near_before:.2f} → {self.place.near_after:.2f}"

    def cells(self) -> list[str]:
        """Return the cells of the place's row in a table, as `HEAD` names its columns."""
        one = self.place
        at = ", ".join(f"{x:.1f}" for x in one.xyz)
        # three digits: one point changes the error of the whole wall little
        return [self.where, self.gain, f"{one.before:.3f} → {one.after:.3f}", f"{one.distance:.1f}", at]

    def record(self) -> dict[str, Any]:
        """Return the place with its region and landmark as plain values, JSON-ready."""
        found = asdict(self.place) | {"xyz": self.place.xyz.tolist()}
        return found | {
            "where": self.where,
            "region": self.region,
            "landmark": self.landmark,
            "landmark_distance": self.landmark_distance,
        }


@lru_cache(maxsize=1)  # the pictures and the section beside them show the same places
def shown_advice(subject: Subject) -> Advice | None:
    """Choose the places that the report proposes for the last estimate; None where that has no joint
    posterior.
    """
    estimate = subject.last.estimate
    if wall_modes(subject.case.prior, estimate.motion) is None:
        return None
    return advised(subject.case, estimate, SHOWN)


def advice(subject: Subject, k: int, reachable: NDArray[np.bool_] | None = None) -> Advice:
    """Choose places for one more point by the last estimate. Raises InputError as `suggest`."""
    return advised(subject.case, subject.last.estimate, k, reachable)


def located(subject: Subject, found: Advice) -> list[Located]:
    """Return the places of an advice, each with its region and its nearest landmark."""
    of = wall_regions(subject, subject.last.estimate.surface)
    marks = landmarks_in_map(subject)
    regions = ["" if of is None else word(int(of[one.vertex])) for one in found.places]
    return [
        Located(
            one,
            region,
            describe_place(subject, one.xyz),
            name_place(subject, one.xyz, region),
            *nearest_landmark(marks, one.xyz),
        )
        for one, region in zip(found.places, regions, strict=True)
    ]
