"""Where a change is beyond what errors make of none anywhere on the wall, and how far it reaches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ...arrays import TINY, Array, Mask
from ...geometry.surface import Surface
from ..measures.areas import share_below
from ..measures.intervals import LEVEL
from .reach import Differences, draw_reach

REACHES = 0.36  # of its largest change: so far a region goes
TRIED = 100  # samples of a region's area
SEED = 7_219


@dataclass(frozen=True, eq=False)
class ChangedRegion:
    """A changed region has its vertices (n,), its area in mm² and its mean change, with the areas (k,) and
    mean changes (k,) that it may as well have by samples of the errors.
    """

    inside: Mask
    area: float
    areas: Array
    change: float
    changes: Array


def stands_out(change: Array, errors: Array, compared: Mask) -> Mask:
    """Return where a change (n,) is, in standard deviations, larger than the largest anywhere on the wall in
    95 % of the samples of its errors (k, n): of pairs without a change one in twenty has such a place.
    """
    sd = np.maximum(errors.std(axis=0), TINY)
    largest = np.abs(np.where(compared, errors / sd, 0.0)).max(axis=1)
    return np.asarray(np.where(compared, np.abs(change) / sd, 0.0) > np.quantile(largest, LEVEL))


def find_regions(surface: Surface, change: Array, errors: Array, compared: Mask) -> list[ChangedRegion]:
    """Find regions of change (n,), the largest first. Areas are of the surface; else as of `stands_out`.

    A region is what hangs together about a place that stands out, as far as the change is about a third of
    what it is there: errors of place and the way from point to point blur a border. What stands out on the
    slope of a region is of that.
    """
    left = stands_out(change, errors, compared)
    taken = np.zeros(len(change), dtype=bool)
    found = list[ChangedRegion]()
    while left.any():
        peak = int(np.argmax(np.where(left, np.abs(change), -1.0)))
        inside, area = _reach_about(surface, change, compared, peak)
        left &= ~inside
        if not (inside & taken).any():
            areas = [_reach_about(surface, change + error, compared, peak)[1] for error in errors[:TRIED]]
            found.append(_average(surface, inside, (area, np.array(areas)), change, errors))
            taken |= inside
    return sorted(found, key=lambda region: -region.area)


def redraw_regions(
    surface: Surface,
    regions: list[ChangedRegion],
    change: Array,
    errors: Array,
    compared: Mask,
    seen: Differences,
) -> list[ChangedRegion]:
    """Return regions with the borders that the points of the second map leave to them, the largest first:
    their areas are those of borders as likely as one another, the area their mean, and the vertices those
    that most often lie inside, of this area (Vorob'ev's expectation). What hangs together is one region.
    """
    found, taken = list[ChangedRegion](), np.zeros(len(change), dtype=bool)
    rng = np.random.default_rng(SEED)
    for one in regions:
        if (one.inside & taken).any():
            continue
        height = float(change[np.argmax(np.where(one.inside, np.abs(change), -1.0))])
        drawn = draw_reach(surface.faces, one.inside, compared & ~taken, seen, height, rng)
        areas = drawn @ surface.vertex_areas
        order = np.argsort(-drawn.mean(axis=0), kind="stable")
        inside = np.zeros_like(taken)
        inside[order[np.cumsum(surface.vertex_areas[order]) <= areas.mean()]] = True
        if inside.any():  # else no point says that it is there
            found.append(_average(surface, inside, (float(areas.mean()), areas), change, errors))
            taken |= inside
    return sorted(found, key=lambda region: -region.area)


def _average(
    surface: Surface, inside: Mask, areas: tuple[float, Array], change: Array, errors: Array
) -> ChangedRegion:
    share = surface.vertex_areas * inside / (surface.vertex_areas @ inside)
    mean = float(share @ change)
    return ChangedRegion(inside, *areas, mean, mean + errors @ share)


def _reach_about(surface: Surface, change: Array, compared: Mask, peak: int) -> tuple[Mask, float]:
    """Return the vertices (n,) of the region about a vertex, and its area, cut within faces."""
    height = change * np.sign(change[peak])
    level = REACHES * float(height[peak])
    high = compared & (height >= level)
    edges = np.concatenate([surface.faces[:, [0, 1]], surface.faces[:, [1, 2]], surface.faces[:, [2, 0]]])
    edges = edges[high[edges].all(axis=1)]
    graph = sparse.coo_array((np.ones(len(edges)), edges.T), shape=(len(high), len(high)))
    part = connected_components(graph, directed=False)[1]
    inside = high & (part == part[peak])
    faces = inside[surface.faces].any(axis=1) & compared[surface.faces].all(axis=1)
    above = 1.0 - share_below(height[surface.faces[faces]], level)
    return inside, float(surface.face_areas[faces] @ above)
