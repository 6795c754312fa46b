"""A part of a map that is shifted: its points carry one offset, because the patient moved or the reference
slipped while they were taken.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ..arrays import Array, Mask

Landmarks = Literal["stay", "move", "part"]


@dataclass(frozen=True, eq=False)
class MapPart:
    """A part has the points on one side of a cut: those taken after `beyond` in their order or, with a
    `direction` (d,), those that lie farther than `beyond` along it; and whether landmarks stay, move along,
    or do what points there do.
    """

    direction: Array | None
    beyond: float
    landmarks: Landmarks = "stay"

    def key(self, points: Array, order: Array) -> Array:
        """Return what `beyond` cuts: place along the direction, or in the order, of points (n, d)."""
        return np.asarray(order if self.direction is None else points @ self.direction, dtype=np.float64)

    def holds(self, points: Array, order: Array) -> Mask:
        """Return which of the points (n, d), taken in an order (n,), are in the part."""
        return np.asarray(self.key(points, order) > self.beyond)

    def holds_marks(self, marks: Array) -> Mask:
        """Return which of the measured landmarks (k, d) move along."""
        if self.landmarks == "part" and self.direction is not None:
            return np.asarray(marks @ self.direction > self.beyond)
        return np.full(len(marks), self.landmarks == "move")

    def other_side(self) -> MapPart:
        """Return the points on the other side of a plane, with the landmarks that this part leaves."""
        assert self.direction is not None
        swapped: dict[Landmarks, Landmarks] = {"stay": "move", "move": "stay", "part": "part"}
        return MapPart(-self.direction, -self.beyond, swapped[self.landmarks])


@dataclass(frozen=True, eq=False)
class MapShift:
    """A shift has a part with its offset (d,), the offset's standard deviation (d,) along the axes, the nats
    by which it explains the points better than a motion alone does, and how many `points` of how many `total`
    it has.
    """

    part: MapPart
    offset: Array
    sd: Array
    evidence: float
    points: int
    total: int

    def without(self, points: Array, order: Array, marks: Mask) -> Array:
        """Return the points (n, d), taken in an order (n,), some of them landmarks, with the offset taken
        out.
        """
        moved = self.part.holds(points, order)
        moved[marks] = self.part.holds_marks(points[marks])
        return np.asarray(points - moved[:, None] * self.offset)

    def other_side(self) -> MapShift:
        """Return this shift seen from the other side of a plane: that part stays, and this one moves back."""
        return replace(
            self, part=self.part.other_side(), offset=-self.offset, points=self.total - self.points
        )

    def record(self) -> dict[str, Any]:
        """Return the shift as run.json holds it."""
        part = self.part
        return {
            "direction": None if part.direction is None else part.direction.tolist(),
            "beyond": part.beyond,
            "landmarks": part.landmarks,
            "offset": self.offset.tolist(),
            "sd": self.sd.tolist(),
            "evidence": self.evidence,
            "points": self.points,
            "total": self.total,
        }

    def sentence(self, unit: str, begin: float | None = None) -> str:
        """Return which points are shifted, by how much and where to. begin: the time of the first of them,
        where points have one.
        """
        length = float(np.linalg.norm(self.offset))
        spread = float(np.sqrt((self.sd**2).mean()))
        along, offset = _format_numbers(self.offset / length, 2), _format_numbers(self.offset, 1)
        return (
            f"{self.points} of {self.total} points, {self._describe_part(unit, begin)}, lie {length:.1f} "
            f"{unit} off the others, along ({along}), offset ({offset}) "
            f"± {spread:.1f} {unit} (evidence {self.evidence:.0f} nats)"
        )

    def _describe_part(self, unit: str, begin: float | None) -> str:
        part = self.part
        if part.direction is None and begin is not None:
            return f"those taken from time {begin:g} on"
        if part.direction is None:
            first = int(np.floor(part.beyond)) + 2
            return f"those taken from point {first} of the file on"
        return f"those beyond the plane ({_format_numbers(part.direction, 2)})·x = {part.beyond:.1f} {unit}"


def _format_numbers(values: Array, digits: int) -> str:
    return ", ".join(f"{value + 0.0:.{digits}f}" for value in np.round(values, digits))
