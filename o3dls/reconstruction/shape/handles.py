"""Topology of a level set on a box of nodes: one piece without cavities, and without handles but such as
points show.

What the inside leaves out when it grows by simple points (`levelset/grid/simple_points.py`) cuts handles
where they are thinnest. Grown from the border, the outside leaves out what fills tunnels where they are
narrowest. Of the two the likelier is done, where points say nothing the smaller change (as Han, Xu,
Braga-Neto and Prince 2002 do).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import label

from ...arrays import Array, Mask
from ...levelset.grid.masks import widened
from ...levelset.grid.simple_points import TOUCHING, cut_away, outside, simply_connected, unreached
from ...parallel import both
from ..shape_settings import HandleSettings

Evidence = Callable[[tuple[Array, ...], Mask], list[float]]


def without_handles(
    phi: Array, evidence: Evidence, settings: HandleSettings, least: float, asked: float
) -> Array:
    """Return phi on a box with its inside made one simply connected piece, but for handles that points show;
    what is changed becomes at least `least` in amount.

    evidence: log likelihoods of points near changed nodes (mask) under several phi; asked: nodes that the cut
    of a handle takes for it to be asked.
    """
    left_out = unreached(phi)
    decided, kept = _handles_decided(phi, left_out, evidence, settings, least, asked)
    changed = kept.any() or decided is not phi
    whole = simply_connected(np.where(kept, least, decided), least, None if changed else left_out)
    return np.where(kept, decided, whole)


def _handles_decided(
    phi: Array, left_out: Mask, evidence: Evidence, settings: HandleSettings, least: float, asked: float
) -> tuple[Array, Mask]:
    """Return phi with every larger handle cut, or its tunnel filled, or left, and nodes (mask) that would cut
    those that were left. left_out: what the inside leaves out, when grown.
    """
    kept = np.zeros(phi.shape, dtype=bool)
    cuts = label(left_out, TOUCHING)[0]
    sizes = np.bincount(cuts.ravel())
    sizes[0] = 0
    for k in np.argsort(-sizes, kind="stable")[: settings.most_handles]:
        if sizes[k] < asked:
            break
        mine = cuts == k
        tunnel, disc = _fill_tunnel(np.where(left_out & ~mine, least, phi), sizes[k], settings, least)
        severed = cut_away(phi, mine, least)
        filled = np.where(disc, np.minimum(-phi, -least), phi)
        if not tunnel.any():  # an island
            phi = severed
            continue
        changed = (severed != phi) | (filled != phi)
        as_it_is, without, closed = evidence((phi, severed, filled), changed)
        if as_it_is - max(without, closed) > settings.evidence:
            kept |= mine
        elif closed - np.log(_count_nodes(tunnel)) >= without - np.log(sizes[k]):
            phi = filled
        else:
            phi = severed
    return phi, kept


def _fill_tunnel(phi: Array, cut: int, settings: HandleSettings, least: float) -> tuple[Mask, Mask]:
    """Return the nodes (mask) that fill the tunnel of a phi with one handle where it is narrowest, and these
    as wide as the lattice can hold. `cut`: how many nodes it takes to cut the handle. Nothing is filled where
    no filling spares the cut, as where the inside is in two.
    """
    deep = phi < -least
    grown, beyond = both(lambda: ~unreached(np.where(deep, phi, least)), lambda: outside(phi))
    begun = deep & grown  # grown first, whatever is filled

    def spares(nodes: Mask) -> bool:
        """Say whether the handle needs no cut when these nodes are filled, but for a node or two
        elsewhere.
        """
        return 2 * _count_nodes(unreached(np.where(nodes, -least, phi), begun)) < cut

    fills = (phi >= 0.0) & ~beyond
    if not spares(fills):
        return np.zeros_like(fills), np.zeros_like(fills)
    parts = label(fills, TOUCHING)[0]
    sizes = np.bincount(parts.ravel())[1:]
    # some are pockets, or lie in the tunnel of a handle that has been cut
    for k in np.argsort(-sizes, kind="stable")[: settings.most_parts] if len(sizes) > 1 else ():
        fewer = fills & (parts != k + 1)
        if spares(fewer):
            fills = fewer
    wider = widened(fills) & (phi >= 0.0)
    return fills, wider if spares(wider) else fills


def _count_nodes(nodes: Mask) -> int:
    return int(np.count_nonzero(nodes))
