"""How likely there is wall at all where a map has no points."""

from __future__ import annotations

import numpy as np

from ...arrays import Array
from ...geometry.similarity import rms_radius
from ..neighbours import nearest
from ..settings import ReconstructionSettings
from .believed import Believed


def existence(places: Array, believed: Believed, between: float, settings: ReconstructionSettings) -> Array:
    """Return the probability (n,) that there is wall at places (n, 3) of a surface, by the points that are
    believed, which are `between` apart; 1 everywhere where none is believed.
    """
    touching = believed.points[believed.weights > 0.5]
    if not len(touching):
        return np.ones(len(places))
    gap = nearest(touching, places, 1)[0][:, 0]
    length = settings.absent_length * rms_radius(places)
    share = settings.absent_of_template if believed.template else settings.absent
    unmapped = float((gap > settings.unmapped * between).mean())
    return 1.0 - absent(gap, between, length, share, unmapped)


def absent(gap: Array, between: float, length: float, share: float, unmapped: float) -> Array:
    """Return the probability (n,) that there is no wall where the nearest point is `gap` (n,) away, of points
    that are `between` apart.

    share: of the wall that is absent before points are seen; unmapped: of it that was not visited. By Bayes'
    rule with the densities of the gap: on visited wall that of a Poisson process, which is no smaller nearer
    than where it is largest; on absent and on unvisited wall any up to a `length`.
    """
    mode = between / np.sqrt(2.0 * np.pi)
    far = np.maximum(gap, mode) / between
    visited = length / between * 2.0 * np.pi * far * np.exp(-np.pi * far**2)
    there = unmapped + (1.0 - unmapped) * visited
    return np.asarray(share / (share + (1.0 - share) * there))
