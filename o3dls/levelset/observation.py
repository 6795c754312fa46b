"""What points say of a surface: their noise, the share of outliers, and the distance that noise alone adds on
a curved wall.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..arrays import Array
from ..noise.contact import CROWD, INSIDE, say
from ..noise.likelihood import Likelihood
from ..noise.robust import spread
from .normal_displacement import Wall

SHARES = (0.02, 0.3)  # a share outside is not believed, but for 0: then every point is
EXACT = 4e-6  # rms radii: noise of points that lie on the surface as it is
MOST_BENT = 0.6  # noise times curvature beyond which the bias is not to be trusted


@dataclass(frozen=True, eq=False)
class Noise:
    """What is known of the noise beforehand: `sigma` (None: nothing), uncertain by `doubt` (of its
    logarithm), outliers with `share`, of which the share `inside` lies inside.
    """

    sigma: float | None = None
    doubt: float = 0.5
    share: float = 0.08
    inside: float = INSIDE


@dataclass(frozen=True, eq=False)
class Measured:
    """Points (n, d) seen from a wall at signed distance (n,): their likelihood, how uncertain its noise is,
    and the bias (n,) of a curved wall, which noise adds to the distance.
    """

    points: Array
    distance: Array
    likelihood: Likelihood
    doubt: float
    bias: Array

    def of(self, rows: NDArray[np.bool_]) -> Measured:
        """The points of a mask (n,)."""
        noise = replace(
            self.likelihood, sigma=self.likelihood.sigma[rows], one_sided=self.likelihood.one_sided[rows]
        )
        return replace(
            self,
            points=self.points[rows],
            distance=self.distance[rows],
            likelihood=noise,
            bias=self.bias[rows],
        )

    def with_noise(self, factor: float) -> Measured:
        """The same points, their noise multiplied."""
        return replace(self, likelihood=replace(self.likelihood, sigma=self.likelihood.sigma * factor))


def observe(
    wall: Wall, points: Array, one_sided: NDArray[np.bool_], relative: Array, noise: Noise
) -> Measured:
    """The points against a wall.

    one_sided (n,): known to be inside only; relative (n,): noise of each point over the usual one. Unknown
    noise is the robust spread of the distances.
    """
    distance, corners, weights = wall.look(points)
    sigma = relative * max(
        spread(distance[~one_sided]) if noise.sigma is None else noise.sigma, EXACT * wall.radius
    )
    share = float(np.clip(noise.share, *SHARES)) if noise.share > 0.0 else 0.0
    likelihood = Likelihood(sigma, share, wall.radius, one_sided, noise.inside)
    bend = np.einsum("nc,nc->n", weights, wall.curvature[corners])
    # the mean of the distance from a curved wall under noise of variance s^2 is s^2 / 2 times the sum of its
    # curvatures
    bias = np.where(one_sided, 0.0, 0.5 * sigma * np.clip(sigma * bend, -MOST_BENT, MOST_BENT))
    seen = Measured(points, distance, likelihood, noise.doubt, bias)
    return seen.of(~one_sided | (distance <= 0.0) | _heard(wall, points, one_sided, distance > 0.0))


def _heard(
    wall: Wall, points: Array, one_sided: NDArray[np.bool_], outside: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which points (n,) known to be inside are outside and heard: all where twice as many as are inside
    around, else one.
    """
    rows = np.flatnonzero(one_sided)
    heard = say(points[rows], outside[rows], wall.radius)
    chosen = np.zeros(len(points), dtype=bool)
    near = KDTree(points[rows])
    for k in np.flatnonzero(heard):
        around = rows[near.query_ball_point(points[rows[k]], CROWD * wall.radius)]
        chosen[rows[k]] = heard[k] > 0.5 or not chosen[around].any()
    return chosen
