"""Which points touch the wall: a mixture of contact and no contact that knows that catheters float inside,
and in runs.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..arrays import ROUNDING, TINY, Array, Ints
from .settings import ContactSettings

BISECTIONS = 40  # more than a double's digits need
LEAST_DENSITY = 1e-100  # of contact, however far off, so that a point which may not float touches


@dataclass(frozen=True)
class Contact:
    """This is the state of the mixture: fraction of outliers (points off the wall), the lengths over which
    they spread inside and anywhere, how runs persist (0: not at all), and the fraction of the outliers that
    lies inside.
    """

    depth: float
    scatter: float
    outlier_fraction: float
    inside_fraction: float
    persistence: float = 0.0
    settings: ContactSettings = field(default_factory=ContactSettings)

    @classmethod
    def expected(cls, size: float, settings: ContactSettings) -> Contact:
        """Return what is expected of a chamber of rms radius `size` before any point is seen."""
        return cls(
            settings.depth * size,
            settings.scatter * size,
            settings.outlier_fraction,
            settings.inside_fraction,
            settings=settings,
        )

    @property
    def anywhere(self) -> float:
        """Density of the outliers that lie anywhere."""
        return (1.0 - self.inside_fraction) / self.scatter

    def outlier_density(self, residual: Array) -> Array:
        """Return the density (n,) of an outlier at signed distances (n,), negative inside."""
        inside = np.where(residual < 0.0, self.inside_fraction / self.depth, 0.0)
        return np.asarray(inside + self.anywhere)


def contact_density(residual: Array, variance: Array) -> Array:
    """Return the density (n,) of a point on the wall at signed distances (n,): N(0, variance)."""
    return np.asarray(np.exp(-0.5 * residual**2 / variance) / np.sqrt(2.0 * np.pi * variance))


def update_contact(residual: Array, variance: Array, odds: Array, contact: Contact) -> tuple[Array, Contact]:
    """Return the probability of contact (n,) for points in the order they were taken, and the updated
    mixture.

    `odds` (n,) multiplies each point's prior odds of being an outlier (contact force). Forward-backward
    smoothing over a two-state chain (Rabiner 1989) lets neighbours in time share their fate, as far as the
    data show that they do.
    """
    settings = contact.settings
    bounds = settings.least_fraction, settings.most_fraction
    touching = np.maximum(contact_density(residual, variance), LEAST_DENSITY)
    floating = contact.outlier_density(residual)
    weights, together = _smooth_chain(
        touching, floating * odds, contact.outlier_fraction, contact.persistence
    )
    off = float(np.clip((1.0 - weights).mean(), *bounds))
    fraction = float(np.clip(_fit_fraction(off, odds), *bounds))
    # the start has no persistence: neighbouring outliers beyond chance show it
    pairs = (1.0 - weights)[:-1].sum()
    chance = off * pairs
    excess = (together - chance) / (pairs * (1.0 - off) + settings.persistence_pairs * off)
    persistence = float(np.clip(excess, 0.0, settings.most_persistence))
    from_inside = (1.0 - weights) @ (1.0 - contact.anywhere / floating)  # 0 for those outside
    usual = settings.inside_points * settings.inside_fraction
    inside = (float(from_inside) + usual) / (float((1.0 - weights).sum()) + settings.inside_points)
    return weights, Contact(contact.depth, contact.scatter, fraction, inside, persistence, settings)


def isolation_odds(points: Array, size: float, settings: ContactSettings) -> Array:
    """Return the factor (n,), at least 1, on the odds of being an outlier of points (n, d) in a chamber of
    rms radius `size` with few others around them.

    Points on the wall fill a surface, those of a floating catheter a volume: the fewer there are in a ball,
    by the median as many as `settings.neighbours`, the larger the share of outliers among them (a Poisson
    mixture whose density of contact differs from place to place). It tells while the ball is small.
    """
    count = min(settings.neighbours, len(points) - 1)
    if count < 1:
        return np.ones(len(points))
    tree = KDTree(points)
    radius = float(np.median(tree.query(points, [count + 1])[0]))
    tells = float(np.interp(radius / size, [settings.isolation_small, settings.isolation_large], [1.0, 0.0]))
    if tells == 0.0:
        return np.ones(len(points))
    others = tree.query_ball_point(points, radius, return_length=True) - 1
    least = settings.least_neighbours
    return np.asarray(np.maximum((count + least) / (others + least), 1.0) ** tells)


def company_odds(
    near: Ints, weights: Array, residual: Array, contact: Contact, *, either_side: bool = False
) -> Array:
    """Return the factor (n,), at least 1, on the odds of being an outlier of points whose neighbours
    near (n, k) float, by probabilities of contact and signed distances (n,), negative inside.

    A wall is a sheet and touches nearly all points around it. A catheter that floats takes its points at
    every depth, and wherever a surface is drawn through these, some lie on it: so contact is less likely
    where most of the neighbours are off the wall. The share of outliers at a point is the mean of its
    neighbours' (a Beta prior with the mean of the whole map), where it is so large that it tells.
    either_side: neighbours outside count too, which else may be on wall that the prior lacks.
    """
    settings = contact.settings
    fraction = contact.outlier_fraction
    floating = np.where((residual < 0.0) | either_side, 1.0 - weights, 0.0)[near].sum(axis=1)
    share = (floating + settings.company_usual * fraction) / (near.shape[1] + settings.company_usual)
    share = np.minimum(share, settings.company_most)
    odds = share / (1.0 - share) * (1.0 - fraction) / fraction
    return np.where(share > settings.company_floats, np.maximum(odds, 1.0), 1.0)


def inside_point_weights(
    points: Array, outside: NDArray[np.bool_], size: float, settings: ContactSettings
) -> Array:
    """Return the weight (n,), up to 1, of each of the `inside` points (n, d) that a surface of rms radius
    `size` leaves outside.

    Of many noisy points along a wall the outermost lie beyond it. So each that is outside is outweighed by
    one nearby that is inside; and a crowd that is outweighed still counts as one point.
    """
    weights = np.zeros(len(points))
    rows = np.flatnonzero(outside)
    if len(rows):
        at = points[rows]
        near = settings.crowd * size
        beyond = KDTree(at).query_ball_point(at, near, return_length=True)
        together = KDTree(points).query_ball_point(at, near, return_length=True)
        weights[rows] = np.maximum(2 * beyond - together, 1) / beyond
    return weights


def label_energy(weights: Array, residual: Array, odds: Array, contact: Contact) -> float:
    """Return what probabilities of contact cost, in nats: surprise at the outliers, priors of the labels and
    of the inside fraction (Beta, 0 where it is usual), less the labels' entropy.
    """
    settings = contact.settings
    floating = contact.outlier_density(residual)
    off = np.clip(1.0 - weights, ROUNDING, 1.0)
    on = np.clip(weights, ROUNDING, 1.0)
    fraction, inside, usual = contact.outlier_fraction, contact.inside_fraction, settings.inside_fraction
    prior = off * np.log(fraction * odds * floating) + on * np.log(1.0 - fraction)
    normaliser = np.log(1.0 - fraction + fraction * odds)
    beta = usual * np.log(inside / usual) + (1.0 - usual) * np.log((1.0 - inside) / (1.0 - usual))
    labels = off * np.log(off) + on * np.log(on) - prior + normaliser
    return float(labels.sum() - settings.inside_points * beta)


def _fit_fraction(off_wall: float, odds: Array) -> float:
    """Find by bisection the outlier fraction, for points of odds 1, at which points of these odds (n,) are
    expected off the wall as often as they are.
    """
    if (odds == 1.0).all():
        return off_wall
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        fraction = 0.5 * (low + high)
        expected = float((fraction * odds / (1.0 - fraction + fraction * odds)).mean())
        low, high = (fraction, high) if expected < off_wall else (low, fraction)
    return fraction


@njit(cache=True, nogil=True)
def _smooth_chain(touching, floating, fraction, persistence):  # type: ignore[no-untyped-def]
    """Return the smoothed probability of state 0 (touching) along the chain, and the expected number of
    floating neighbours.
    """
    n = touching.shape[0]
    stay = fraction + persistence * (1.0 - fraction)  # P(floating | floating before)
    enter = fraction * (1.0 - persistence)  # P(floating | touching before): keeps `fraction` stationary
    forward = np.empty((n, 2))
    backward = np.ones((n, 2))
    for i in range(n):
        if i == 0:
            a = 1.0 - fraction
            b = fraction
        else:
            a = forward[i - 1, 0] * (1.0 - enter) + forward[i - 1, 1] * (1.0 - stay)
            b = forward[i - 1, 0] * enter + forward[i - 1, 1] * stay
        a, b = a * touching[i] + TINY, b * floating[i] + TINY
        forward[i, 0], forward[i, 1] = a / (a + b), b / (a + b)
    together = 0.0
    for i in range(n - 2, -1, -1):
        a, b = backward[i + 1, 0] * touching[i + 1], backward[i + 1, 1] * floating[i + 1]
        backward[i, 0] = (1.0 - enter) * a + enter * b + TINY
        backward[i, 1] = (1.0 - stay) * a + stay * b + TINY
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
