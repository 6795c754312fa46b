"""Numbers of the motion off the wall."""

from __future__ import annotations

from dataclasses import dataclass

from ...settings import number


@dataclass(frozen=True)
class OffWallSettings:
    """These settings say how exactly the motion of the wall is held in space, how it is turned around, and
    what of it counts as known.
    """

    node_spacing: float = number(
        0.3, "shortest lengths", "distance of places of the wall that hold the field"
    )
    most_even: int = number(
        2000, "places", "most places that are spread evenly: their covariance is factored"
    )
    rounds: tuple[int, ...] = number(
        (400, 400, 400), "places", "most places more, in each round, where the field misses the wall's motion"
    )
    missed: float = number(0.003, "mm", "distance by which the field must miss a place to be held there too")
    nuggets: tuple[float, ...] = number(
        (1e-7, 1e-4, 1e-2),
        "variances",
        "parts of the motion that a smooth field may leave, as of a rough prior: the likeliest is taken",
    )
    counted: float = number(99.0, "%", "share of the wall that must be followed: needles of a prior are not")
    followed: float = number(
        0.1, "mm", "distance by which the field may miss that share: more is no rounding, but a fold"
    )
    known: float = number(
        0.5,
        "1",
        "share of the wall's own displacement up to which the deviation of the field counts as known",
    )
    slope_step: float = number(1e-3, "rms radii", "step of the differences that show where the field folds")
    tolerance: float = number(1e-4, "mm", "distance by which an inverse may miss: far below any voxel")
    most_steps: int = number(
        60, "steps", "most steps of the fixed point: a motion without folds takes 5 to 20"
    )
    most_nodes: int = number(30_000_000, "nodes", "most nodes of a grid: a field of 360 MB")
    coarser: float = number(2.0, "spacings", "distance of the nodes of the deviation, which is smoother")
    at_once: int = number(20_000, "places", "places whose covariances with the wall are in memory together")
    rounding: float = number(1e-6, "spacings", "rounding of a place's index in a grid")


SETTINGS = OffWallSettings()
