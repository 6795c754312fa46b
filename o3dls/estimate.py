"""What we believe the surface is, and how we came to believe it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from .arrays import Array
from .geometry.similarity import scale_of
from .geometry.surface import Surface
from .motion.interface import Motion
from .run_warning import RunWarning

if TYPE_CHECKING:
    from .levelset.grid.distance import SignedDistance
    from .motion.result import MotionFit


@dataclass(frozen=True, eq=False)
class Estimate:
    """A surface in the map frame with the motion that led to it, and a sentence on how it went.

    T_map_prior (d+1, d+1) is the similarity part; sigma the noise level found (case units); weights (k,) in
    [0, 1] are the probabilities that each mapping point touches the wall; trace holds one record per
    iteration; phi is the level set where there is one; fit is the motion's fit, which Deform.update and the
    stage `topology` go on from.
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
    trace: tuple[Mapping[str, float], ...] = ()
    warnings: tuple[RunWarning, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)  # further results of the stage, JSON-ready

    @property
    def scale(self) -> float:
        return scale_of(self.T_map_prior)
