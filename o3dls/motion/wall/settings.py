"""Numbers of the posterior of a wall in space."""

from __future__ import annotations

from dataclasses import dataclass

from ...settings import number


@dataclass(frozen=True)
class WallSettings:
    """These settings say how finely the errors of a moved wall are held together."""

    nodes: int = number(
        500, "nodes", "nodes at which errors are joint: 4 to 5 mm apart on an atrium, a third of its lengths"
    )
    neighbours: int = number(
        16, "nodes", "nodes that a place is interpolated from: eight miss some deviations by 7 %"
    )
    nugget: float = number(
        1e-9, "variances", "variance that each node has of its own, so that rounding leaves none below zero"
    )
    least_shared: float = number(
        1e-9, "variances", "largest covariance of two points' errors that counts as none: it is rounding"
    )


SETTINGS = WallSettings()
