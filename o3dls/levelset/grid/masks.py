"""Masks of the nodes of a box (3D): widened by steps, and how far from them nodes are, up to a reach."""

from __future__ import annotations

import numpy as np
from numba import njit

from ...arrays import Array, Mask


def widened(mask: Mask, steps: int = 1, *, corners: bool = False) -> Mask:
    """Return the mask and the nodes next to it along the axes, or within a cube around its nodes, so many
    times.
    """
    for _ in range(steps):
        wider = mask.copy()
        for axis in range(mask.ndim):
            source = wider.copy() if corners else mask
            grown, before = np.moveaxis(wider, axis, 0), np.moveaxis(source, axis, 0)
            grown[1:] |= before[:-1]
            grown[:-1] |= before[1:]
        mask = wider
    return mask


def gaps(mask: Mask, reach: float) -> Array:
    """Return the distance of every node from the nearest node of the mask, in nodes; infinite beyond `reach`.

    Squared distances along one axis after the other (Saito and Toriwaki 1994).
    """
    most = int(reach)
    squared = _spread_across(_along_rows(np.ascontiguousarray(mask), most), most)
    squared = _spread_across(squared.reshape(1, len(mask), -1), most).reshape(mask.shape)
    return np.where(squared <= reach * reach, np.sqrt(squared), np.inf)


@njit(cache=True)
def _along_rows(mask, most):  # type: ignore[no-untyped-def]
    """Return the squared distance of every node along the last axis, or more than can be within reach."""
    far = most + 1
    out = np.empty(mask.shape, dtype=np.int32)
    for i in range(mask.shape[0]):
        for j in range(mask.shape[1]):
            gap = far
            for k in range(mask.shape[2]):
                gap = 0 if mask[i, j, k] else min(gap + 1, far)
                out[i, j, k] = gap
            gap = far
            for k in range(mask.shape[2] - 1, -1, -1):
                gap = 0 if mask[i, j, k] else min(gap + 1, far)
                out[i, j, k] = min(out[i, j, k], gap) ** 2
    return out


@njit(cache=True)
def _spread_across(before, most):  # type: ignore[no-untyped-def]
    """Return the least of squared distances and squared steps along the second axis."""
    out = np.empty(before.shape, dtype=np.int32)
    for i in range(before.shape[0]):
        for j in range(before.shape[1]):
            least = out[i, j]
            least[:] = before[i, j]
            for step in range(max(-most, -j), min(most, before.shape[1] - 1 - j) + 1):
                _lower_to(least, before[i, j + step], np.int32(step * step))
    return out


@njit(cache=True, inline="always")
def _lower_to(least, other, more):  # type: ignore[no-untyped-def]
    for k in range(len(least)):
        far = other[k] + more
        least[k] = far if far < least[k] else least[k]
