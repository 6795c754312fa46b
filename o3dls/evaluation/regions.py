"""Regions of the left atrium's wall by the patient's axes and named places."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..arrays import Array, Ints
from ..geometry.surface import Surface
from ..registration.landmark_names import VEINS, partners

# by the direction from the chamber's middle: left, front, up; the sign that each has
SIDES = {
    "lateral": (0, 1.0),
    "septal": (0, -1.0),
    "anterior": (1, 1.0),
    "posterior": (1, -1.0),
    "roof": (2, 1.0),
    "floor": (2, -1.0),
}
OPENINGS = (*VEINS, "LAA", "MA")
REGIONS = (*SIDES, *OPENINGS)
WORDS = {"LAA": "appendage", "MA": "mitral annulus"} | {name: f"ostium {name}" for name in VEINS}
REACH, OPENS = 10.0, 0.5  # mm about a landmark, and as much more per mm beyond it: veins need not be straight
LEFT, RIGHT = ("LSPV", "LIPV", "LCPV"), ("RSPV", "RMPV", "RIPV", "RCPV")


def regions(surface: Surface, axes: Array, landmarks: Mapping[str, Array]) -> Ints | None:
    """Return the region of each vertex (n,) of a left atrium, a place in `REGIONS`; None where no vein of
    either side is named, so that nothing says that it is one.

    axes (3, 3): unit directions to the patient's left, front and head; landmarks (3,) by name, all in the
    frame of the surface, in mm. A vertex belongs to a landmark within 10 mm of which it lies, or of the
    half-line from it away from the chamber's middle, and half a mm more per mm along that: a vein's ostium
    and what follows it, the appendage, the mitral annulus. All others belong to the side to which they lie
    farthest from the middle, in standard deviations of the chamber along each axis.
    """
    named = list(landmarks)
    places = {OPENINGS[j]: landmarks[named[i]] for i, j in partners(named, OPENINGS).items()}
    if not (places.keys() & set(LEFT) and places.keys() & set(RIGHT)):
        return None
    area = surface.vertex_areas
    middle = area @ surface.vertices / area.sum()
    far = np.column_stack([_distance_off_axis(surface.vertices, at, middle) for at in places.values()])
    wall = far.min(axis=1) > REACH
    offset = (surface.vertices - middle) @ axes.T
    spread = np.sqrt((area * wall) @ offset**2 / (area @ wall))
    sides = np.column_stack([sign * offset[:, k] / spread[k] for k, sign in SIDES.values()])
    opening = np.array([REGIONS.index(name) for name in places])[far.argmin(axis=1)]
    return np.asarray(np.where(wall, sides.argmax(axis=1), opening), dtype=np.int64)


def word(region: int) -> str:
    """Return what a region is called."""
    return WORDS.get(REGIONS[region], REGIONS[region])


def _distance_off_axis(points: Array, at: Array, middle: Array) -> Array:
    """Return the distance (n,) of points (n, 3) from the half-line from a place away from the middle, less
    what it opens by along it.
    """
    out = (at - middle) / np.linalg.norm(at - middle)
    along = np.maximum((points - at) @ out, 0.0)
    return np.asarray(np.linalg.norm(points - at - along[:, None] * out, axis=1) - OPENS * along)
