"""What points say of a surface: their noise, the fraction of outliers, and the distance that noise alone adds
on a curved wall.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..arrays import Array
from ..noise.contact import Contact, inside_point_weights
from ..noise.curved_wall import curved_wall_bias
from ..noise.likelihood import Likelihood
from ..noise.robust import robust_sd
from ..noise.settings import MixtureSettings
from .settings import ObservationSettings
from .wall import Wall


@dataclass(frozen=True, eq=False)
class Noise:
    """This is what is known of the noise beforehand: `sigma` (None: nothing), and the fraction of
    outliers.
    """

    sigma: float | None
    outlier_fraction: float


@dataclass(frozen=True, eq=False)
class Measured:
    """These points (n, d) are seen from a wall at signed distance (n,): their likelihood, and the bias (n,)
    of a curved wall, which noise adds to the distance.
    """

    points: Array
    distance: Array
    likelihood: Likelihood
    bias: Array

    def of(self, rows: NDArray[np.bool_]) -> Measured:
        """Return the points of a mask (n,)."""
        likelihood = replace(
            self.likelihood, sigma=self.likelihood.sigma[rows], one_sided=self.likelihood.one_sided[rows]
        )
        return replace(
            self,
            points=self.points[rows],
            distance=self.distance[rows],
            likelihood=likelihood,
            bias=self.bias[rows],
        )


def observe(
    wall: Wall,
    points: Array,
    one_sided: NDArray[np.bool_],
    relative: Array,
    noise: Noise,
    settings: ObservationSettings | None = None,
) -> Measured:
    """Return the points against a wall.

    one_sided (n,): known to be inside only; relative (n,): noise of each point over the usual one. Unknown
    noise is the robust standard deviation of the distances.
    """
    settings = settings or ObservationSettings()
    distance, corners, weights = wall.look(points)
    known = robust_sd(distance[~one_sided]) if noise.sigma is None else noise.sigma
    sigma = relative * max(known, MixtureSettings().least_noise * wall.radius)
    likelihood = Likelihood(sigma, _expect_contact(wall, noise, settings), one_sided)
    bend = np.einsum("nc,nc->n", weights, wall.curvature[corners])
    bias = np.where(one_sided, 0.0, curved_wall_bias(sigma, bend, settings.curved))
    seen = Measured(points, distance, likelihood, bias)
    active = _active_inside_points(wall, points, one_sided, distance > 0.0, settings)
    return seen.of(~one_sided | (distance <= 0.0) | active)


def _expect_contact(wall: Wall, noise: Noise, settings: ObservationSettings) -> Contact:
    """Return who touches the wall, as far as it is known beforehand; a fraction out of bounds is not
    believed.
    """
    fraction = noise.outlier_fraction
    if fraction > 0.0:
        fraction = float(np.clip(fraction, settings.least_outliers, settings.most_outliers))
    return replace(Contact.expected(wall.radius, settings.contact), outlier_fraction=fraction)


def _active_inside_points(
    wall: Wall,
    points: Array,
    one_sided: NDArray[np.bool_],
    outside: NDArray[np.bool_],
    settings: ObservationSettings,
) -> NDArray[np.bool_]:
    """Choose which points (n,) known to be inside are outside and pull: all of them where twice as many are
    outside as inside around, else one.
    """
    rows = np.flatnonzero(one_sided)
    weights = inside_point_weights(points[rows], outside[rows], wall.radius, settings.contact)
    chosen = np.zeros(len(points), dtype=bool)
    near = KDTree(points[rows])
    for k in np.flatnonzero(weights):
        around = rows[near.query_ball_point(points[rows[k]], settings.contact.crowd * wall.radius)]
        chosen[rows[k]] = weights[k] > 0.5 or not chosen[around].any()
    return chosen
