"""Families of motion of a real surface, none of which has a term of the engine's own prior of motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from o3dls import InputError, Surface

from . import wall
from .flow import Bundle, flow, piston
from .pose import nearest_similarity
from .shapes import Array
from .surface_motion import arap, regions

FAMILIES: Mapping[str, Callable[[np.random.Generator, Surface], Bundle]] = {
    "arap": arap,
    "flow": flow,
    "piston": piston,
    "regions": regions,
}
LEFT = (1.0, 1.8)  # mm rms across the wall that the best similarity leaves of a motion of strength 1
# at most by this factor (drawn) the volume rises or falls: beyond it all is shrunk or blown up as a whole
VOLUME = (1.1, 1.35)
DRAWS = 24  # motions that are tried before one that folds is made smaller
SMALLER = 0.85


def moved(rest: Surface, family: str, rng: np.random.Generator, strength: float = 1.0) -> Surface:
    """The surface after a motion of a family of which the best similarity leaves `strength` times 1.0 to 1.8
    mm (drawn), see `remains`.

    The volume changes by no more than a heart's: at most by a factor drawn from 1.1 to 1.35, up or down. A
    motion by which a face flips or walls cross that did not is drawn again; where 24 do, the last is made
    smaller until it does not. Raises InputError for a family that there is not.
    """
    if family not in FAMILIES:
        raise InputError(f"no family of motion '{family}': there are {', '.join(FAMILIES)}")
    wanted = strength * rng.uniform(*LEFT)
    limit = rng.uniform(*VOLUME)
    crossed = int(wall.crosses(rest).sum())
    for stream in rng.spawn(DRAWS):
        bundle = _bounded(rest, FAMILIES[family](stream, rest), limit)
        share = _sized(rest, bundle, wanted)
        if _sound(rest, crossed, at := bundle(share)):
            return rest.with_vertices(at)
    while not _sound(rest, crossed, at):
        share *= SMALLER
        at = bundle(share)
    return rest.with_vertices(at)


def remains(rest: Surface, at: Array) -> float:
    """What the best similarity leaves of a motion: rms (mm, by area) of the distance across the moved wall
    between where vertices are (n, 3) and where the similarity takes them; how they slide along it counts
    nothing.
    """
    now = rest.with_vertices(at)
    posed = nearest_similarity(rest.vertices, at)(rest.vertices)
    weight = np.sqrt(wall.vertex_areas(now) / now.area)
    normal = now.vertex_normals
    arm = posed - posed.mean(axis=0)
    slack = np.column_stack([normal, np.cross(arm, normal), (arm * normal).sum(axis=1)])
    gap = ((at - posed) * normal).sum(axis=1)
    weighted = slack * weight[:, None]
    fit = np.linalg.lstsq(weighted, gap * weight, rcond=None)[0]
    return float(np.linalg.norm(gap * weight - weighted @ fit))


def _bounded(rest: Surface, bundle: Bundle, limit: float) -> Bundle:
    """The motion and a change of size, so that the volume changes by no more than a factor."""

    def moved(share: float) -> Array:
        at = bundle(share)
        grown = rest.with_vertices(at).volume / rest.volume
        middle = at.mean(axis=0)
        return np.asarray(middle + np.cbrt(np.clip(grown, 1.0 / limit, limit) / grown) * (at - middle))

    return moved


def _sized(rest: Surface, bundle: Bundle, wanted: float) -> float:
    """The share of a motion of which a similarity leaves as much as wanted."""
    share = wanted
    for _ in range(6):  # about proportional: each step takes one digit or two
        share *= wanted / max(remains(rest, bundle(share)), 1e-9)
    return share


def _sound(rest: Surface, crossed: int, at: Array) -> bool:
    return wall.flipped(rest, at) == 0 and wall.crosses(rest.with_vertices(at)).sum() <= crossed
