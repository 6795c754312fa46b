"""Maps as catheters take them: along a path, in groups that one electrode array takes at a time, with errors
that go together.
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


@dataclass(frozen=True)
class Path:
    """How a catheter maps: number of points, rms error per axis in mm, share of points without contact."""

    points: int = 250
    rms: float = 1.5
    inside: float = 0.05


def walked(rng: np.random.Generator, truth: Surface, how: Path) -> tuple[Points, Rows]:
    """The mapping points along a path over a wall, with columns `time` (s) and `group`, and the rows of those
    without contact.

    The catheter dwells, goes on to the nearest place that it has not seen, and leaves a quarter to a half of
    the wall out. Errors are one vector per group, breathing along one direction and a drift, none of them a
    process that the program expects, and half a millimetre of each point's own.
    """
    middles = sampling.sites(rng, truth, 3).xyz
    seen = ~sampling.patches(truth, middles, rng.uniform(*UNVISITED))
    cloud = sampling.sites(rng, truth, 20 * how.points, seen)
    group = _groups(rng, how.points)
    rows = _visits(rng, cloud.xyz, group)
    inside = np.sort(rng.choice(how.points, round(how.inside * how.points), replace=False))
    at = cloud.xyz[rows].copy()
    depth = rng.uniform(*DEPTH, (len(inside), 1))
    at[inside] -= depth * truth.face_normals[cloud.face[rows[inside]]]
    xyz = np.round(at + _errors(rng, group, how.rms), 3)
    columns = {"time": np.round(SECONDS * np.arange(how.points), 1), "group": group}
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


def _errors(rng: np.random.Generator, group: Rows, rms: float) -> Array:
    """Errors (n, 3) of this rms per axis."""
    n = len(group)
    time = np.arange(n)
    groups = rng.normal(size=(int(group.max()) + 1, 3))[group]
    phase, period = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(*BREATH)
    breathing = np.sin(2.0 * np.pi * time / period + phase)[:, None] * moves.direction(rng)
    knots = np.linspace(0, n - 1, KNOTS)
    drift = np.column_stack([np.interp(time, knots, rng.normal(size=KNOTS)) for _ in range(3)])
    together = np.zeros((n, 3))
    for share, part in zip(SHARES, (groups, breathing, drift), strict=True):
        together += np.sqrt(share / ((part**2).mean() + 1e-12)) * part
    together *= np.sqrt(max(rms**2 - ALONE**2, 0.0) / (together**2).mean())
    return np.asarray(together + ALONE * rng.normal(size=(n, 3)))
