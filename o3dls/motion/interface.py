"""What every motion of the prior can do, for those who only use one."""

from __future__ import annotations

from typing import Protocol

from ..arrays import Array


class Motion(Protocol):
    """A fitted motion of the prior: prior frame to map frame, with its uncertainty."""

    def __hash__(self) -> int:
        """Of the object itself: two motions are never compared."""

    def __call__(self, points: Array) -> Array:
        """Positions (n, d) in the map frame of points (n, d) of the prior frame."""

    def sd(self, points: Array, normals: Array) -> Array:
        """Return the posterior standard deviation (n,) along `normals` (map frame) of the motion at points of
        the prior frame.
        """
