"""Differential operators on a narrow band, the regularised delta and Heaviside functions, unions and
connected parts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Ints
from ...geometry.components import component_labels
from . import kernels
from .band import Band
from .distance import SignedDistance


def gradient(band: Band, phi: Array) -> Array:
    """Return central differences (n, d); one-sided where the band ends."""
    own = np.arange(len(band))[:, None]
    low, high = (np.where(band.neighbours[:, :, k] >= 0, band.neighbours[:, :, k], own) for k in (0, 1))
    steps = np.maximum((low != own).astype(int) + (high != own), 1)
    return np.asarray((phi[high] - phi[low]) / (steps * band.spacing))


def mean_curvature(band: Band, phi: Array) -> Array:
    """Return div(grad phi / |grad phi|), (n,): the sum of the principal curvatures of the level sets,
    positive on a sphere.
    """
    return np.asarray(kernels.curvature(phi, band.neighbours, band.spacing))


def delta(phi: Array, reach: float) -> Array:
    """Return the regularised Dirac function, 0 beyond |phi| = reach, integral 1."""
    return np.asarray(np.where(np.abs(phi) < reach, (1.0 + np.cos(np.pi * phi / reach)) / (2.0 * reach), 0.0))


def heaviside(phi: Array, reach: float) -> Array:
    """Return the integral of the regularised Dirac function: 0 inside (phi < -reach), 1 outside."""
    s = np.clip(phi / reach, -1.0, 1.0)
    return np.asarray(0.5 * (1.0 + s + np.sin(np.pi * s) / np.pi))


def combine(first: SignedDistance, second: SignedDistance, *, remove: bool) -> tuple[Band, Array]:
    """Return the union of two insides with a fillet, or the first without the second (`remove`), on the nodes
    around the new surface.

    Both on one lattice; the result has the right sign everywhere and is a distance near either surface. Works
    on the full box: a change of topology is rare.
    """
    a, b = first.band, second.band
    low = np.minimum(a.low, b.low)
    shape = np.maximum(a.low + a.shape, b.low + b.shape) - low
    boxes = [np.full(shape, np.float32(f.band.width)) for f in (first, second)]
    for box, f in zip(boxes, (first, second), strict=True):
        start = f.band.low - low
        box[tuple(slice(s, s + n) for s, n in zip(start, f.band.shape, strict=True))] = f.band.dense(f.phi)
    mixed = np.maximum(boxes[0], -boxes[1]) if remove else _fillet_union(boxes[0], boxes[1], a.width)
    nodes = np.argwhere(np.abs(mixed) < a.width)
    band = Band(
        a.spacing, a.width, low, tuple(int(n) for n in shape), np.ascontiguousarray(nodes, dtype=np.int32)
    )
    return band, mixed[tuple(nodes.T)].astype(np.float64)


def _fillet_union(a: NDArray[np.float32], b: NDArray[np.float32], width: float) -> NDArray[np.float32]:
    """Return the smaller of two level sets, rounded where they differ by less than `width`: vessels leave a
    chamber without a sharp crease.
    """
    near = np.maximum(1.0 - np.abs(a - b) / width, 0.0)
    return np.asarray(np.minimum(a, b) - 0.25 * width * near**2, dtype=np.float32)


def linked(band: Band, chosen: NDArray[np.bool_]) -> Ints:
    """Return the connected pieces (n,) of the chosen nodes, numbered from 0 by falling size; -1 elsewhere."""
    above = band.neighbours[:, :, 1]
    rows, axes = np.nonzero((above >= 0) & chosen[:, None] & chosen[above])
    links = np.column_stack([rows, above[rows, axes]])
    _, own, size = np.unique(
        component_labels(len(band), links)[chosen], return_inverse=True, return_counts=True
    )
    rank = np.empty(len(size), dtype=np.int64)
    rank[np.argsort(-size, kind="stable")] = np.arange(len(size))
    named = np.full(len(band), -1)
    named[chosen] = rank[own]
    return named


def without_islands(band: Band, phi: Array) -> Array:
    """Return the level set with its largest inside and its largest outside alone: islands and cavities change
    their side.
    """
    whole = phi.copy()
    for side in (-1.0, 1.0):
        chosen = side * whole > 0.0
        whole[linked(band, chosen) > 0] *= -1.0
    return whole
