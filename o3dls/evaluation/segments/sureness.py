"""How sure it is in which segment a place of the map lies."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import Array, Ints
from ...motion.wall.samples import SurfaceSamples


def segment_sureness(samples: SurfaceSamples, segment: Ints) -> Array:
    """Return with which probability (n,) the place of each vertex lies in its segment (n,).

    Places stay in the map, and the anatomy with its segments lies elsewhere in each sample: the probability
    is the share of the samples whose nearest vertex is in the same segment.
    """
    same = np.zeros(len(segment))
    for vertices in samples.vertices:
        nearest = cKDTree(vertices).query(samples.surface.vertices)[1]
        same += segment[nearest] == segment
    return same / len(samples)
