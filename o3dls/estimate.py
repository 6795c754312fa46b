"""What we believe the surface is, and how we came to believe it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .arrays import Array
from .case import Case
from .errors import escaped
from .geometry.similarity import scale_of
from .geometry.surface import Surface
from .run_warning import RunWarning

if TYPE_CHECKING:
    from .levelset.grid.distance import SignedDistance
    from .motion.recorded import Motion
    from .motion.result import MotionFit
    from .noise.shifted_part import MapShift

SHIFTED = "shifted"  # column of the points that an offset was taken out of


@dataclass(frozen=True, eq=False)
class Estimate:
    """An estimate is a surface in the map frame with the motion that led to it, and a sentence on how it
    went.

    T_map_prior (d+1, d+1) is the similarity part; sigma the noise level found (case units); weights (k,) in
    [0, 1] are the probabilities that each mapping point touches the wall; trace holds one record per
    iteration; phi is the level set where there is one; fit is the motion's fit, which Deform.update and the
    stage `topology` go on from; map_shift is the offset of a part of the map that the estimate is free of.
    """

    surface: Surface
    T_map_prior: Array
    status: str
    converged: bool = True
    iterations: int = 0
    seconds: float = 0.0
    sigma: float | None = None
    weights: Array | None = None
    motion: Motion | None = None
    phi: SignedDistance | None = None
    fit: MotionFit | None = None
    map_shift: MapShift | None = None
    trace: tuple[Mapping[str, float], ...] = ()
    warnings: tuple[RunWarning, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)  # further results of the stage, JSON-ready

    def __repr__(self) -> str:
        noise = "" if self.sigma is None else f", noise {self.sigma:.3g}"
        ended = "converged" if self.converged else "did not converge"
        return f"Estimate({self.surface!r}{noise}, {ended}: {escaped(self.status)})"

    @property
    def scale(self) -> float:
        return scale_of(self.T_map_prior)

    def corrected(self, case: Case) -> Case:
        """The case as the estimate sees it: without the offset of a part of its points, which get the column
        `shifted` (1 for those of the part); the same one where no offset was taken out.
        """
        if self.map_shift is None:
            return case
        points = case.points
        shift = self.map_shift
        xyz = shift.without(points.xyz, points.taken, points.type == "landmark")
        columns = {**points.columns, SHIFTED: (xyz != points.xyz).any(axis=1).astype(np.float64)}
        return replace(case, points=replace(points, xyz=xyz, columns=columns))
