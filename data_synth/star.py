"""A five-pointed star in 200 x 200 px; the prior is the star bent as a whole, as a shaky hand drew it."""

from __future__ import annotations

import numpy as np

from o3dls import Case, Points, Surface, Truth

from .motion import bend, then, wobble
from .shapes import Array, Shape, polygon

CENTRE = (100.0, 96.0)
RADII = (80.0, 38.0)  # of the five tips and of the five notches
# px: what 33 points, 16 px apart, can tell, and what they cannot. A template that is bent alone leaves the
# best estimator there is, which knows the bend's covariance, a mean distance of 0.54 to 0.66 of the noise: 33
# points less its degrees of freedom.
BENT_OVER, SHAKEN_OVER = 80.0, 12.0


def corners() -> Array:
    """The ten corners (10, 2), counter-clockwise from the upper tip."""
    angle = np.pi / 2.0 + np.arange(10) * np.pi / 5.0
    return np.asarray(CENTRE + np.tile(RADII, 5)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def shape() -> Shape:
    """The star as a signed distance."""
    return polygon(corners())


def walk(n: int) -> Array:
    """n points (n, 2) at equal distances along the outline."""
    closed = np.vstack([corners(), corners()[:1]])
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0.0, way[-1], n, endpoint=False)
    return np.column_stack([np.interp(at, way, axis) for axis in closed.T])


def star(
    seed: int = 7, *, percent: float = 6.0, points: int = 33, bent: float = 8.0, shake: float = 2.0
) -> Case:
    """The case of a seed; percent: noise per axis in percent of the points' standard deviation.

    bent: how far (rms, px) the prior is off once it lies as well as it can; shake: sd per axis (px) of the
    hand that drew it.
    """
    scribe, hand = np.random.default_rng((seed, 3301)).spawn(2)
    index = np.arange(660)
    truth = Surface(walk(len(index)), np.column_stack([index, np.roll(index, -1)]))
    drawn = then(bend(scribe, truth.vertices, bent, BENT_OVER), wobble(scribe, shake, SHAKEN_OVER, 2))
    xy = walk(points)
    noise = percent / 100.0 * float(np.sqrt(xy.var(axis=0).mean()))
    return Case(
        name=f"star_{seed}",
        prior=truth.with_vertices(drawn(truth.vertices)),
        points=Points(np.round(xy + noise * hand.normal(size=xy.shape), 3), np.repeat(["eam"], points)),
        units="px",
        notes=f"synthetic star: seed {seed}, noise {noise:.3f} px ({percent:g} %)",
        truth=Truth(truth, walk(1000)),
    )
