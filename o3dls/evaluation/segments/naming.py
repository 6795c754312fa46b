"""Names of tubes: which is which vein, and which the appendage, by where they leave the chamber.

The mouths of the tubes and the middle of the chamber are laid on their mean places in forty atria by a
rotation, without mirroring, and a scale from the chamber's size: of all ways to name the tubes, the one
with the least squares is taken. A name for which no tube is left costs `ABSENT`, and a long tube without a
name `SPARE` times its length, so veins that are not there, and more than four, are allowed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from ...arrays import Array
from ...geometry.surface import Surface
from .tubes import Tube

# mean places in units of the chamber's rms radius from its middle: to the left, to the front, up
TEMPLATE = {
    "LSPV": (0.38, -0.24, 1.00),
    "LIPV": (0.54, -0.60, 0.55),
    "RSPV": (-1.28, 0.01, 0.53),
    "RIPV": (-1.14, -0.54, 0.03),
    "LAA": (0.74, 0.24, 0.76),
    "LCPV": (0.46, -0.42, 0.78),
    "RCPV": (-1.21, -0.27, 0.28),
}
VALVE, VALVE_NORMAL = (0.69, 0.17, -0.45), (0.73, 0.52, -0.41)  # its middle, and its direction
# which names go together, and what the set costs: common trunks are rarer
SETS = (
    (("LSPV", "LIPV", "RSPV", "RIPV", "LAA"), 0.0),
    (("LCPV", "RSPV", "RIPV", "LAA"), 7.0),
    (("LSPV", "LIPV", "RCPV", "LAA"), 7.0),
    (("LCPV", "RCPV", "LAA"), 14.0),
)
SCATTER = 0.2  # of a mouth about its mean place, in the same unit
MIDDLE = 0.1  # of the chamber's middle
TURN = 0.35  # rad: how far patients' atria are turned against their axes, where those are known
ABSENT = 9.0  # for a name without a tube, in units of squared deviations
SPARE = 0.3  # for each mm of a tube without a name, up to `LONGEST`
LONGEST = 20.0  # mm
BLIND = 35.0  # mm: an appendage is blind and reaches less far than this; veins are cut anywhere
FAR = 15.0  # mm: a landmark that lies farther from each tube is of a vein that was cut where it begins
CUT = 8.0  # mm about such a landmark
MOST = 8  # tubes that are considered, the longest
LEAST = 3  # names that tell how an atrium lies


@dataclass(frozen=True, eq=False)
class Naming:
    """A naming says which tube each name means, and how the atrium lies: `axes` (3, 3) has the unit
    directions to the left, the front and up in rows, and `cost` says how well the tubes fit the names.
    """

    tubes: dict[str, int]
    axes: Array
    cost: float


def name_tubes(
    surface: Surface, tubes: Sequence[Tube], axes: Array | None = None, named: Mapping[str, int] | None = None
) -> Naming:
    """Return the likeliest names of the tubes of a surface; none where there are fewer than three.

    axes (3, 3): unit directions to the patient's left, front and head, where they are known. named: the names
    that landmarks give, each with its tube.
    """
    given = named or {}
    middle, size = measure_chamber(surface, tubes)
    shown = tubes[:MOST]
    mouths = (np.array([tube.mouth for tube in shown]).reshape(-1, 3) - middle) / size
    reach = np.array([tube.reach for tube in shown])
    length = np.minimum(reach, LONGEST)
    best = Naming({}, np.eye(3) if axes is None else axes, np.inf)
    for names, price in SETS:
        for chosen in _subsets(names, len(shown)):
            of = np.array(list(permutations(range(len(shown)), len(chosen))))
            fits = np.ones(len(of), dtype=bool)
            for name, tube in given.items():
                fits &= of[:, chosen.index(name)] == tube if name in chosen else False
            if not fits.any():
                continue
            of = of[fits]
            cost, turns = _fit_turns(np.array([TEMPLATE[name] for name in chosen]), mouths[of], axes)
            cost += price + ABSENT * (len(names) - len(chosen))
            cost += SPARE * (length.sum() - length[of].sum(axis=1))
            if "LAA" in chosen and "LAA" not in given:
                cost += np.where(reach[of[:, chosen.index("LAA")]] > BLIND, ABSENT, 0.0)
            k = int(cost.argmin())
            if cost[k] < best.cost:
                best = Naming(dict(zip(chosen, map(int, of[k]), strict=True)), turns[k], float(cost[k]))
    return best


def measure_chamber(surface: Surface, tubes: Sequence[Tube]) -> tuple[Array, float]:
    """Return the middle (3,) of the wall without its tubes, and the rms distance of that wall from it."""
    inside = (
        np.any([tube.inside for tube in tubes], axis=0) if tubes else np.zeros(len(surface.vertices), bool)
    )
    area = surface.vertex_areas * ~inside
    middle = area @ surface.vertices / area.sum()
    return middle, float(np.sqrt(area @ ((surface.vertices - middle) ** 2).sum(axis=1) / area.sum()))


def _subsets(names: tuple[str, ...], most: int) -> Iterator[tuple[str, ...]]:
    for count in range(min(len(names), most), LEAST - 1, -1):
        yield from combinations(names, count)


def _fit_turns(target: Array, places: Array, axes: Array | None) -> tuple[Array, Array]:
    """Return the squared deviations (k,), in units of the scatter, of places (k, m, 3) from a target (m, 3)
    that is turned to fit, and the turns (k, 3, 3), whose rows are the axes of the target. The middle of both
    is at 0: places are shifted by what the deviation of the middle allows.
    """
    # the shift that is likeliest: places minus turned target, shrunk by the scatter of the middle
    weight = MIDDLE**2 / (MIDDLE**2 + SCATTER**2 / len(target))
    covariance = np.einsum("ma,kmb->kab", target, places) - weight * len(target) * np.einsum(
        "a,kb->kab", target.mean(axis=0), places.mean(axis=1)
    )
    covariance = covariance / SCATTER**2
    if axes is not None:
        covariance = covariance + axes / (2.0 * TURN**2)
    u, _, vt = np.linalg.svd(covariance)
    u[:, :, 2] *= -np.sign(np.linalg.det(u @ vt))[:, None]  # left, front and up are left-handed
    turn = u @ vt
    gap = places - target @ turn
    shift = gap.mean(axis=1)
    cost = (gap**2).sum(axis=(1, 2)) / SCATTER**2 - weight * len(target) * (shift**2).sum(axis=1) / SCATTER**2
    if axes is not None:
        cost = cost + (3.0 - np.einsum("kab,ab->k", turn, axes)) / TURN**2
    return cost, turn
