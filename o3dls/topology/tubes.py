"""Tubes that points outside the surface trace: veins and handles that the prior lacks."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from ..arrays import Array, Ints
from ..geometry.surface import Surface
from ..levelset.band import Band
from ..levelset.isosurface import zero_set
from ..levelset.normal_displacement import Wall
from ..levelset.observation import Measured
from .change import TELLING, Change, body_radius
from .cuts import parts

FAR = 2.0  # noise levels off the surface from which a point asks for a tube
LINK = 0.6  # points closer than this, in radii of the body, may trace one tube
# radius of a tube in radii of the body (a vein of 5.5 mm on a body of 16 mm), and the sd of its logarithm
TYPICAL, SPREAD = (
    0.35,
    0.35,
)
UNEVEN = 0.15  # sd of the logarithm of one end's radius over the other's
SEEDS = 3  # far points that start a tube; nearer ones join in
TRACED = 5  # points that must trace a tube: it has eight numbers to be fitted
# how far a tube must stick out, and stay away from the thin parts that are there, in radii of the body
REACHES_OUT = 0.5
NEARBY = 2.0  # points so near to a cluster, in radii of the body, are asked about its tube
THIN = 0.5  # radius of the ball that finds those parts, in radii of the body
LARGE, LARGEST = (
    4.4,
    9.0,
    # new wall, in squared radii of the body, that few veins and that no vein adds: a third of a ball, two
    # thirds
)
# far points around a tube, over those on it, from which a large one is taken for a part of another chamber
OTHERS = 0.2
# points that a new stretch of wall must be expected to gather, over those of evenly spread ones: some walls
# are never touched
SEEN = 0.5
SAME = 0.5  # nats by which a search must come to rest lower, to have found another tube
STEPS = (
    0.05,
    0.2,
    -0.2,
    # first steps of a search and of those after it: of a tube's ends in radii of the body, of its radii's
    # logarithms
)
NODES = 6.0  # lattice nodes in a tube's radius


def growth(wall: Wall, measured: Measured) -> Iterator[Change]:
    """Tubes whose union with the surface gains, round the points outside that ask for one."""
    for cluster in _clusters(wall.surface, measured):
        yield from _tubes(wall, measured, cluster)


def _clusters(surface: Surface, measured: Measured) -> Iterator[Array]:
    """Groups (k, d) of neighbouring points that lie far outside."""
    far = measured.points[_far(measured)]
    if len(far) < SEEDS:
        return
    count, label = connected_components(cdist(far, far) < LINK * body_radius(surface), directed=False)
    yield from (far[label == k] for k in range(count) if (label == k).sum() >= SEEDS)


def _far(measured: Measured) -> NDArray[np.bool_]:
    """Points (n,) that lie far outside."""
    return np.asarray((measured.distance > FAR * measured.likelihood.sigma) & ~measured.likelihood.one_sided)


def cone(points: Array, tube: Array) -> Array:
    """Signed distance (n,), nearly, of points (n, d) from a round-ended cone [start (d), end (d), log radii
    (2)].
    """
    d = points.shape[1]
    start = tube[:d]
    end = tube[d : 2 * d]
    radii = np.exp(tube[2 * d :])
    axis = end - start
    along = np.clip((points - start) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
    gap = np.linalg.norm(points - start - along[:, None] * axis, axis=1)
    return np.asarray(gap - radii[0] - (radii[1] - radii[0]) * along)


def _tubes(wall: Wall, measured: Measured, cluster: Array) -> Iterator[Change]:
    """Likely tubes round a cluster, as changes, where enough points tell for them."""
    surface = wall.surface
    radius = body_radius(wall.surface)
    whole = measured
    measured = measured.of(np.linalg.norm(measured.points - cluster.mean(axis=0), axis=1) < NEARBY * radius)
    distance, likelihood = measured.distance, measured.likelihood
    before = likelihood.loss(distance - measured.bias)

    def after(tube: Array) -> Array:
        return likelihood.loss(np.minimum(distance, cone(measured.points, tube)) - measured.bias)

    def cost(tube: Array) -> float:
        return float(after(tube).sum()) + _rarity(wall, tube, radius)

    for tube in _fitted(
        cost, _first(wall, cluster, radius), np.r_[np.full(2 * surface.dimension, radius), 1.0, 1.0]
    ):
        gain = before - after(tube)
        region = _mesh(tube, surface.dimension)
        witnesses = int((gain > TELLING).sum())
        exposed = _exposed(wall, region)
        if (
            witnesses >= TRACED
            and not _of_a_chamber(whole, tube, exposed, radius)
            and _stands_alone(wall, region[0])
        ):
            centre = tube[: 2 * surface.dimension].reshape(2, -1).mean(axis=0)
            doubt = _rarity(wall, tube, radius) + SEEN * len(whole.points) * exposed / surface.area
            yield Change(False, region, float(gain.sum()) - doubt, doubt, witnesses, cluster, centre)


def _exposed(wall: Wall, region: tuple[Array, Ints]) -> float:
    """Area of a tube's surface outside the old one: evenly spread points would show it."""
    tube = Surface(*region)
    outside = wall.look(tube.vertices[tube.faces].mean(axis=1))[0] > 0.0
    return float(tube.face_areas[outside].sum())


def _of_a_chamber(measured: Measured, tube: Array, exposed: float, radius: float) -> bool:
    """Whether a tube of so much new wall is a part of another chamber: too large for a vein, or large with
    far points around it too.
    """
    area = exposed / radius ** (measured.points.shape[1] - 1)
    reach = FAR * measured.likelihood.sigma
    off = cone(measured.points, tube)
    on = np.abs(off) < reach
    around = (off > reach) & (off < radius)
    far = _far(measured)
    return area > LARGEST or (area > LARGE and bool((far & around).sum() > OTHERS * (far & on).sum()))


def _stands_alone(wall: Wall, region: Array) -> bool:
    """Whether a tube sticks out of the body, away from the thin parts that are there: a bump or a vein out of
    place is for the fields.
    """
    radius = body_radius(wall.surface)
    height = wall.look(region)[0]
    if height.max() < REACHES_OUT * radius:
        return False
    tip = region[height.argmax()]
    others = [
        np.linalg.norm(part.field.band.positions[part.core] - tip, axis=1).min()
        for part in parts(wall.surface, (THIN,))
    ]
    return min(others, default=np.inf) > REACHES_OUT * radius


def _first(wall: Wall, cluster: Array, radius: float) -> Array:
    """A tube from the wall through the middle of a cluster to its far end."""
    distance, corners, weights = wall.look(cluster)
    foot = np.einsum("c,cd->d", weights[distance.argmin()], wall.tree.vertices[corners[distance.argmin()]])
    middle = cluster.mean(axis=0)
    far = cluster[distance.argmax()]
    size = np.log(TYPICAL * radius)
    start = foot - (middle - foot) / max(float(np.linalg.norm(middle - foot)), 1e-12) * TYPICAL * radius
    return np.concatenate([start, 0.5 * (middle + far), [size, size]])


def _rarity(wall: Wall, tube: Array, radius: float) -> float:
    """-log of how common a tube is: of usual radius, even, no longer than need be, and rooted in the body."""
    d = len(tube[:-2]) // 2
    sizes = (tube[-2:] - np.log(TYPICAL * radius)) / SPREAD
    depth = wall.look(tube[None, :d])[0][0] / np.exp(tube[-2])
    length = float(np.linalg.norm(tube[d : 2 * d] - tube[:d])) / radius
    return float(
        0.5 * (sizes**2).sum()
        + 0.5 * ((tube[-1] - tube[-2]) / UNEVEN) ** 2
        + 2.0 * max(depth + 0.5, 0.0) ** 2
        + length
    )


def _fitted(cost: Callable[[Array], float], first: Array, units: Array) -> Iterator[Array]:
    """Downhill from a first guess (k,) whose coordinates have `units` (k,). The simplex method forgives the
    kinks of a union, but comes to rest early, so it begins anew from there; where it rested may be the better
    tube once the wall has moved.
    """
    at = first
    before = np.inf

    def moved(x: Array) -> float:
        return cost(at + units * x)

    for step in STEPS:
        simplex = step * np.vstack([np.zeros(len(units)), np.eye(len(units))])
        found = minimize(
            moved,
            simplex[0],
            method="Nelder-Mead",
            options={
                "initial_simplex": simplex,
                "maxiter": 600,
                "xatol": 0.02,
                "fatol": 0.02,
                "adaptive": True,
            },
        )
        at = at + units * found.x
        if found.fun < before - SAME:
            yield at
        before = min(before, float(found.fun))


def _mesh(tube: Array, dimension: int) -> tuple[Array, Ints]:
    """The tube's surface, finely."""
    reach = np.exp(tube[-2:].max())
    step = float(np.exp(tube[-2:].min())) / NODES
    ends = tube[: 2 * dimension].reshape(2, -1)
    low = np.floor((ends.min(axis=0) - reach) / step).astype(np.int64) - 2
    shape = np.ceil((ends.max(axis=0) + reach) / step).astype(np.int64) + 3 - low
    nodes = np.indices(shape).reshape(dimension, -1).T.astype(np.int32)
    band = Band(step, reach, low, tuple(int(n) for n in shape), np.ascontiguousarray(nodes))
    return zero_set(band, cone(band.positions, tube))
