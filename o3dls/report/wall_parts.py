"""The mapped wall and the wall without points apart: the error that is expected there, the one found at
points that were not fitted, and that of the best baseline at the same points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..evaluation.interpolation import REACH
from ..evaluation.statistics import Difference, paired_difference
from .expected import expected_error
from .markup import Child, Html, millimetres, signed, table, tag
from .subject import SETS, Subject

OUTLINE = "outline"
MAPPED, PRIOR_ONLY = "mapped wall", "no points here: shape from the image alone"


@dataclass(frozen=True)
class Part:
    """A part is one of the wall's: its expected error, the mean error `found` at `n` points that were not
    fitted, and the difference from the baseline there; None where it is not known.
    """

    name: str
    expected: float | None
    found: float | None
    n: int
    gain: Difference | None

    @property
    def short(self) -> str:
        """Its name where there is little room."""
        return "unmapped wall" if self.name == PRIOR_ONLY else self.name

    @property
    def worse(self) -> bool:
        """Whether the baseline is clearly closer here."""
        return self.gain is not None and self.gain.clear and self.gain.mean > 0


def wall_parts(subject: Subject) -> list[Part]:
    """Return the two parts of the last surface; none in 2D, where no wall is told to be unmapped."""
    if subject.case.dimension == 2:
        return []
    expected = expected_error(subject)
    positions, gaps, before = _unfitted_distances(subject)
    far = _without_points(subject, positions)
    return [
        _measure_part(MAPPED, expected.mapped if expected else None, positions, gaps, before, ~far),
        _measure_part(PRIOR_ONLY, expected.prior_only if expected else None, positions, gaps, before, far),
    ]


def compared_parts(subject: Subject) -> list[Part]:
    """Return the parts on which the last estimate is compared with the baseline: in 2D the whole outline."""
    if subject.case.dimension == 3:
        return wall_parts(subject)
    positions, gaps, before = _unfitted_distances(subject)
    return [_measure_part(OUTLINE, None, positions, gaps, before, np.ones(len(gaps), dtype=bool))]


def _measure_part(
    name: str,
    expected: float | None,
    positions: Array,
    gaps: Array,
    before: Array | None,
    rows: NDArray[np.bool_],
) -> Part:
    n = int(rows.sum())
    gain = None if before is None or n < 2 else paired_difference(before[rows], gaps[rows], positions[rows])
    return Part(name, expected, float(gaps[rows].mean()) if n else None, n, gain)


def _unfitted_distances(subject: Subject) -> tuple[Array, Array, Array | None]:
    """Return positions and distances of the set that speaks first, and the baseline's; none where all was
    fitted.
    """
    group = subject.headline
    if group is None or group == "fitted":
        return np.zeros((0, subject.case.dimension)), np.zeros(0), None
    positions, gaps = subject.last.measured(group)
    if subject.first is None:
        return positions, gaps, None
    same, before = subject.first.measured(group, subject.last)
    return positions, gaps, before if np.array_equal(same, positions) else None


def _without_points(subject: Subject, positions: Array) -> NDArray[np.bool_]:
    """Say which positions are on unmapped wall: as the case says of its held-out points, else by distance."""
    from scipy.spatial import cKDTree

    held_out = subject.last.run.held_out
    if subject.headline == "held_out" and held_out is not None and "unseen" in held_out.columns:
        return np.asarray(held_out.columns["unseen"] > 0)
    fitted = subject.case.points.of(*subject.last.fitted).xyz
    return np.asarray(cKDTree(fitted).query(positions)[0] > REACH, dtype=bool)


def parts_table(subject: Subject) -> Html | None:
    """Tabulate the parts of the wall for the first screen."""
    parts = wall_parts(subject)
    if not parts:
        return None
    unit, first = subject.unit, subject.first
    set_ = SETS[subject.headline] if subject.headline not in (None, "fitted") else "no points left out"
    head: list[Child] = [
        f"by part of the wall, {unit}",
        "expected, from the posterior",
        f"measured: {set_}",
        f"best baseline: {first.name}" if first else "no baseline",
        f"{subject.last.name} against it (95 % interval)",
        "n",
    ]
    rows: list[list[Child]] = [
        [
            one.name,
            millimetres(one.expected),
            millimetres(one.found),
            millimetres(one.gain.first if one.gain else None),
            tag("strong", compared(one, unit)) if one.worse else compared(one, unit),
            one.n,
        ]
        for one in parts
    ]
    return tag("div", table(head, rows), class_="parts")


def compared(part: Part, unit: str) -> str:
    """Say in words how the last estimate compares with the baseline on a part."""
    gain = part.gain
    if gain is None:
        return "–"
    if math.isnan(gain.low):
        return f"too few points for an interval ({signed(gain.mean)} {unit})"
    interval = f"({signed(gain.low)} to {signed(gain.high)})"
    if not gain.clear:
        return f"no significant difference {interval}"
    return f"{'closer' if gain.mean < 0 else 'farther'} by {abs(gain.mean):.2f} {unit} {interval}"
