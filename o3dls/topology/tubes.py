"""Tubes that points outside the surface trace: veins and handles that the prior lacks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from ..arrays import TINY, Array, Ints
from ..geometry.surface import Surface
from ..levelset.grid.band import Band
from ..levelset.grid.isosurface import zero_set
from .change import Change, body_radius
from .cuts import parts
from .observation import Measured
from .settings import TopologySettings, TubeSettings
from .tube_cost import Foot, cone, losses_with, rarity
from .wall import Wall


def growth(wall: Wall, measured: Measured, settings: TopologySettings) -> Iterator[Change]:
    """Yield tubes whose union with the surface gains, round the points outside that ask for one."""
    there = cache(lambda: _thin_parts(wall.surface, settings))
    for cluster in _cluster_far_points(wall.surface, measured, settings.tubes):
        yield from _propose_tubes(wall, measured, cluster, there, settings.tubes)


def _cluster_far_points(surface: Surface, measured: Measured, settings: TubeSettings) -> Iterator[Array]:
    """Yield groups (k, d) of neighbouring points that lie far outside."""
    far = measured.points[_are_far(measured, settings)]
    if len(far) < settings.seeds:
        return
    count, label = connected_components(
        cdist(far, far) < settings.link * body_radius(surface), directed=False
    )
    yield from (far[label == k] for k in range(count) if (label == k).sum() >= settings.seeds)


def _are_far(measured: Measured, settings: TubeSettings) -> NDArray[np.bool_]:
    """Say which points (n,) lie far outside."""
    return np.asarray(
        (measured.distance > settings.far * measured.likelihood.sigma) & ~measured.likelihood.one_sided
    )


def _propose_tubes(
    wall: Wall,
    measured: Measured,
    cluster: Array,
    there: Callable[[], list[Array]],
    settings: TubeSettings,
) -> Iterator[Change]:
    """Propose likely tubes round a cluster, as changes, where enough points speak for them, away from the
    thin parts that are `there`.
    """
    surface = wall.surface
    radius = body_radius(wall.surface)
    whole = measured
    measured = measured.of(
        np.linalg.norm(measured.points - cluster.mean(axis=0), axis=1) < settings.nearby * radius
    )
    distance, likelihood = measured.distance, measured.likelihood
    before = likelihood.loss(distance - measured.bias)

    def after(tube: Array) -> Array:
        return losses_with(measured.points, tube, distance, measured.bias, *likelihood.numbers)  # type: ignore[no-any-return]

    def cost(tube: Array) -> float:
        return float(after(tube).sum()) + rarity(foot, tube, radius, settings)

    foot = Foot(wall)
    first = _guess_tube(wall, cluster, radius, settings)
    units = np.r_[np.full(2 * surface.dimension, radius), 1.0, 1.0]
    for tube in _refine_tube(cost, first, units, settings):
        gain = before - after(tube)
        witnesses = int((gain > settings.telling).sum())
        if witnesses < settings.witnesses:
            continue
        region = _mesh_tube(tube, surface.dimension, settings.lattice)
        height, feet, _ = wall.nearest(region[0])
        if not _stands_alone(region[0], height, radius, there, settings):
            continue
        exposed = _exposed_area(wall, region, feet)
        if not _of_a_chamber(whole, tube, exposed, radius, settings):
            centre = tube[: 2 * surface.dimension].reshape(2, -1).mean(axis=0)
            rare = rarity(foot, tube, radius, settings)
            gathers = settings.expected_points * exposed / surface.area
            change = Change(False, region, float(gain.sum()), rare, gathers, witnesses, cluster, centre)
            yield replace(change, gain=change.gain - change.price(len(whole.points)))


def _exposed_area(wall: Wall, region: tuple[Array, Ints], feet: Ints) -> float:
    """Return the area of a tube's surface outside the old one, where evenly spread points would show it. feet
    (v,): faces of the old surface next to the tube's vertices.
    """
    tube = Surface(*region)
    outside = wall.nearest(tube.vertices[tube.faces].mean(axis=1), feet[tube.faces[:, 0]])[0] > 0.0
    return float(tube.face_areas[outside].sum())


def _of_a_chamber(
    measured: Measured, tube: Array, exposed: float, radius: float, settings: TubeSettings
) -> bool:
    """Return whether a tube of so much new wall is a part of another chamber: too wide for a vein at an end,
    or large with far points around it too.
    """
    dimension = measured.points.shape[1]
    area = exposed / radius ** (dimension - 1)
    wide = float(np.exp(tube[2 * dimension : 2 * dimension + 2].max())) > settings.widest * radius
    reach = settings.far * measured.likelihood.sigma
    off = cone(measured.points, tube)
    on = np.abs(off) < reach
    around = (off > reach) & (off < radius)
    far = _are_far(measured, settings)
    return wide or (area > settings.large and bool((far & around).sum() > settings.others * (far & on).sum()))


def _thin_parts(surface: Surface, settings: TopologySettings) -> list[Array]:
    """Return the nodes (k, d) of each thin part that a surface has."""
    found = parts(surface, (settings.tubes.ball,), settings.cuts)
    return [part.field.band.positions[part.core] for part in found]


def _stands_alone(
    vertices: Array, height: Array, radius: float, there: Callable[[], list[Array]], settings: TubeSettings
) -> bool:
    """Return whether a tube, whose vertices have a height (v,) over the wall, sticks out of a body of such a
    radius, away from the thin parts that are there: a bump or a vein out of place is for the fields.
    """
    least = settings.sticks_out * radius
    if height.max() < least:
        return False
    tip = vertices[height.argmax()]
    return all(np.linalg.norm(part - tip, axis=1).min() > least for part in there())


def _guess_tube(wall: Wall, cluster: Array, radius: float, settings: TubeSettings) -> Array:
    """Return a first tube, from the wall through the middle of a cluster to its far end."""
    distance, corners, weights = wall.look(cluster)
    foot = np.einsum("c,cd->d", weights[distance.argmin()], wall.tree.vertices[corners[distance.argmin()]])
    middle = cluster.mean(axis=0)
    far = cluster[distance.argmax()]
    size = np.log(settings.radius * radius)
    start = (
        foot - (middle - foot) / max(float(np.linalg.norm(middle - foot)), TINY) * settings.radius * radius
    )
    return np.concatenate([start, 0.5 * (middle + far), [size, size]])


def _refine_tube(
    cost: Callable[[Array], float], first: Array, units: Array, settings: TubeSettings
) -> Iterator[Array]:
    """Search downhill from a first guess (k,) whose coordinates have `units` (k,). The simplex method
    forgives the kinks of a union, but comes to rest early, so it begins anew from there; where it rested may
    be the better tube once the wall has moved.
    """
    at = first
    before = np.inf

    def moved(x: Array) -> float:
        return cost(at + units * x)

    for step in settings.steps:
        simplex = step * np.vstack([np.zeros(len(units)), np.eye(len(units))])
        found = minimize(
            moved,
            simplex[0],
            method="Nelder-Mead",
            options={
                "initial_simplex": simplex,
                "maxiter": settings.search_iterations,
                "xatol": settings.search_tolerance,
                "fatol": settings.search_tolerance,
                "adaptive": True,
            },
        )
        at = at + units * found.x
        if found.fun < before - settings.another:
            yield at
        before = min(before, float(found.fun))


def _mesh_tube(tube: Array, dimension: int, nodes: float) -> tuple[Array, Ints]:
    """Mesh the tube's surface finely."""
    reach = np.exp(tube[-2:].max())
    step = float(np.exp(tube[-2:].min())) / nodes
    ends = tube[: 2 * dimension].reshape(2, -1)
    low = np.floor((ends.min(axis=0) - reach) / step).astype(np.int64) - 2
    shape = np.ceil((ends.max(axis=0) + reach) / step).astype(np.int64) + 3 - low
    lattice = np.indices(shape).reshape(dimension, -1).T.astype(np.int32)
    band = Band(step, reach, low, tuple(int(n) for n in shape), np.ascontiguousarray(lattice))
    return zero_set(band, cone(band.positions, tube))
