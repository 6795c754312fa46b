"""A coarse lattice of signed distances: a thousand poses are tried on it in the time that ten take on the
triangles.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ..arrays import Array
from ..geometry.similarity import rms_radius
from ..geometry.surface import Surface

NODES = 34  # along the longest side; finer finds no other basins
MARGIN = 0.5  # beyond the surface's box, in rms radii


class Lattice(NamedTuple):
    """A lattice holds signed distances phi (a, b, c), negative inside, at low + spacing * index; in 2D all is
    the same along the third axis.
    """

    phi: Array
    low: Array
    spacing: float


def signed_lattice(surface: Surface) -> Lattice:
    """Return the distances of the nodes around a surface of vertices (n, d); inside is where the nearest face
    looks away.
    """
    d = surface.dimension
    margin = MARGIN * rms_radius(surface.vertices)
    low = surface.vertices.min(axis=0) - margin
    high = surface.vertices.max(axis=0) + margin
    spacing = float((high - low).max()) / (NODES - 1)
    sides = [low[k] + spacing * np.arange(int(np.ceil((high[k] - low[k]) / spacing)) + 1) for k in range(d)]
    tree = surface.closest_point
    normals = surface.face_normals
    hint = None
    layers = []
    layer = np.stack(np.meshgrid(*sides[1:], indexing="ij"), axis=-1).reshape(-1, d - 1)
    for x in sides[0]:
        nodes = np.column_stack([np.full(len(layer), x), layer])
        squared, hint, feet, _ = tree.query(nodes, hint=hint)
        inside = ((nodes - feet) * normals[hint]).sum(axis=1) < 0.0
        layers.append(np.where(inside, -1.0, 1.0) * np.sqrt(squared))
    phi = np.reshape(layers, [len(side) for side in sides])
    if d == 2:
        return Lattice(np.repeat(phi[:, :, None], 2, axis=2), np.append(low, -0.5 * spacing), spacing)
    return Lattice(phi, low, spacing)


@njit(cache=True)
def sample(lattice, x, y, z):  # type: ignore[no-untyped-def]
    """Return the trilinear signed distance and its gradient; outside the lattice the distance to it is
    added.
    """
    phi, low, spacing = lattice
    u, v, w = (x - low[0]) / spacing, (y - low[1]) / spacing, (z - low[2]) / spacing
    uc = min(max(u, 0.0), phi.shape[0] - 1.000001)
    vc = min(max(v, 0.0), phi.shape[1] - 1.000001)
    wc = min(max(w, 0.0), phi.shape[2] - 1.000001)
    i, j, k = int(uc), int(vc), int(wc)
    a, b, c = uc - i, vc - j, wc - k
    l00 = phi[i, j, k + 1] - phi[i, j, k]
    l01 = phi[i, j + 1, k + 1] - phi[i, j + 1, k]
    l10 = phi[i + 1, j, k + 1] - phi[i + 1, j, k]
    l11 = phi[i + 1, j + 1, k + 1] - phi[i + 1, j + 1, k]
    p00 = phi[i, j, k] + c * l00
    p01 = phi[i, j + 1, k] + c * l01
    p10 = phi[i + 1, j, k] + c * l10
    p11 = phi[i + 1, j + 1, k] + c * l11
    q0, q1 = p00 + b * (p01 - p00), p10 + b * (p11 - p10)
    value = q0 + a * (q1 - q0)
    gx = (q1 - q0) / spacing
    gy = ((1.0 - a) * (p01 - p00) + a * (p11 - p10)) / spacing
    gz = ((1.0 - a) * ((1.0 - b) * l00 + b * l01) + a * ((1.0 - b) * l10 + b * l11)) / spacing
    du, dv, dw = (u - uc) * spacing, (v - vc) * spacing, (w - wc) * spacing
    beyond = np.sqrt(du * du + dv * dv + dw * dw)
    if beyond > 0.0:
        return value + beyond, gx + du / beyond, gy + dv / beyond, gz + dw / beyond
    return value, gx, gy, gz
