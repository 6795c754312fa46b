"""What we believe the surface is, and how we came to believe it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .arrays import Array
from .geometry.similarity import scale_of
from .geometry.surface import Surface
from .motion.interface import Motion


@dataclass(frozen=True, eq=False)
class Estimate:
    """A surface in the map frame with the motion that led to it, and a sentence on how it went.

    T_map_prior (d+1, d+1) is the similarity part; sigma the noise level found (case units); weights (k,) in
    [0, 1] say how far each mapping point was believed; trace holds one record per iteration; phi is the level
    set where there is one, fit what its stage needs to go on from here with more points (Deform.update).
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
    phi: Any = None
    fit: Any = None
    trace: tuple[Mapping[str, float], ...] = ()
    warnings: tuple[str, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)  # further results of the stage, JSON-ready

    @property
    def scale(self) -> float:
        return scale_of(self.T_map_prior)
