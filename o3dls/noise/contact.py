"""Which points touch the wall: a mixture of contact and no contact that knows that catheters float inside,
and in runs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..arrays import Array

LEAST = 1e-100  # density of contact however far off: a point that may not float touches
CROWD = 0.37  # rms radii: `inside` points that lie closer together speak of the same wall
INSIDE, SURE = (
    0.9,
    10.0,
    # share of the points off the wall that lie inside the chamber, the rest anywhere; known as from so many
    # of them
)


@dataclass(frozen=True)
class Contact:
    """State of the mixture: share of points off the wall, the depth (a length) over which they spread, how
    runs persist (0 = none), and the share of those off the wall that lie inside.
    """

    share: float = 0.08
    depth: float = 8.0
    persistence: float = 0.0
    inside: float = INSIDE

    @property
    def anywhere(self) -> float:
        """Density of the points off the wall that lie anywhere."""
        return (1.0 - self.inside) / (4.0 * self.depth)


def density(residual: Array, variance: Array, contact: Contact) -> tuple[Array, Array]:
    """Densities (n,) of signed residuals (negative inside) for contact, N(0, variance), and for a point off
    the wall.
    """
    touching = np.exp(-0.5 * residual**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    return touching, np.where(residual < 0.0, contact.inside / contact.depth, 0.0) + contact.anywhere


def believe(residual: Array, variance: Array, odds: Array, contact: Contact) -> tuple[Array, Contact]:
    """Probability of contact (n,) for points in the order they were taken, and the updated mixture.

    `odds` (n,) multiplies each point's prior odds of being off the wall (contact force). Forward-backward
    smoothing over a two-state chain (Rabiner 1989) lets neighbours in time share their fate, as far as the
    data show that they do.
    """
    touching, floating = density(residual, variance, contact)
    touching = np.maximum(touching, LEAST)
    weights, together = _chain(touching, floating * odds, contact.share, contact.persistence)
    off = float(np.clip((1.0 - weights).mean(), 0.005, 0.5))
    share = float(np.clip(_share(off, odds), 0.005, 0.5))
    # a start of chance level: what is left of joint outliers beyond chance shows persistence; shrunk as by 20
    # pairs without any
    pairs = (1.0 - weights)[:-1].sum()
    chance = off * pairs
    persistence = float(np.clip((together - chance) / (pairs * (1.0 - off) + 20.0 * off), 0.0, 0.9))
    from_inside = (1.0 - weights) @ (1.0 - contact.anywhere / floating)  # 0 for those outside
    inside = (float(from_inside) + SURE * INSIDE) / (float((1.0 - weights).sum()) + SURE)
    return weights, Contact(share, contact.depth, persistence, inside)


def say(points: Array, outside: NDArray[np.bool_], size: float) -> Array:
    """How far (n,), up to 1, each of the `inside` points (n, d) that a surface of rms radius `size` leaves
    outside is heard.

    Of many noisy points along a wall the outermost lie beyond it. So each that is outside is outweighed by
    one nearby that is inside; and a crowd that is outweighed speaks as one point still.
    """
    heard = np.zeros(len(points))
    rows = np.flatnonzero(outside)
    if len(rows):
        at = points[rows]
        near = CROWD * size
        beyond = KDTree(at).query_ball_point(at, near, return_length=True)
        together = KDTree(points).query_ball_point(at, near, return_length=True)
        heard[rows] = np.maximum(2 * beyond - together, 1) / beyond
    return heard


def mixture_energy(weights: Array, residual: Array, odds: Array, contact: Contact) -> float:
    """What the beliefs cost, in nats: surprise at the points off the wall, priors of the labels and of
    `contact.inside` (Beta, 0 where it is usual), less the labels' entropy.
    """
    _, floating = density(residual, np.ones(len(residual)), contact)
    off = np.clip(1.0 - weights, 1e-12, 1.0)
    on = np.clip(weights, 1e-12, 1.0)
    prior = off * np.log(contact.share * odds * floating) + on * np.log(1.0 - contact.share)
    normaliser = np.log(1.0 - contact.share + contact.share * odds)
    usual = SURE * (
        INSIDE * np.log(contact.inside / INSIDE)
        + (1.0 - INSIDE) * np.log((1.0 - contact.inside) / (1.0 - INSIDE))
    )
    return float((off * np.log(off) + on * np.log(on) - prior + normaliser).sum() - usual)


def _share(off_wall: float, odds: Array) -> float:
    """Share of a point of odds 1 at which points of these odds (n,) are expected off the wall as often as
    they are; by bisection.
    """
    if (odds == 1.0).all():
        return off_wall
    low, high = 0.0, 1.0
    for _ in range(40):
        share = 0.5 * (low + high)
        expected = float((share * odds / (1.0 - share + share * odds)).mean())
        low, high = (share, high) if expected < off_wall else (low, share)
    return share


@njit(cache=True)
def _chain(touching, floating, share, persistence):  # type: ignore[no-untyped-def]
    """Smoothed probability of state 0 (touching) along the chain, and the expected number of floating
    neighbours.
    """
    n = touching.shape[0]
    stay = share + persistence * (1.0 - share)  # P(floating | floating before)
    enter = share * (1.0 - persistence)  # P(floating | touching before): keeps `share` stationary
    forward = np.empty((n, 2))
    backward = np.ones((n, 2))
    for i in range(n):
        if i == 0:
            a = 1.0 - share
            b = share
        else:
            a = forward[i - 1, 0] * (1.0 - enter) + forward[i - 1, 1] * (1.0 - stay)
            b = forward[i - 1, 0] * enter + forward[i - 1, 1] * stay
        a, b = a * touching[i] + 1e-300, b * floating[i] + 1e-300
        forward[i, 0], forward[i, 1] = a / (a + b), b / (a + b)
    together = 0.0
    for i in range(n - 2, -1, -1):
        a, b = backward[i + 1, 0] * touching[i + 1], backward[i + 1, 1] * floating[i + 1]
        backward[i, 0] = (1.0 - enter) * a + enter * b + 1e-300
        backward[i, 1] = (1.0 - stay) * a + stay * b + 1e-300
        both = forward[i, 1] * stay * b
        every = forward[i, 0] * backward[i, 0] + forward[i, 1] * backward[i, 1]
        together += both / every
        total = backward[i, 0] + backward[i, 1]
        backward[i, 0] /= total
        backward[i, 1] /= total
    weights = np.empty(n)
    for i in range(n):
        a, b = forward[i, 0] * backward[i, 0], forward[i, 1] * backward[i, 1]
        weights[i] = a / (a + b)
    return weights, together
