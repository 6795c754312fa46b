"""Distances of lesions, such as sites of ablation: to the next of their line, and to the border of a scar.

A lesion lies on the wall: along the normal its error is that of the wall, in the wall that of its own
measurement. It stays in the map, as do values that were measured there; what belongs to the wall, such as
what its image shows, goes with the wall, so that such a distance has the error of the registration too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.distance import cdist

from ...arrays import TINY, Array, Ints
from ...geometry.surface import Surface, interpolated
from ...motion.wall.samples import SurfaceSamples
from ..projection import project
from .intervals import WIDER
from .numbers import Quantity

LARGEST = "largest gap"


@dataclass(frozen=True, eq=False)
class Lesions:
    """Lesions have names, places xyz (n, 3) in the map frame, the sd (n,) of their errors per axis, in mm,
    and the line that each belongs to, where that is known: those of a line are in its order.
    """

    names: tuple[str, ...]
    xyz: Array
    noise: Array
    lines: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Scar:
    """A scar is where a field (v,) of a surface is below 0. It goes with the wall, or stays in the map."""

    beyond: Array
    of_wall: bool


def draw_lesions(
    samples: SurfaceSamples, lesions: Lesions, scars: Mapping[str, Scar], rng: np.random.Generator
) -> tuple[dict[Quantity, float], dict[Quantity, Array]]:
    """Measure straight distances in mm on a surface, and on each of its k samples, (k,): gaps between the
    lesions of a line, the largest of each line (without lines, of each lesion to the nearest other), and the
    distance of each lesion to each scar, by its name.

    A distance to a scar is 0 within it; there is none where the surface has no such scar.
    """
    surface = samples.surface
    met = project(lesions.xyz, surface)
    corners = surface.faces[met.face]
    normal = np.einsum("nc,ncd->nd", met.weights, surface.vertex_normals[corners])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), TINY)[:, None]
    moved = samples.vertices[:, corners] - surface.vertices[corners]
    moved = WIDER * np.einsum("kncd,nc->knd", moved, met.weights)
    error = lesions.noise[:, None] * rng.standard_normal(moved.shape)
    aside = error - _along(error, normal)
    at = np.concatenate(
        [met.foot[None], met.foot + _along(moved, normal) - aside]
    )  # the surface, its samples
    found = _measure_gaps(lesions, at)
    for name, scar in scars.items():
        slid = scar.of_wall * (moved - _along(moved, normal))
        place = np.concatenate([met.foot[None], met.foot - aside - slid])
        for lesion, far in zip(lesions.names, _measure_far(samples, scar, at, place).T, strict=True):
            found[Quantity(f"distance to {name}", lesion, "mm")] = far
    known = {quantity: far for quantity, far in found.items() if np.isfinite(far[0])}
    return {q: float(far[0]) for q, far in known.items()}, {q: far[1:] for q, far in known.items()}


def _along(vectors: Array, normal: Array) -> Array:
    """Return the part of vectors (k, n, 3) along unit normals (n, 3)."""
    return np.asarray(np.einsum("knd,nd->kn", vectors, normal)[:, :, None] * normal)


def _measure_gaps(lesions: Lesions, at: Array) -> dict[Quantity, Array]:
    found, of_line = dict[Quantity, Array](), dict[str, list[Array]]()
    pairs = _neighbours(lesions.lines) if lesions.lines else _nearest(at[0])
    for a, b in pairs:
        gap = np.linalg.norm(at[:, a] - at[:, b], axis=1)
        found[Quantity("gap", f"{lesions.names[a]} to {lesions.names[b]}", "mm")] = gap
        if lesions.lines:
            of_line.setdefault(lesions.lines[a], []).append(gap)
    largest = {Quantity(LARGEST, line, "mm"): np.max(gaps, axis=0) for line, gaps in of_line.items()}
    return found | largest


def _neighbours(lines: Iterable[str]) -> list[tuple[int, int]]:
    """Return pairs of rows that follow each other in one line."""
    rows = dict[str, list[int]]()
    for row, line in enumerate(lines):
        rows.setdefault(line, []).append(row)
    return [pair for of in rows.values() for pair in pairwise(of)]


def _nearest(at: Array) -> list[tuple[int, int]]:
    """Return each pair of places (n, 3) of which one has no other that is nearer, once."""
    if len(at) < 2:
        return []
    away = cdist(at, at)
    np.fill_diagonal(away, np.inf)
    return sorted({(min(k, other), max(k, other)) for k, other in enumerate(away.argmin(axis=1).tolist())})


def _measure_far(samples: SurfaceSamples, scar: Scar, at: Array, place: Array) -> Array:
    """Return distances (k + 1, n) from lesions at (k + 1, n, 3), which are at `place` of the surface itself,
    to a scar.
    """
    surface = samples.surface
    ends, share = find_border(surface, scar.beyond)
    if not len(ends):
        return np.full(at.shape[:2], np.nan)
    border, far = _between(surface.vertices, ends, share), np.empty(at.shape[:2])
    for k, lesions in enumerate(at):
        moved = k > 0 and scar.of_wall
        there = (
            border + WIDER * (_between(samples.vertices[k - 1], ends, share) - border) if moved else border
        )
        far[k] = cdist(lesions, there).min(axis=1)
    met = project(place.reshape(-1, 3), surface)
    beyond = interpolated(scar.beyond, surface.faces[met.face], met.weights).reshape(far.shape)
    return np.where(beyond < 0.0, 0.0, far)


def find_border(surface: Surface, beyond: Array) -> tuple[Ints, Array]:
    """Return the edges (m, 2) on which a field (n,) of a surface changes its sign, and where on each, as the
    share (m,) of the way from its first end.
    """
    faces = surface.faces
    ends = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])), axis=0)
    first, last = beyond[ends].T
    crossed = (first < 0.0) != (last < 0.0)
    crossed &= np.isfinite(first) & np.isfinite(last)
    return ends[crossed], first[crossed] / (first - last)[crossed]


def _between(vertices: Array, ends: Ints, share: Array) -> Array:
    first, last = vertices[ends[:, 0]], vertices[ends[:, 1]]
    return np.asarray(first + share[:, None] * (last - first))
