"""Outward normals of points: planes through their neighbours, turned until the winding number of all of them
agrees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from ...arrays import ROUNDING, Array, Ints, Mask
from ...geometry.similarity import rms_radius
from ..field.moved_prior import MovedPrior
from ..neighbours import SEED, nearest
from ..settings import NormalSettings
from .dipoles import DipolePlaces, cells


@dataclass(frozen=True, eq=False)
class Planes:
    """Planes through the neighbours of points have unit normals (n, 3), of either side, a place (n, 3) on
    each, the standard deviation (n,) of each normal in radians that the neighbours' scatter leaves, and
    whether (n,) the neighbours lie in a plane at all.
    """

    normals: Array
    middles: Array
    tilt: Array
    flat: Mask


def planes(points: Array, believed: Mask, radius: float, settings: NormalSettings) -> Planes:
    """Fit planes through the believed points around each point (n, 3)."""
    rows = np.flatnonzero(believed)
    chosen = rows[_thin_points(points[rows], settings.thinning * radius)]
    if len(chosen) < settings.least:
        chosen = rows
    count = min(settings.most + 1, len(chosen))
    gap, near = nearest(points[chosen], points, count)
    width = 0.5 * np.maximum(radius, gap[:, min(settings.least, count) - 1])
    weight = np.exp(-0.5 * (gap / width[:, None]) ** 2)
    weight[chosen[near] == np.arange(len(points))[:, None]] = 0.0  # a point has no say on its own plane
    at = points[chosen][near]
    middle = np.einsum("nk,nkd->nd", weight, at) / weight.sum(axis=1)[:, None]
    apart = at - middle[:, None, :]
    spread = np.einsum("nk,nka,nkb->nab", weight, apart, apart)
    squares, axes = np.linalg.eigh(spread)
    thick, narrow = squares[:, 0], squares[:, 1]
    along = np.einsum("nka,na->nk", apart, axes[:, :, 1])
    pull = ((weight * along) ** 2).sum(axis=1) / weight.sum(axis=1)
    # the first-order deviation of an eigenvector; where two directions scatter alike there is no normal
    tilt = np.sqrt(thick * pull) / np.maximum(narrow - thick, ROUNDING)
    flat = thick <= settings.flat * narrow
    return Planes(axes[:, :, 0], middle, np.minimum(tilt, settings.most_tilt), flat)


def _thin_points(points: Array, width: float) -> Ints:
    """Return the rows of one point, chosen at random, of every occupied cell of a width."""
    order = np.random.default_rng(SEED).permutation(len(points))
    cells = np.floor(points[order] / width).astype(np.int64)
    return np.sort(order[np.unique(cells, axis=0, return_index=True)[1]])


def turned_outward(
    points: Array,
    normals: Array,
    areas: Array,
    prior: MovedPrior,
    settings: NormalSettings,
    before: Array | None = None,
) -> Array:
    """Return the normals (n, 3) turned to the side that the moved prior looks to at first (or to that of
    earlier ones, `before`), then to where the winding number of points, each with an area (n,), and of the
    prior where there are none, falls.

    Normals of a closed wall agree with the gradient of the winding number that they make (Lin, Shi and Liu
    2024): those of a vein that the prior lacks come right though it cannot say.
    """
    if before is None:
        normals = _like_the_prior(points, normals, prior, settings)
    else:
        normals = normals * _unit_signs((normals * before).sum(axis=1))[:, None]
    between = float(np.sqrt(np.median(areas)))
    cell = cells(points, settings.cell * _prior_radius(prior))
    number = np.bincount(cell)
    at = np.column_stack([np.bincount(cell, x) / number for x in points.T])
    further, unmapped = _prior_dipoles(points, prior, settings.prior_distance * between, settings)
    least = settings.cell * _prior_radius(prior)
    smooth = np.maximum(settings.smoothing * np.sqrt(np.bincount(cell, areas)), least)
    every = np.vstack([at, further])
    sources = DipolePlaces.of(
        every, settings.far_cell * _prior_radius(prior), settings.far * _prior_radius(prior)
    )
    far = np.full(len(further), 2.0 * least)
    first = 0 if before is None else settings.rounds - settings.rounds_again
    turned = list[int]()
    for k in range(first, settings.rounds):
        strength = np.column_stack([np.bincount(cell, areas * x) for x in normals.T])
        wider = 2.0 - k / max(settings.rounds - 1, 1)
        dipoles = np.vstack([strength, unmapped])
        fall, winding = sources.winding(at, dipoles, np.r_[wider * smooth, far])
        signs = _unit_signs((normals * fall[cell]).sum(axis=1))
        # the winding number is 1/2 on a wall, and -1/2 on one that is inside out as a whole, with whose
        # normals its fall agrees
        if k % 2:
            signs *= _unit_signs(winding[cell] + settings.inverted)
        normals = normals * signs[:, None]
        turned.append((signs < 0.0).sum())
        if sum(turned[-2:]) == 0 and k > first:
            break
    return normals


def _like_the_prior(points: Array, normals: Array, prior: MovedPrior, settings: NormalSettings) -> Array:
    """Return the normals (n, 3) that agree with their neighbours', trees of these with the moved prior, and
    those near its wall with it.
    """
    facing = prior.slope(points)
    side = (normals * facing).sum(axis=1)
    seen = np.linalg.norm(facing, axis=1) > settings.least_slope
    normals = _along_tree(points, normals, np.where(seen, side, 0.0), settings.tree_neighbours)
    near = seen & (np.abs(prior.at(points)) < settings.prior_near * prior.clip)
    normals[near] *= _unit_signs((normals * facing).sum(axis=1))[near, None]
    return normals


def _along_tree(points: Array, normals: Array, sides: Array, neighbours: int) -> Array:
    """Return the normals (n, 3) that agree along the minimum spanning tree of the angles between neighbours
    (Hoppe et al. 1992), each tree turned to where most of `sides` (n,), signed, are positive.
    """
    count = len(points)
    near = nearest(points, points, min(neighbours, count - 1) + 1)[1][:, 1:]
    rows = np.repeat(np.arange(count), near.shape[1])
    cosine = np.abs((normals[rows] * normals[near.ravel()]).sum(axis=1))
    graph = csr_matrix((1.0 + ROUNDING - cosine, (rows, near.ravel())), shape=(count, count))
    tree = minimum_spanning_tree(graph.maximum(graph.T))
    trees, tree_of = connected_components(tree, directed=False)
    turn: Array = np.ones(count)
    for k in range(trees):
        order, before = breadth_first_order(tree, int(np.argmax(tree_of == k)), directed=False)
        for node in order[1:]:
            other = before[node]
            turn[node] = turn[other] * (1.0 if normals[node] @ normals[other] >= 0.0 else -1.0)
    votes = np.asarray(np.bincount(tree_of, turn * sides, minlength=trees), dtype=np.float64)
    return normals * (turn * _unit_signs(votes)[tree_of])[:, None]


def _unit_signs(values: Array) -> Array:
    return np.asarray(np.where(values < 0.0, -1.0, 1.0))


def _prior_radius(prior: MovedPrior) -> float:
    return rms_radius(prior.surface.vertices)


def _prior_dipoles(
    points: Array, prior: MovedPrior, distance: float, settings: NormalSettings
) -> tuple[Array, Array]:
    """Return the places (k, 3) of the prior's wall that no point is near, and area times normal (k, 3)
    there.
    """
    surface = prior.surface
    middle = surface.vertices[surface.faces].mean(axis=1)
    alone = nearest(points, middle, 1)[0][:, 0] > distance
    if not alone.any():
        return np.zeros((0, 3)), np.zeros((0, 3))
    area = surface.face_areas[alone]
    cell = cells(middle[alone], settings.prior_cell * _prior_radius(prior))
    total = np.maximum(np.bincount(cell, area), ROUNDING)
    at = np.column_stack([np.bincount(cell, area * x) / total for x in middle[alone].T])
    return at, np.column_stack([np.bincount(cell, area * x) for x in surface.face_normals[alone].T])
