"""How likely wall exists where a map has no points: a question apart from where it lies."""

from __future__ import annotations

import numpy as np

from ...arrays import Array
from .normals import nearest
from .reconstruct import Believed
from .settings import ReconstructionSettings


def existence(places: Array, believed: Believed, between: float, settings: ReconstructionSettings) -> Array:
    """Probability (n,) that there is wall at places (n, 3) of a surface, by the points that are believed,
    which are `between` apart; 1 everywhere where none is believed.
    """
    touching = believed.points[believed.weights > 0.5]
    if not len(touching):
        return np.ones(len(places))
    gap = nearest(touching, places, 1)[0][:, 0]
    return 1.0 - absent(gap, between, settings, template=believed.template)


def absent(gap: Array, between: float, settings: ReconstructionSettings, *, template: bool) -> Array:
    """Probability (n,) that there is no wall where the nearest point is `gap` (n,) away, of points that are
    `between` apart. Before points are seen it is larger for a template than for the patient's own prior.

    On a wall that was visited so large a circle is empty with the probability of a Poisson process, on the
    part of the wall that was not visited always.
    """
    share = settings.absent_of_template if template else settings.absent
    unmapped = float((gap > settings.unmapped * between).mean())
    empty = unmapped + (1.0 - unmapped) * np.exp(-np.pi * (gap / between) ** 2)
    return np.asarray(share / (share + (1.0 - share) * empty))
