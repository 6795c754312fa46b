"""The mitral valve of a left atrium whose valve is closed: the flat part of the wall where it is expected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ...arrays import Array, Mask
from ...geometry.surface import Surface
from ..wall_graph import label_pieces

CONE, DIRECTIONS = 0.7, 80  # rad about the direction where it is expected; directions that are tried
LIKELY = 0.35  # rad: deviation of the valve's normal from that direction
ALIKE = 0.85  # cosine of the normals of the flat part to its own
THICK = 5.0  # mm: how far the flat part may lie below its highest place
TURNS = 3  # rounds of taking the mean normal of the flat part
RADIUS = 15.0, 22.0  # mm: least and most of an annulus
SLACK = 1.15  # of the radius of a disk with the area of the flat part: the rim is rounded
FAN, CAP, NEAR = (
    24,
    400.0,
    2.5,
)  # faces about one vertex, mm², and deviations from where a valve is expected: a cap
RIM = 6.0  # mm below the flat part, which belong to the valve too


@dataclass(frozen=True, eq=False)
class Valve:
    """A valve has its vertices inside (n,), its middle (3,) and its unit normal (3,), out of the chamber."""

    inside: Mask
    middle: Array
    normal: Array


@dataclass(frozen=True, eq=False)
class Expected:
    """An expected valve has its unit normal (3,), its middle (3,), and how far off that may be, mm."""

    normal: Array
    middle: Array
    scatter: float


def find_valve(surface: Surface, edges: sparse.coo_array, chamber: Mask, expected: Expected) -> Valve:
    """Find the mitral valve: the fan that closes an opening near where it is expected, else a large flat part
    of the chamber's wall. chamber (n,): vertices in no tube.
    """
    if (cap := _find_cap(surface, chamber, expected)) is not None:
        return cap
    best, centres = -1.0, surface.vertices[surface.faces].mean(axis=1)
    for start in _spread_directions(expected.normal):
        area = _flat_area(surface, chamber, start)
        off = np.linalg.norm(area @ centres / area.sum() - expected.middle) / expected.scatter
        turned = np.arccos(np.clip(start @ expected.normal, -1.0, 1.0)) / LIKELY
        worth = float(area.sum() * np.exp(-0.5 * (off**2 + turned**2)))
        if worth > best:
            best, normal = worth, start
    for _ in range(TURNS):
        mean = _flat_area(surface, chamber, normal) @ surface.face_normals
        mean = mean / np.linalg.norm(mean)
        if mean @ expected.normal < np.cos(CONE):  # it leads to another flat part
            break
        normal = mean
    area = _flat_area(surface, chamber, normal)
    middle = area @ centres / area.sum()
    offset = surface.vertices - middle
    height = offset @ normal
    radius = np.clip(SLACK * np.sqrt(area.sum() / np.pi), *RADIUS)
    across = np.linalg.norm(offset - height[:, None] * normal, axis=1)
    disk = chamber & (height > -RIM) & (across < radius)
    return Valve(label_pieces(edges, disk) == 0, middle, normal)


def _find_cap(surface: Surface, chamber: Mask, expected: Expected) -> Valve | None:
    """Return the valve where it was open and is closed by a fan of faces about one vertex; None where not."""
    faces, count = surface.faces, np.bincount(surface.faces.ravel(), minlength=len(surface.vertices))
    for middle in np.flatnonzero(chamber & (count >= FAN)):
        fan = (faces == middle).any(axis=1)
        normal = surface.face_area_vectors[fan].sum(axis=0)
        off = np.linalg.norm(surface.vertices[middle] - expected.middle) / expected.scatter
        if off < NEAR and surface.face_areas[fan].sum() > CAP and normal @ expected.normal > 0.0:
            inside = np.zeros(len(count), dtype=bool)
            inside[faces[fan]] = True
            return Valve(inside, surface.vertices[middle], normal / np.linalg.norm(normal))
    return None


def _flat_area(surface: Surface, chamber: Mask, normal: Array) -> Array:
    """Return the area (m,) of the faces of the flat part whose normal this is; that of the highest face where
    none is flat.
    """
    height = surface.vertices @ normal
    top = np.where(chamber, height, -np.inf)
    level = (top > top.max() - THICK)[surface.faces].any(axis=1) & chamber[surface.faces].all(axis=1)
    flat = level & (surface.face_normals @ normal > ALIKE)
    if not flat.any():
        flat = (surface.faces == top.argmax()).any(axis=1)
    return np.asarray(surface.face_areas * flat)


def _spread_directions(axis: Array) -> Array:
    """Return unit directions (k, 3) evenly over the cone about an axis, which is the first."""
    k = np.arange(DIRECTIONS)
    cosine = 1.0 - (1.0 - np.cos(CONE)) * k / DIRECTIONS
    angle = k * np.pi * (3.0 - np.sqrt(5.0))
    across = np.linalg.svd(axis[None])[2][1:]
    around = np.column_stack([np.cos(angle), np.sin(angle)]) @ across
    return np.asarray(cosine[:, None] * axis + np.sqrt(1.0 - cosine**2)[:, None] * around)
