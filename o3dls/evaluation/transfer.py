"""Fields carried from one surface to another along their motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..geometry.label_fields import read_at
from ..geometry.surface import Surface
from .interpolation import REACH
from .projection import project

Motion = Callable[[Array], Array]


def between(
    source: Surface,
    target: Surface,
    *,
    source_motion: Motion | None = None,
    target_motion: Motion | None = None,
    reach: float = REACH,
) -> Surface:
    """Return the target with the source's fields, read where the two meet once each has been moved by its
    motion.

    Give `source_motion` (such as an estimate's motion) to bring fields of the prior to the refined surface,
    `target_motion` to bring fields of the map back to the prior: a place is then followed through the
    deformation instead of taken for the nearest wall, which may be another one. Vertices farther than `reach`
    from the source are NaN, as are those between corners without a value.
    """
    moved = source if source_motion is None else source.with_vertices(source_motion(source.vertices))
    places = target.vertices if target_motion is None else target_motion(target.vertices)
    wall = project(places, moved)
    far = wall.distance > reach
    corners = moved.faces[wall.face]
    fields = dict(target.fields)
    for name, values in source.fields.items():
        found = read_at(name, values, corners, wall.weights)
        found[far] = np.nan
        fields[name] = found
    return replace(target, fields=fields)
