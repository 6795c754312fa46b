"""Maps as catheters take them: along a path, in groups that one electrode array takes at a time or by one tip
that is dragged over the wall, with errors that go together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from o3dls import Points, Surface

from . import motion as moves
from . import sampling
from .sampling import Rows
from .shapes import Array

GROUP = (8, 20)  # points that are taken at one moment, at least, and fewer than
SPREAD = 7.0  # mm: how far the electrodes are from the middle of theirs
UNVISITED = (0.25, 0.5)  # share of the wall
ALONE = 0.5  # mm, sd per axis of what each point has for itself
SHARES = (0.6, 0.25, 0.15)  # of the other errors' variance: groups, breathing, drift
BREATH = (15.0, 40.0)  # points from one breath to the next
KNOTS = 6  # of the drift, which goes straight from one to the next
SECONDS = 0.8  # from one point to the next
DEPTH = (3.0, 10.0)  # mm, how far inside points without contact are
DRAGGED = (0.4, 0.3, 0.3)  # share of the variance that a dragged tip's errors have: pressure, lag, slips
LASTS = 15  # points for which a tip's pressure and its way last
SLIPS = 50  # points from one slip of the reference to the next, in the mean


@dataclass(frozen=True)
class Path:
    """How a catheter maps: number of points, rms error per axis in mm, share of points without contact;
    whether one tip is dragged, or groups are taken.
    """

    points: int = 250
    rms: float = 1.5
    inside: float = 0.05
    dragged: bool = False


def walked(rng: np.random.Generator, truth: Surface, how: Path) -> tuple[Points, Rows]:
    """The mapping points along a path over a wall, with columns `time` (s) and `group`, and the rows of those
    without contact.

    The catheter dwells, goes on to the nearest place that it has not seen, and leaves a quarter to a half of
    the wall out. Errors are one vector per group, breathing along one direction and a drift; of a dragged tip
    pressure along the normal, a lag behind its way, and slips. None of them is a process that the program
    expects; and half a millimetre is each point's own. A dragged tip has no column `group`.
    """
    middles = sampling.sites(rng, truth, 3).xyz
    seen = ~sampling.patches(truth, middles, rng.uniform(*UNVISITED))
    cloud = sampling.sites(rng, truth, 20 * how.points, seen)
    group = np.arange(how.points) if how.dragged else _groups(rng, how.points)
    rows = _tour(rng, cloud.xyz, how.points) if how.dragged else _visits(rng, cloud.xyz, group)
    inside = np.sort(rng.choice(how.points, round(how.inside * how.points), replace=False))
    at = cloud.xyz[rows].copy()
    depth = rng.uniform(*DEPTH, (len(inside), 1))
    at[inside] -= depth * truth.face_normals[cloud.face[rows[inside]]]
    normals = truth.face_normals[cloud.face[rows]]
    together = _drag(rng, cloud.xyz[rows], normals) if how.dragged else _errors(rng, group)
    together *= np.sqrt(max(how.rms**2 - ALONE**2, 0.0) / (together**2).mean())
    xyz = np.round(at + together + ALONE * rng.normal(size=together.shape), 3)
    columns = {"time": np.round(SECONDS * np.arange(how.points), 1)}
    columns |= {} if how.dragged else {"group": group}
    return Points(xyz, np.full(how.points, "eam"), columns), inside


def _groups(rng: np.random.Generator, points: int) -> Rows:
    """The group (n,) of each point."""
    sizes = rng.integers(*GROUP, points)
    return np.repeat(np.arange(points), sizes)[:points]


def _visits(rng: np.random.Generator, cloud: Array, group: Rows) -> Rows:
    """Row in a dense cloud (n,) of each point: of a group those about a place, the next place near it."""
    places = cloud[rng.choice(len(cloud), int(group.max()) + 1, replace=False)]
    rows = np.empty(len(group), dtype=np.int64)
    here, left = places[0], list(range(len(places)))
    for k in range(len(places)):
        nearest = int(np.linalg.norm(places[left] - here, axis=1).argmin())
        here = places[left.pop(nearest)]
        about = np.flatnonzero(np.linalg.norm(cloud - here, axis=1) < SPREAD)
        mine = group == k
        rows[mine] = rng.choice(about, int(mine.sum()), replace=len(about) < mine.sum())
    return rows


def _tour(rng: np.random.Generator, cloud: Array, count: int) -> Rows:
    """Rows in a dense cloud (n,) of a tip that goes from each place to the nearest that it has not seen."""
    left = list(rng.choice(len(cloud), count, replace=False))
    rows = [left.pop()]
    while left:
        nearest = int(np.linalg.norm(cloud[left] - cloud[rows[-1]], axis=1).argmin())
        rows.append(left.pop(nearest))
    return np.asarray(rows)


def _drag(rng: np.random.Generator, at: Array, normals: Array) -> Array:
    """Errors (n, 3), of any size, of a tip that was at places (n, 3) of a wall with these normals."""
    n = len(at)
    window = np.ones(LASTS) / LASTS
    pressure = np.convolve(rng.normal(size=n + LASTS - 1), window, "valid")[:, None] * normals
    way = np.gradient(at, axis=0)
    lag = -np.column_stack([np.convolve(column, window, "same") for column in way.T])
    slips = np.sort(rng.choice(n, max(n // SLIPS, 1), replace=False))
    offset = rng.normal(size=(len(slips) + 1, 3))[np.searchsorted(slips, np.arange(n), side="right")]
    return _mixed(DRAGGED, (pressure, lag, offset))


def _mixed(shares: tuple[float, ...], parts: tuple[Array, ...]) -> Array:
    """Errors (n, 3) of which the parts have these shares of the variance."""
    scales = [np.sqrt(share / ((part**2).mean() + 1e-12)) for share, part in zip(shares, parts, strict=True)]
    return np.asarray(sum(scale * part for scale, part in zip(scales, parts, strict=True)))


def _errors(rng: np.random.Generator, group: Rows) -> Array:
    """Errors (n, 3), of any size, of groups that one array of electrodes takes."""
    n = len(group)
    time = np.arange(n)
    groups = rng.normal(size=(int(group.max()) + 1, 3))[group]
    phase, period = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(*BREATH)
    breathing = np.sin(2.0 * np.pi * time / period + phase)[:, None] * moves.direction(rng)
    knots = np.linspace(0, n - 1, KNOTS)
    drift = np.column_stack([np.interp(time, knots, rng.normal(size=KNOTS)) for _ in range(3)])
    return _mixed(SHARES, (groups, breathing, drift))
