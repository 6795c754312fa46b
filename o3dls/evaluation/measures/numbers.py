"""What is measured on one surface: volume, areas, openings and distances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ...arrays import TINY, Array, Ints, Mask
from ...geometry.surface import Surface

WHOLE = "wall"  # all of the wall, where there are parts of it too
ML = 1000.0  # mm³
CM2 = 100.0  # mm²


class Quantity(NamedTuple):
    """A quantity is what is measured, where, and its unit."""

    what: str
    where: str
    unit: str


@dataclass(frozen=True, eq=False)
class Parts:
    """Parts say what is measured on a surface of n vertices: `regions` of the wall by name, each the vertices
    (n,) in it; `tubes` by name, each the vertices (n,) beyond a section of it; `places` by name, each the
    vertex that it goes with and its offset (3,) from that; `ways` between two of these, each the vertices
    (k,) that it leads along; and below which of its `thresholds` a field lies.
    """

    regions: Mapping[str, Mask]
    tubes: Mapping[str, Mask] = field(default_factory=dict)
    places: Mapping[str, tuple[int, Array]] = field(default_factory=dict)
    ways: Mapping[tuple[str, str], Ints] = field(default_factory=dict)
    thresholds: tuple[float, ...] = ()
    unit: str = "mV"


def measure_surface(
    surface: Surface, parts: Parts, exists: Mask | None = None, values: Array | None = None
) -> dict[Quantity, float]:
    """Return what is measured on a surface in mm: its volume (ml), areas of regions (cm²) where there is wall
    (exists (n,)), with what of them has values (n,) below the thresholds; areas (cm²) and diameters (mm) of
    the sections of tubes; straight distances (mm) of places, and lengths (mm) of ways along the wall.

    The section of a tube is spanned by the border of its vertices: its area is the length of the sum of the
    area vectors of the faces beyond, which depends on the border alone (Stokes); its diameter is that of the
    circle of this area. A face counts to a region by its corners in it. Shares are of the area where values
    are known, which are linear on each face.
    """
    found = {Quantity("volume", WHOLE, "ml"): surface.volume / ML}
    areas = _areas_by_vertex(surface, parts.thresholds, values)
    there = 1.0 if exists is None else exists.astype(np.float64)
    for name, inside in parts.regions.items():
        area, mapped, *low = (float(inside @ (one * there)) for one in areas)
        found[Quantity("area", name, "cm²")] = area / CM2
        for threshold, below in zip(parts.thresholds, low, strict=False):  # without values there are none
            what = f"below {threshold:g} {parts.unit}"
            found[Quantity(f"area {what}", name, "cm²")] = below / CM2
            found[Quantity(f"share {what}", name, "%")] = 100.0 * below / mapped if mapped > 0.0 else np.nan
    for name, beyond in parts.tubes.items():
        faces = beyond[surface.faces].all(axis=1)
        section = float(np.linalg.norm(surface.face_area_vectors[faces].sum(axis=0)))
        found[Quantity("section area", name, "cm²")] = section / CM2
        found[Quantity("section diameter", name, "mm")] = 2.0 * float(np.sqrt(section / np.pi))
    at = {name: surface.vertices[vertex] + offset for name, (vertex, offset) in parts.places.items()}
    for a, b in combinations(at, 2):
        found[Quantity("distance", f"{a} to {b}", "mm")] = float(np.linalg.norm(at[a] - at[b]))
    for (a, b), way in parts.ways.items():
        steps = np.diff(surface.vertices[way], axis=0)
        found[Quantity("length", f"{a} to {b}", "mm")] = float(np.linalg.norm(steps, axis=1).sum())
    return found


def _areas_by_vertex(surface: Surface, thresholds: tuple[float, ...], values: Array | None) -> list[Array]:
    """Return each vertex's share (n,) of the area; of that where values (n,) are known; and where these lie
    below each threshold.
    """
    faces, area = surface.faces, surface.face_areas
    found = [area, np.zeros(len(area))]
    if values is not None:
        corners = values[faces]
        found[1] = area * np.isfinite(corners).all(axis=1)
        found += [area * share_below(corners, threshold) for threshold in thresholds]
    n = len(surface.vertices)
    return [np.asarray(np.bincount(faces.ravel(), np.repeat(one / 3.0, 3), n)) for one in found]


def share_below(corners: Array, threshold: float) -> Array:
    """Return the share (m,) of the area of triangles in which a field lies below a threshold that is linear
    on each, with values (m, 3) at the corners; 0 where one is not known.
    """
    low = corners < threshold  # not where a value is unknown
    found = np.asarray(low.all(axis=1), dtype=np.float64)
    cut = np.flatnonzero(low.any(axis=1) & (found == 0.0) & np.isfinite(corners).all(axis=1))
    a, b, c = np.sort(corners[cut], axis=1).T
    one_below = threshold <= b  # a corner is cut off, below the threshold or above it
    other = np.where(one_below, b - a, c - b)
    corner = np.where(one_below, threshold - a, c - threshold) ** 2 / ((c - a) * other)
    found[cut] = np.where(one_below, corner, 1.0 - corner)
    return np.asarray(found)


def slopes(surface: Surface, values: Array) -> Array:
    """Return the gradient (n, 3) of values (n,) along the wall, by area the mean of the faces around each
    vertex whose values are known; 0 where there is none.
    """
    corners, normals, areas = surface.vertices[surface.faces], surface.face_normals, surface.face_areas
    at = values[surface.faces]
    # of the linear function on a triangle: each corner's value times the opposite edge, turned by 90 degrees
    edges = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    gradient = np.cross(normals[:, None], edges)
    pulled = (np.nan_to_num(at)[:, :, None] * gradient).sum(axis=1)
    gradient = pulled / np.maximum(2.0 * areas, TINY)[:, None]
    known = np.isfinite(at).all(axis=1) & (areas > 0.0)
    total, weight = np.zeros((len(values), 3)), np.zeros(len(values))
    for k in range(3):
        np.add.at(total, surface.faces[known, k], areas[known, None] * gradient[known])
        weight += np.bincount(surface.faces[known, k], areas[known], len(values))
    return np.asarray(total / np.maximum(weight, TINY)[:, None])


def places_on(surface: Surface, named: Mapping[str, Array]) -> dict[str, tuple[int, Array]]:
    """Return for each named place (3,) the nearest vertex of a surface, and its offset from that."""
    found = dict[str, tuple[int, Array]]()
    for name, at in named.items():
        vertex = int(((surface.vertices - at) ** 2).sum(axis=1).argmin())
        found[name] = vertex, at - surface.vertices[vertex]
    return found


def named_parts(labels: Ints | None, names: Mapping[int, str], wall: Mask) -> dict[str, Mask]:
    """Return the whole wall (n,), and each region of it that labels (n,) say, by its name."""
    found = {WHOLE: wall}
    if labels is not None:
        found |= {name: labels == k for k, name in names.items() if (labels == k).any()}
    return found
