"""Where a place of the wall lies, in words by which a person finds it: how far from the nearest landmark, and
on which side of it, or towards which other landmark.
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
ALONG = 0.7  # cosine of the angle between two ways, 45 degrees, up to which one leads as the other
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
    """Describe where a place (d,) of the map lies from its nearest landmark, such as `12 mm below RIPV`;
    where the patient's axes are not known, by the other landmarks. Empty without landmarks.
    """
    return _write_way(subject, place, brief=False)


def name_place(subject: Subject, place: Array, region: str) -> str:
    """Name a place (d,) of a region (which may be empty) for the first screen, where it has a number or a
    letter in the pictures: by one landmark and one direction, such as `roof, 12 mm below RIPV`; a landmark
    that the region names is not named again, as in `ostium RIPV, 12 mm below`.
    """
    said = _write_way(subject, place, brief=True)
    name, _ = nearest_landmark(landmarks_in_map(subject), place)
    if name and name in region.split():
        said = said.removesuffix(name).strip().removesuffix(" of").removesuffix("at")
    return ", ".join(filter(None, [region, said]))


def _write_way(subject: Subject, place: Array, *, brief: bool) -> str:
    marks = landmarks_in_map(subject)
    name, gap = nearest_landmark(marks, place)
    if gap is None:
        return ""
    if subject.unit == "mm" and gap < HERE:
        return f"at {name}"
    far = f"{gap:.0f} {subject.unit}"
    if len(place) == 3 and subject.unit == "mm" and (seen := orientation(subject)).patient:
        sides = _name_sides(seen, place - marks[name])[: 1 if brief else None]
        return f"{far} {' and '.join(sides)} {name}"
    others = {other: at for other, at in marks.items() if other != name}
    way = _name_way(marks[name], place, others)
    if not (way or brief):
        second, gap = nearest_landmark(others, place)
        way = f" and {gap:.0f} {subject.unit} from {second}" if second else ""
    return f"{far} from {name}{way}"


def _name_sides(seen: Orientation, step: Array) -> list[str]:
    """Name the sides towards which a step (3,) leads, the longest part first, at most two."""
    parts = np.array([seen.left, seen.front, seen.up]) @ step
    order = [int(k) for k in np.argsort(-np.abs(parts))[:2]]
    named = [k for k in order if abs(parts[k]) >= SECOND * abs(parts[order[0]])]
    return [SIDES[k][0 if parts[k] > 0 else 1] for k in named]


def _name_way(start: Array, place: Array, others: Mapping[str, Array]) -> str:
    """Say towards or away from which of the other landmarks the way to a place leads; empty where it leads
    past all of them.
    """
    ways = {name: at - start for name, at in others.items() if (at != start).any()}
    if not ways:
        return ""
    step = (place - start) / np.linalg.norm(place - start)
    cosines = {name: float(way @ step / np.linalg.norm(way)) for name, way in ways.items()}
    name = max(cosines, key=lambda one: abs(cosines[one]))
    if abs(cosines[name]) >= ALONG:
        return f", {'towards' if cosines[name] > 0 else 'away from'} {name}"
    return ""
