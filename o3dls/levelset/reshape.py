"""Change the topology of a surface as long as evidence asks for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..geometry import Surface
from .growth import growth
from .observe import Measured
from .topology import Change, changed, removal

MOST = 4  # changes of one surface: more would be another surface


def reshape(
    surface: Surface, observe: Callable[[Surface], Measured], *, spacing: float, threshold: float
) -> tuple[Surface, tuple[Change, ...]]:
    """Make the best change, look again, until none earns `threshold` nats: the surface, untouched where there is none, and the changes.

    observe: gives the points as seen from a surface.
    """
    made: list[Change] = []
    while np.isfinite(threshold) and len(made) < MOST:
        measured = observe(surface)
        proposals = [change for change in (removal(surface, measured), growth(surface, measured)) if change]
        best = max(proposals, key=lambda change: change.gain, default=None)
        if best is None or best.gain < threshold:
            break
        surface = changed(surface, best, spacing)
        made.append(best)
    return surface, tuple(made)
