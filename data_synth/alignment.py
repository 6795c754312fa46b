"""Two anatomies brought near each other, and places that belong together in both."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.optimize import linear_sum_assignment
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from o3dls import Surface

from . import pose, sampling, wall
from .sampling import Rows
from .shapes import Array

SEED = 618_033  # of the samples that two anatomies are compared by: equal anatomies, equal alignment
BODY = (
    1.7  # radii about the centre: what of two anatomies is brought together, without the ends of long veins
)
KEPT = 0.8  # share of the closest pairs that count
ROUGHLY, FINELY = (400, 15), (2500, 40)  # samples and rounds
BEST = 6  # starts that are looked at finely
# mm of mean distance that a pair of veins is worth: bodies are nearly round, and veins tell how they lie
VEIN = 0.1
SCALES = (0.75, 1.33)
RINGS = (0.9, 1.0, 1.1, 1.2, 1.3, 1.4)  # radii, at which veins are cut
WIDEST = 30.0  # mm, of a ring that is a vein's
LONE = 12.0  # mm: rings farther apart do not belong together
TOUCHING = 5.0  # mm: walls nearer to each other may be marked as one place
PLACES = 4


def alongside(prior: Surface, truth: Surface) -> Array:
    """The similarity (4, 4) that takes one anatomy onto another.

    Symmetric ICP with scale between even samples of both bodies (what lies within 1.7 radii of the centre,
    see `wall.body`), the closest four fifths of the pairs each way, from 85 rotations: as the files have
    them, 60 even ones, and the principal axes onto each other in 24 ways. The least mean distance wins, less
    0.1 mm for each pair of veins that lie onto each other (see `common_places`): what is left and what is
    right is told by shape alone, and between unlike hearts it can be wrong.
    """
    sides = [_samples(surface) for surface in (prior, truth)]
    (a, centre, radius), (b, other, into) = sides
    axes = [np.linalg.svd(x - x.mean(axis=0), full_matrices=False)[2] for x in (a, b)]
    axes = [x * np.linalg.det(x) for x in axes]
    turns = [np.eye(3), *Rotation.create_group("I").as_matrix()]
    turns += [axes[1].T @ turn @ axes[0] for turn in Rotation.create_group("O").as_matrix()]
    found = []
    for turn in turns:
        linear = into / radius * turn
        found.append(_icp(a, b, pose.matrix(linear, other - linear @ centre), *ROUGHLY))
    best = sorted(range(len(found)), key=lambda k: found[k][1])[:BEST]
    fine = [_icp(a, b, found[k][0], *FINELY) for k in best]
    return min(fine, key=lambda f: f[1] - VEIN * len(_veins(_posed(prior, f[0]), truth)[0]))[0]


def _posed(surface: Surface, at: Array) -> Surface:
    return surface.with_vertices(pose.under(at, surface.vertices))


def _samples(surface: Surface) -> tuple[Array, Array, float]:
    """Places on the body in random order, its centre, its radius."""
    centre, radius = wall.body(surface)
    at = sampling.sites(np.random.default_rng(SEED), surface, 3 * FINELY[0]).xyz
    return at[np.linalg.norm(at - centre, axis=1) < BODY * radius], centre, radius


def _icp(a: Array, b: Array, start: Array, samples: int, rounds: int) -> tuple[Array, float]:
    """The similarity from a start, and the mean distance that it leaves."""
    a, b = a[:samples], b[:samples]
    tree = cKDTree(b)
    found = start
    for _ in range(rounds + 1):
        moved = pose.under(found, a)
        there, of_b = _nearest(tree, moved)
        back, of_a = _nearest(cKDTree(moved), b)
        near, nearer = there <= np.quantile(there, KEPT), back <= np.quantile(back, KEPT)
        last, cost = found, 0.5 * float(there[near].mean() + back[nearer].mean())
        found = pose.similarity_of(
            np.vstack([a[near], a[of_a[nearer]]]), np.vstack([b[of_b[near]], b[nearer]])
        )
        size = np.cbrt(np.linalg.det(found[:3, :3]))
        found = _sized(found, moved.mean(axis=0), a.mean(axis=0), float(np.clip(size, *SCALES) / size))
    return last, cost


def _nearest(tree: cKDTree, at: Array) -> tuple[Array, Rows]:
    """Distance (n,) to the nearest point of a tree, and its number."""
    distance, row = tree.query(at)
    return np.asarray(distance, dtype=np.float64), np.asarray(row, dtype=np.int64)


def _sized(found: Array, onto: Array, about: Array, factor: float) -> Array:
    """A pose whose scale is changed about where it takes a place."""
    if factor == 1.0:
        return found
    linear = factor * found[:3, :3]
    return pose.matrix(linear, pose.under(found, about[None])[0] - linear @ about)


def common_places(prior: Surface, truth: Surface) -> tuple[Array, Array]:
    """Four places (4, 3) of each of two anatomies that lie onto each other, the same in both as an operator
    would name them.

    Veins first: a sphere about the centre of the truth cuts both anatomies in rings; middles of rings
    no wider than 30 mm that are nearest to each other in pairs, at most 12 mm apart, belong together; the
    sphere with the most pairs is taken. Where there are fewer than four, places of the walls within 5 mm of
    each other, far from those before, are put beside them.
    """
    pairs = _veins(prior, truth)
    gap, beside = _nearest(cKDTree(prior.vertices), truth.vertices)
    touching = np.flatnonzero(gap < TOUCHING)
    walls = prior.vertices[beside[touching]], truth.vertices[touching]
    chosen = list(range(min(len(pairs[0]), PLACES)))
    ours, theirs = [np.vstack([one, other]) for one, other in zip(pairs, walls, strict=True)]
    rest = list(range(len(pairs[0]), len(ours)))
    while len(chosen) < PLACES:
        away = cdist(theirs[rest], theirs[chosen]).min(axis=1) if chosen else np.zeros(len(rest))
        chosen.append(rest[int(away.argmax())])
    return ours[chosen], theirs[chosen]


def _veins(prior: Surface, truth: Surface) -> tuple[Array, Array]:
    """Middles (k, 3) of the veins of both that belong together, the nearest first."""
    centre, radius = wall.body(truth)
    return max((_cut(prior, truth, centre, q * radius) for q in RINGS), key=lambda pairs: len(pairs[0]))


def _cut(prior: Surface, truth: Surface, centre: Array, radius: float) -> tuple[Array, Array]:
    ours, theirs = (_rings(surface, centre, radius) for surface in (prior, truth))
    gap = cdist(ours, theirs)
    rows, columns = linear_sum_assignment(gap)
    order = np.argsort(gap[rows, columns])
    order = order[gap[rows, columns][order] < LONE]
    return ours[rows[order]], theirs[columns[order]]


def _rings(surface: Surface, centre: Array, radius: float) -> Array:
    """Middles (k, 3) of where a sphere cuts tubes of the surface."""
    away = np.linalg.norm(surface.vertices - centre, axis=1)
    links = wall.edges(surface).tocoo()
    a, b = links.coords
    cut = (away[a] < radius) & (away[b] >= radius)
    a, b = a[cut], b[cut]
    share = ((radius - away[a]) / (away[b] - away[a]))[:, None]
    at = surface.vertices[a] + share * (surface.vertices[b] - surface.vertices[a])
    of_face = _shared_faces(surface, a, b)
    _, ring = connected_components(of_face)
    rings = [at[ring == k] for k in range(ring.max() + 1)] if len(at) else []
    tubes = [r.mean(axis=0) for r in rings if len(r) > 2 and np.linalg.norm(np.ptp(r, axis=0)) < WIDEST]
    return np.array(tubes).reshape(-1, 3)


def _shared_faces(surface: Surface, a: Array, b: Array) -> sparse.csr_array:
    """Which cut edges (k,) lie on one face: matrix (k, k)."""
    n = len(surface.vertices)
    number = sparse.csr_array((np.arange(1, len(a) + 1), (np.minimum(a, b), np.maximum(a, b))), shape=(n, n))
    f = surface.faces
    ends = [(f[:, k], f[:, (k + 1) % 3]) for k in range(3)]
    of = np.stack([np.asarray(number[np.minimum(u, v), np.maximum(u, v)]).ravel() for u, v in ends], axis=1)
    of = -np.sort(-of[(of > 0).sum(axis=1) == 2], axis=1)[:, :2] - 1
    return sparse.csr_array((np.ones(len(of)), (of[:, 0], of[:, 1])), shape=(len(a),) * 2)
