"""Waves of activation on a wall: arrival times by the eikonal equation, where the wave starts, blocks, and
re-entry; and what a mapping system measures of them.

The solver is that of Hopf and Lax on triangles: a corner is reached from the opposite edge, over which the
time is linear, by the straight line that takes least time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse.csgraph import dijkstra

from o3dls import Surface

from . import sampling, wall
from .sampling import Mask, Rows
from .shapes import Array

SPEED = (0.6, 1.0)  # m/s, of healthy wall
SLOW, SLOW_RADIUS, SLOW_PATCHES = (0.2, 0.4), (6.0, 12.0), 2  # m/s, mm
VARIES = 12.0  # mm over which the speed of healthy wall varies
START = 4.0  # mm about a focus, where the wave goes straight
BLOCK = (15.0, 35.0)  # mm, length of a line of block
CORE = 16.0  # mm about the axis of a re-entry that conducts nothing
LEAST_CYCLE = 100.0  # ms: what recovers more slowly is not excited again
SHEETS = 4  # turns of a re-entry until it repeats itself
SETTLED = 1e-9  # ms
KINDS = ("focus", "two foci", "block", "re-entry")


@dataclass(frozen=True, eq=False)
class Wave:
    """A wave has the time (n,) in ms at which it arrives at each vertex, NaN where it never does; the speed
    (n,) in m/s there; and the cycle length in ms of a re-entry, None where it starts anew.
    """

    time: Array
    speed: Array
    cycle: float | None = None


def wave(surface: Surface, seed: int, kind: str) -> Wave:
    """A wave on a wall of uneven speed with slow patches. kind: one of `KINDS`."""
    ground, start = np.random.default_rng((seed, 71_429)).spawn(2)
    speed = _draw_speed(ground, surface)
    blocked = np.zeros(len(surface.vertices), dtype=bool)
    if kind == "re-entry":
        for end in start.permutation(wall.far_places(surface, 6)):
            found = _turn_about(surface, speed, int(end))
            if (found.cycle or 0.0) >= LEAST_CYCLE:
                break
        return found
    if kind == "block":
        for _ in range(2):
            blocked |= _draw_block(start, surface)
    allowed = np.flatnonzero(~blocked)
    foci = start.choice(allowed, 2 if kind == "two foci" else 1, replace=False)
    delays = np.append(0.0, start.uniform(0.0, 15.0, len(foci) - 1))
    time = solve_eikonal(surface, speed, dict(zip(foci.tolist(), delays, strict=True)), blocked)
    return Wave(time, speed)


def solve_eikonal(
    surface: Surface, speed: Array, starts: dict[int, float], blocked: Mask | None = None
) -> Array:
    """Times (n,) in ms at which a wave of a speed (n,) in m/s arrives at the vertices that starts at vertices
    at given times; NaN where it never does. Faces at blocked vertices (n,) conduct nothing.

    It is solved on a mesh of half the edge's length.
    """
    fine, parents = _halve(surface)
    slowness = (1.0 / speed)[parents].mean(axis=1)
    stopped: Any = np.zeros(len(parents), dtype=bool) if blocked is None else blocked[parents].all(axis=1)
    faces = fine.faces[~stopped[fine.faces].any(axis=1)]
    time = np.full(len(fine.vertices), np.inf)
    for vertex, begin in starts.items():
        away = np.linalg.norm(fine.vertices - fine.vertices[vertex], axis=1)
        near = (away < START) & ~stopped
        time[near] = np.minimum(time[near], begin + away[near] * slowness[vertex])
    found = _sweep(fine.vertices, faces, slowness, time)[: len(surface.vertices)]
    return np.where(np.isfinite(found), found, np.nan)


def _sweep(vertices: Array, faces: Rows, slowness: Array, time: Array) -> Array:
    """The least times (n,) that are consistent with each other on all faces (m, 3)."""
    corner = np.concatenate([np.roll(faces, k, axis=1) for k in range(3)])  # c is reached from the edge a b
    c, a, b = corner.T
    edge = vertices[b] - vertices[a]
    length = np.linalg.norm(edge, axis=1)
    along = ((vertices[c] - vertices[a]) * edge).sum(axis=1) / length
    height = np.linalg.norm(np.cross(edge, vertices[c] - vertices[a]), axis=1) / length
    slow = slowness[corner].mean(axis=1)
    changed: Any = np.isfinite(time)
    while changed.any():
        there = time < np.inf
        rows = np.flatnonzero((changed[a] | changed[b]) & there[a] & there[b])
        steep = (time[b[rows]] - time[a[rows]]) / (length * slow)[rows]
        inside = np.clip(steep, -1.0 + 1e-9, 1.0 - 1e-9)
        at = np.clip(along[rows] - inside * height[rows] / np.sqrt(1.0 - inside**2), 0.0, length[rows])
        way = np.hypot(along[rows] - at, height[rows])
        reached = time[a[rows]] + (steep * at + way) * slow[rows]
        before = time
        time = before.copy()
        np.minimum.at(time, c[rows], reached)
        changed = time < np.where(np.isfinite(before), before - SETTLED, before)
    return time


def _halve(surface: Surface) -> tuple[Surface, Rows]:
    """The surface with each edge cut in half, and which two vertices (m, 2) each vertex is the middle of."""
    n = len(surface.vertices)
    sides = np.stack([surface.faces, np.roll(surface.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    key, row = np.unique(sides.min(axis=1) * n + sides.max(axis=1), return_inverse=True)
    parents = np.vstack([np.repeat(np.arange(n), 2).reshape(-1, 2), np.column_stack([key // n, key % n])])
    ab, bc, ca = n + row.reshape(-1, 3).T
    a, b, c = surface.faces.T
    corners = ([a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca])
    faces = np.concatenate([np.column_stack(one) for one in corners])
    return Surface(surface.vertices[parents].mean(axis=1), faces), parents


def _turn_about(surface: Surface, speed: Array, end: int) -> Wave:
    """A wave that goes round the axis from a far end of the wall, a vein, through its middle.

    It is solved on sheets that lie on one another, joined where the angle about the axis begins anew: a turn
    leads to the next sheet. After some turns the times of two sheets differ by the cycle length everywhere.
    """
    fine, parents = _halve(surface)
    middle, _ = wall.body(surface)
    axis = surface.vertices[end] - middle
    axis /= np.linalg.norm(axis)
    out = fine.vertices - middle
    across = out - (out @ axis)[:, None] * axis
    first = np.cross(axis, np.roll(axis, 1))
    first /= np.linalg.norm(first)
    angle = np.arctan2(across @ np.cross(axis, first), across @ first)
    turns = np.rint((angle[fine.faces] - angle[fine.faces[:, :1]]) / (2.0 * np.pi))
    step = angle[np.roll(fine.faces, -1, axis=1)] - angle[fine.faces]
    pierced = fine.faces[np.rint(step / (2.0 * np.pi)).sum(axis=1) != 0].ravel()
    away = np.linalg.norm(fine.vertices[:, None] - fine.vertices[pierced], axis=2).min(axis=1)
    kept = ~(away < CORE)[fine.faces].any(axis=1)
    faces, sheet = fine.faces[kept], -turns[kept].astype(np.int64)
    sheet -= sheet.min(axis=1, keepdims=True)  # of a face at the seam, the low angles are a turn on
    n = len(fine.vertices)
    stacked = np.concatenate([faces + n * (sheet + k) for k in range(1, SHEETS)])
    time = np.full(n * (SHEETS + 1), np.inf)
    time[n + np.unique(faces[sheet > 0])] = 0.0  # a whole line that leads away from the axis fires once
    slowness = np.tile((1.0 / speed)[parents].mean(axis=1), SHEETS + 1)
    found = _sweep(np.tile(fine.vertices, (SHEETS + 1, 1)), stacked, slowness, time).reshape(SHEETS + 1, n)
    last, before = (np.where(np.isfinite(one), one, np.nan) for one in (found[SHEETS - 1], found[SHEETS - 2]))
    cycle = float(np.nanmedian(last - before))
    return Wave(last[: len(surface.vertices)] % cycle, speed, cycle)


def _draw_speed(rng: np.random.Generator, surface: Surface) -> Array:
    rough = wall.smoothed(surface, rng.normal(size=(len(surface.vertices), 1)), VARIES)
    rough = wall.smoothed(surface, rough, VARIES)[:, 0]
    rank = np.argsort(np.argsort(rough)) / (len(rough) - 1.0)
    speed = SPEED[0] + (SPEED[1] - SPEED[0]) * rank
    for middle in rng.integers(len(speed), size=SLOW_PATCHES):
        away = wall.ways(surface, np.array([middle]))[0]
        speed = np.where(away < rng.uniform(*SLOW_RADIUS), rng.uniform(*SLOW), speed)
    return np.asarray(speed)


def _draw_block(rng: np.random.Generator, surface: Surface) -> Mask:
    """Vertices (n,) of a line of block: a shortest way between two places."""
    begin = int(rng.integers(len(surface.vertices)))
    asked: Any = {"indices": begin, "return_predecessors": True}
    found = np.zeros(len(surface.vertices), dtype=np.bool_)
    way, before = dijkstra(wall.edges(surface), **asked)
    far = np.flatnonzero((way > BLOCK[0]) & (way < BLOCK[1]))
    at = int(rng.choice(far))
    while at >= 0:
        found[at] = True
        at = int(before[at])
    return np.asarray(found)


@dataclass(frozen=True, eq=False)
class MappedWave:
    """A mapped wave has places (k, 3) as the system tells them, times (k,) in ms, and which are wrong."""

    xyz: Array
    time: Array
    wrong: Mask


def map_wave(
    surface: Surface, found: Wave, seed: int, points: int, *, clustered: bool, place: float = 1.0
) -> MappedWave:
    """Map a wave: points with noise of place (mm per axis) and of 3 to 6 ms, 5 % of them annotated wrongly,
    anywhere in the window.
    """
    rng = np.random.default_rng((seed, 88_117))
    there: Any = np.isfinite(found.time)[surface.faces].all(axis=1)
    hidden: Any = np.zeros(len(surface.faces), dtype=bool)
    if clustered:
        hidden = sampling.patches(surface, sampling.sites(rng, surface, 3).xyz, 0.25)
    density = sampling.clustered(rng, surface, there & ~hidden) if clustered else 1.0 * there
    at = sampling.sites(rng, surface, points, density)
    corners = found.time[surface.faces[at.face]]
    if found.cycle is not None:  # a face in which the time begins anew
        corners = corners - found.cycle * np.rint((corners - corners[:, :1]) / found.cycle)
    time = (corners * at.weights).sum(axis=1) + rng.uniform(3.0, 6.0) * rng.normal(size=points)
    wrong: Any = rng.uniform(size=points) < 0.05
    low, high = np.nanmin(found.time), np.nanmax(found.time)
    time = np.where(wrong, rng.uniform(low - 20.0, high + 20.0, points), time)
    if found.cycle is not None:
        time = time % found.cycle
    return MappedWave(at.xyz + place * rng.normal(size=at.xyz.shape), time, wrong)
