"""Change the topology of a surface as long as evidence asks for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .growth import growth
from .observe import Measured
from .topology import Change, changed, removal
from .wall import Wall

MOST = 4  # changes of one surface: more would be another surface


def reshape(wall: Wall, observe: Callable[[Wall], Measured], *, spacing: float, threshold: float) -> tuple[Wall, tuple[Change, ...]]:
    """Make the best change, look again, until none earns `threshold` nats: the wall, the same one where there is none, and the changes.

    observe: gives the points as seen from a wall.
    """
    made: list[Change] = []
    while np.isfinite(threshold) and len(made) < MOST:
        measured = observe(wall)
        proposals = [change for change in (removal(wall, measured), growth(wall, measured)) if change]
        best = max(proposals, key=lambda change: change.gain, default=None)
        if best is None or best.gain < threshold:
            break
        wall = Wall(changed(wall.surface, best, spacing))
        made.append(best)
    return wall, tuple(made)
