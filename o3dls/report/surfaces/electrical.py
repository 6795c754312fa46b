"""Electrical values on a wall.

Those that the run carried to it, and carried as it does where a surface has none.
"""

from __future__ import annotations

from ...case import Points
from ...evaluation.electrical import ELECTRICAL
from ...evaluation.electrical import with_electrical as carried
from ...geometry.surface import Surface


def with_electrical(surface: Surface, points: Points) -> Surface:
    """Return the surface with a field of every electrical column of the eam points.

    Values that it carries already stay as they are.
    """
    missing = [name for name in ELECTRICAL if name not in surface.fields]
    return carried(surface, points, columns=missing)
