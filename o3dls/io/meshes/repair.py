"""Make a prior surface closed and wound outward, or say why it cannot be."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from ...arrays import Array, Ints
from ...errors import Answer, Doubt, InputError
from ...geometry.surface import Surface
from .polyline import trace_loops

SOUP = 0.5  # share of the triangles that share no edge, from which they are a soup
NARROWEST, WIDEST = 1e-6, 1e-3  # of the diagonal: distances within which vertices of free edges may be one
STEP = 3.0  # from one such distance to the next
SHORT = 0.3  # of the shortest free edge, whose two ends must stay two
NOTHING = 1e-6  # of the cube of the diagonal: less is no volume
log = logging.getLogger("o3dls")


def closed_outward(surface: Surface, where: str, *, cap: bool = False) -> Surface:
    """Return the surface welded, wound outward and, where `cap` allows it, with its openings closed by fans.

    Raises InputError where it stays open or an edge has more than two faces.
    """
    if surface.watertight and surface.volume > 0:
        return surface
    surface, tolerance = sewn(welded(surface))
    if tolerance:
        log.info(
            "%s: vertices up to %.2g apart are welded, since its triangles did not meet", where, tolerance
        )
    surface = coherent(surface, where)
    openings = boundary_edges(surface.faces, len(surface.vertices))
    if stand_alone(surface) > SOUP:
        raise InputError(
            f"{where}: most of its triangles share no edge with another, and no weld joins them; a cap would "
            "close each by itself: repair the mesh first, as in MeshLab"
        )
    # before a cap is advised: some openings none can close
    surface = capped(surface, where) if len(openings) else surface
    if len(openings) and not cap and abs(surface.volume) >= NOTHING * surface.diagonal**surface.dimension:
        hint = "close it with `o3dls convert --cap`, or say cap = true in case.toml"
        said = f"{where}: is open ({len(openings)} edges have one triangle only)"
        raise Doubt(said, hint, [Answer("close its openings", {"cap": True})])
    if abs(surface.volume) < NOTHING * surface.diagonal**surface.dimension:
        raise InputError(f"{where}: encloses nothing, even with its openings closed")
    return surface if surface.volume > 0 else replace(surface, faces=surface.faces[:, ::-1])


def welded(surface: Surface) -> Surface:
    """Return the surface with vertices at one place made one, as formats without sharing (STL) need it;
    triangles that vanish are dropped.
    """
    _, first, inverse = np.unique(place_keys(surface.vertices), return_index=True, return_inverse=True)
    if len(first) == len(surface.vertices):
        return surface
    order = np.argsort(first)  # keep the order of first appearance
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    faces = rank[inverse.ravel()][surface.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    keep = first[order]
    return Surface(
        surface.vertices[keep], faces, {name: values[keep] for name, values in surface.fields.items()}
    )


def stand_alone(surface: Surface) -> float:
    """Return the share of faces that share no edge with another: nearly all of a soup of triangles."""
    alone = _edge_counts(surface.faces)[0] == 1
    return float(alone.reshape(surface.faces.shape).all(axis=1).mean())


def _edge_counts(faces: Ints) -> tuple[Ints, int]:
    """Return how many faces have the edge behind each corner (m * d,), and the most that any edge has."""
    ends = np.stack([faces.ravel(), np.roll(faces, -1, axis=1).ravel()])
    keys = ends.min(axis=0) * (int(faces.max()) + 1) + ends.max(axis=0)
    _, of, count = np.unique(keys, return_inverse=True, return_counts=True)
    return count[of.ravel()], int(count.max())


def sewn(surface: Surface) -> tuple[Surface, float]:
    """Return a surface whose free edges meet, and within which distance their vertices had to be made one:
    the least of a row that closes all, or that joins a soup. As it is, and 0, where none does.

    Programs that write few digits, or each triangle by itself, put one vertex at places that differ a little.
    """
    if surface.dimension != 3:
        return surface, 0.0
    alone = _edge_counts(surface.faces)[0] == 1
    ends = np.stack([surface.faces.ravel(), np.roll(surface.faces, -1, axis=1).ravel()], axis=1)[alone]
    if not len(ends):
        return surface, 0.0
    lengths = np.linalg.norm(surface.vertices[ends[:, 0]] - surface.vertices[ends[:, 1]], axis=1)
    most = min(WIDEST * surface.diagonal, SHORT * float(lengths.min()))
    tolerance, fewest, best = NARROWEST * surface.diagonal, len(ends), (surface, 0.0)
    while fewest and tolerance <= most:
        joined = _joined_within(surface, np.unique(ends), tolerance)
        counts, densest = _edge_counts(joined.faces)
        if densest <= 2 and (free := int((counts == 1).sum())) < fewest:
            fewest, best = free, (joined, tolerance)
        tolerance *= STEP
    soup_joined = stand_alone(surface) > SOUP >= stand_alone(best[0])
    return best if not fewest or soup_joined else (surface, 0.0)


def joined_soup(surface: Surface) -> tuple[Surface, str]:
    """Return a surface of which most triangles share no edge, with its triangles joined, and a sentence on
    that; any other as it is.
    """
    if surface.dimension != 3 or surface.watertight or stand_alone(surface) <= SOUP:
        return surface, ""
    surface, tolerance = sewn(welded(surface))
    joined = f"vertices up to {tolerance:.2g} apart are welded" if tolerance else "no weld joins them"
    return surface, f"most triangles share no edge: {joined}"


def _joined_within(surface: Surface, some: Ints, tolerance: float) -> Surface:
    """Return the surface with those of some vertices made one that lie within a distance of each other."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = some[cKDTree(surface.vertices[some]).query_pairs(tolerance, output_type="ndarray")].reshape(-1, 2)
    n = len(surface.vertices)
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, group = connected_components(links, directed=False)
    _, first = np.unique(group, return_index=True)
    return welded(surface.with_vertices(surface.vertices[first[group]]))


def place_keys(vertices: Array) -> Ints:
    """Return one whole number per place: the ranks of its coordinates, put together. Three times as fast as
    sorting rows.
    """
    keys = np.zeros(len(vertices), dtype=np.int64)
    size = 1
    for axis in vertices.T:
        values, rank = np.unique(axis, return_inverse=True)
        if size * len(values) >= 1 << 63:  # more vertices than ranks can tell apart: close the ranks up first
            _, keys = np.unique(keys, return_inverse=True)
            size = int(keys.max()) + 1
        keys = keys * len(values) + rank
        size = size * len(values)
    return keys


def boundary_edges(faces: Ints, n: int) -> Ints:
    """Return the directed edges (k, 2) that no other triangle runs along the other way."""
    a = faces.ravel()
    b = np.roll(faces, -1, axis=1).ravel()
    free = ~np.isin(a * n + b, b * n + a)
    return np.column_stack([a[free], b[free]])


def coherent(surface: Surface, where: str) -> Surface:
    """Return the same triangles, all wound one way within each component. Raises InputError for edges with
    more than two triangles.
    """
    faces = surface.faces
    n = len(surface.vertices)
    a = faces.ravel()
    b = np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(a, b) * n + np.maximum(a, b)
    owner = np.repeat(np.arange(len(faces)), faces.shape[1])
    order = np.argsort(key, kind="stable")
    _, start, count = np.unique(key[order], return_index=True, return_counts=True)
    if (count > 2).any():
        edge = divmod(int(key[order][start[np.argmax(count)]]), n)
        raise InputError(
            f"{where}: {(count > 2).sum()} edges have more than two triangles, such as {edge}; a surface "
            "must be a manifold: mend it with `o3dls convert --repair`"
        )
    first = order[start[count == 2]]
    second = order[start[count == 2] + 1]
    turned = _faces_to_turn(owner[first], owner[second], (a < b)[first] == (a < b)[second], len(faces), where)
    return (
        replace(surface, faces=np.where(turned[:, None], faces[:, ::-1], faces)) if turned.any() else surface
    )


def _faces_to_turn(left: Ints, right: Ints, opposed: Array, n: int, where: str) -> Array:
    """Return which faces to flip so that no two neighbours (left, right) disagree; each component keeps the
    sense of most of its faces.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    # The double cover: face i stands for "as is", i + n for "turned"; one component must not hold both.
    far = np.where(opposed, n, 0)
    rows = np.concatenate([left, left + n])
    cols = np.concatenate([right + far, (right + n - far)])
    _, label = connected_components(
        coo_array((np.ones(len(rows)), (rows, cols)), shape=(2 * n, 2 * n)), directed=False
    )
    if (label[:n] == label[n:]).any():
        raise InputError(f"{where}: is one-sided (a Moebius band): it has no inside")
    pair = np.minimum(label[:n], label[n:])
    turned = label[:n] != pair
    share = np.bincount(pair, weights=turned) / np.maximum(np.bincount(pair), 1)
    return np.asarray(turned ^ (share > 0.5)[pair])


def capped(surface: Surface, where: str = "surface") -> Surface:
    """Return the surface with every opening closed by a fan around its centre; the new vertices take the mean
    of the rim's fields, and of labels (fields of whole numbers) the one that is there most often.
    """
    edges = boundary_edges(surface.faces, len(surface.vertices))
    if len(np.unique(edges[:, 0])) < len(edges) or not np.array_equal(
        np.sort(edges[:, 0]), np.sort(edges[:, 1])
    ):
        raise InputError(
            f"{where}: two openings touch in one vertex, so they cannot be closed; repair the mesh first, as "
            "in MeshLab"
        )
    vertices = [surface.vertices]
    faces = [surface.faces]
    fields = {k: [v] for k, v in surface.fields.items()}
    for centre, rim in enumerate(trace_loops(edges), len(surface.vertices)):
        vertices.append(surface.vertices[rim].mean(axis=0, keepdims=True))
        faces.append(np.column_stack([np.roll(rim, -1), rim, np.full(len(rim), centre)]))
        for name, values in surface.fields.items():
            fields[name].append(_value_at_centre(values, rim))
    return Surface(
        np.concatenate(vertices), np.concatenate(faces), {k: np.concatenate(v) for k, v in fields.items()}
    )


def _value_at_centre(values: Array, rim: Ints) -> Array:
    """Return the value (1, ...) of a field in the middle of a rim."""
    if (values == np.round(values))[np.isfinite(values)].all():
        labels, count = np.unique(values[rim], axis=0, return_counts=True)
        return np.asarray(labels[[count.argmax()]])
    return np.asarray(values[rim].mean(axis=0, keepdims=True))
