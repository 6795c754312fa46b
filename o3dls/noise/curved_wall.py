"""How far outside of a curved wall points lie that were measured on it."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from .settings import CurvedWallSettings

DEFAULTS = CurvedWallSettings()


def curved_wall_bias(sd: Array, bend: Array, settings: CurvedWallSettings = DEFAULTS) -> Array:
    """Return the mean signed distance (n,) from a wall of points that noise of sd (n,) per axis moved off it.

    bend: sums of the principal curvatures (n,), positive on a sphere. Noise along the wall leads off a
    curved one to its outside: to the second order, the mean of the distance is sd^2 bend / 2.
    """
    return np.asarray(0.5 * sd * np.clip(sd * bend, -settings.most_bias, settings.most_bias))
