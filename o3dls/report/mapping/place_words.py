"""Where a place of the wall lies, in words by which a person finds it: how far from the nearest landmark, and
on which side of it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...arrays import Array
from ..subject import Subject
from .views import Orientation, orientation
from .wall_regions import landmarks_in_map

HERE = 3.0  # mm from a landmark, within which a place is at it
SECOND = (
    0.5  # of the longest step, from which a second one is named: the direction is off by at most 27 degrees
)
# towards the patient's left, front and head, and away from them
SIDES = (("left of", "right of"), ("in front of", "behind"), ("above", "below"))


def nearest_landmark(marks: Mapping[str, Array], place: Array) -> tuple[str, float | None]:
    """Return the name of the landmark nearest to a place and the distance to it; empty and None without
    landmarks.
    """
    gaps = {name: float(np.linalg.norm(at - place)) for name, at in marks.items()}
    name = min(gaps, key=gaps.__getitem__, default="")
    return name, gaps.get(name)


def describe_place(subject: Subject, place: Array) -> str:
    """Describe where a place (d,) of the map lies from its nearest landmark, such as `12 mm below RIPV`; by
    the prior's axes, as the views are named, where the patient's are not known. Empty without landmarks.
    """
    marks = landmarks_in_map(subject)
    name, gap = nearest_landmark(marks, place)
    if gap is None:
        return ""
    far = f"{gap:.0f} {subject.unit}"
    if len(place) == 2 or subject.unit != "mm":
        return f"{far} from {name}"
    if gap < HERE:
        return f"at {name}"
    seen = orientation(subject)
    sides = _name_sides(seen, place - marks[name])
    if seen.patient:
        return f"{far} {' and '.join(sides)} {name}"
    return f"{far} from {name} towards prior {', '.join(one.removeprefix('prior ') for one in sides)}"


def _name_sides(seen: Orientation, step: Array) -> list[str]:
    """Name the sides towards which a step (3,) leads, the longest part first, at most two."""
    parts = np.array([seen.left, seen.front, seen.up]) @ step
    words = SIDES if seen.patient else seen.sides()
    order = [int(k) for k in np.argsort(-np.abs(parts))[:2]]
    named = [k for k in order if abs(parts[k]) >= SECOND * abs(parts[order[0]])]
    return [words[k][0 if parts[k] > 0 else 1] for k in named]
