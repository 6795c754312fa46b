"""What is measured on surfaces: volume, areas, openings and distances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ...arrays import TINY, Array, Ints, Mask
from ...geometry.surface import Surface
from .areas import measure_areas

WHOLE = "wall"  # all of the wall, where there are parts of it too
ML = 1000.0  # mm³
CM2 = 100.0  # mm²
AT_ONCE = 32  # surfaces whose areas by vertex are in memory


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
    (k,) that it leads along; below which of its `thresholds` a field lies; and whether the wall was fitted
    with a template, another person's anatomy.
    """

    regions: Mapping[str, Mask]
    tubes: Mapping[str, Mask] = field(default_factory=dict)
    places: Mapping[str, tuple[int, Array]] = field(default_factory=dict)
    ways: Mapping[tuple[str, str], Ints] = field(default_factory=dict)
    thresholds: tuple[float, ...] = ()
    unit: str = "mV"
    template: bool = False


def measure_surface(
    surface: Surface, parts: Parts, exists: Mask | None = None, values: Array | None = None
) -> dict[Quantity, float]:
    """Return what is measured on one surface, of whose vertices there are exists (n,) and have values (n,).
    Parameters else as of `measure_surfaces`.
    """
    known = None if values is None else values[None]
    there = None if exists is None else exists[None]
    whole, present = measure_surfaces(surface, surface.vertices[None], parts, known, there)
    return {quantity: float(numbers[0]) for quantity, numbers in (whole | present).items()}


def measure_surfaces(
    surface: Surface, vertices: Array, parts: Parts, values: Array | None = None, exists: Mask | None = None
) -> tuple[dict[Quantity, Array], dict[Quantity, Array]]:
    """Return what is measured, (k,) each, on surfaces that have the faces of one and vertices (k, n, 3) in
    mm, as if all of the wall existed: volumes (ml); areas of regions (cm²), with what of them has values (k,
    n) below the thresholds; areas (cm²) and diameters (mm) of the sections of tubes; straight distances (mm)
    of places, and lengths (mm) of ways along the wall. Second, what it is instead where exists (k, n) is
    given: areas of what exists.

    The section of a tube is spanned by the border of its vertices: its area is the length of the sum of the
    area vectors of the faces beyond, which depends on the border alone and is summed along that (Stokes);
    its diameter is that of the circle of this area. A face counts to a region by its corners in it. Shares
    are of the area where values are known, which are linear on each face.
    """
    volumes, whole, present = _sum_areas(surface, vertices, parts, values, exists)
    found = {Quantity("volume", WHOLE, "ml"): volumes / ML} | _name_areas(parts, whole)
    for name, beyond in parts.tubes.items():
        (first, last), turns = _find_border(surface, beyond)
        across = np.einsum("kmd,m->kd", np.cross(vertices[:, first], vertices[:, last]), turns)
        section = 0.5 * np.linalg.norm(across, axis=1)
        found[Quantity("section area", name, "cm²")] = section / CM2
        found[Quantity("section diameter", name, "mm")] = 2.0 * np.sqrt(section / np.pi)
    at = {name: vertices[:, vertex] + offset for name, (vertex, offset) in parts.places.items()}
    for a, b in combinations(at, 2):
        found[Quantity("distance", f"{a} to {b}", "mm")] = np.linalg.norm(at[a] - at[b], axis=1)
    for (a, b), way in parts.ways.items():
        steps = np.diff(vertices[:, way], axis=1)
        found[Quantity("length", f"{a} to {b}", "mm")] = np.linalg.norm(steps, axis=2).sum(axis=1)
    return found, {} if exists is None else _name_areas(parts, present)


def _find_border(surface: Surface, beyond: Mask) -> tuple[Ints, Array]:
    """Return the ends (2, m) of the edges about the faces whose vertices are all beyond (n,), and how often
    (m,) these go along each from its first end to its last, less how often back.
    """
    faces, count = surface.faces[beyond[surface.faces].all(axis=1)], len(beyond)
    a, b = (np.concatenate([faces[:, k - shift] for k in range(3)]) for shift in (1, 0))
    edges, of = np.unique(np.minimum(a, b) * count + np.maximum(a, b), return_inverse=True)
    turns = np.bincount(of, np.where(a < b, 1.0, -1.0), len(edges))
    edges, turns = edges[turns != 0.0], turns[turns != 0.0]
    return np.stack([edges // count, edges % count]), turns


def _sum_areas(
    surface: Surface, vertices: Array, parts: Parts, values: Array | None, exists: Mask | None
) -> tuple[Array, Array, Array]:
    """Return volumes (k,) and by region the areas (r, a, k) of `measure_areas`, of all and of what exists."""
    inside = np.array(list(parts.regions.values()), dtype=np.float64).reshape(-1, vertices.shape[1])
    volumes, whole, present = np.zeros(len(vertices)), list[Array](), list[Array]()
    for first in range(0, len(vertices), AT_ONCE):
        rows = slice(first, first + AT_ONCE)
        known = None if values is None else values[rows]
        volumes[rows], areas = measure_areas(vertices[rows], surface.faces, parts.thresholds, known)
        whole.append(areas @ inside.T)
        there = None if exists is None or exists[rows].all() else exists[rows, None]
        present.append(whole[-1] if there is None else (areas * there) @ inside.T)
    return volumes, np.concatenate(whole).T, np.concatenate(present).T


def _name_areas(parts: Parts, sums: Array) -> dict[Quantity, Array]:
    """Return by region areas (k,), areas below the thresholds and their shares."""
    found = dict[Quantity, Array]()
    for name, (area, mapped, *low) in zip(parts.regions, sums, strict=True):
        found[Quantity("area", name, "cm²")] = area / CM2
        for threshold, below in zip(parts.thresholds, low, strict=False):  # without values there are none
            what = f"below {threshold:g} {parts.unit}"
            share = np.divide(below, mapped, out=np.full(len(mapped), np.nan), where=mapped > 0.0)
            found[Quantity(f"area {what}", name, "cm²")] = below / CM2
            found[Quantity(f"share {what}", name, "%")] = 100.0 * share
    return found


def slopes(surface: Surface, values: Array) -> Array:
    """Return the gradient (n, 3) of values (n,) along the wall, by area the mean of the faces around each
    vertex whose values are known; 0 where there is none.
    """
    faces, areas, at = surface.faces, surface.face_areas, values[surface.faces]
    corners = surface.vertices[faces]
    # of the linear function on a triangle: each corner's value times the opposite edge, turned by 90 degrees
    edges = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    pulled = np.cross(surface.face_normals, np.einsum("mk,mkd->md", np.nan_to_num(at), edges))
    known = np.isfinite(at).all(axis=1) & (areas > 0.0)
    weighed = np.where(known[:, None], 0.5 * pulled, 0.0)  # gradient times area
    weight = np.bincount(faces.ravel(), np.repeat(areas * known, 3), len(values))
    total = [np.bincount(faces.ravel(), np.repeat(weighed[:, axis], 3), len(values)) for axis in range(3)]
    return np.asarray(np.column_stack(total) / np.maximum(weight, TINY)[:, None])


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
