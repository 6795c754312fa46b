"""Stage `paper_level_set`: the paper's level set, equations 8-16, with the least repairs that make them
computable.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..geometry.similarity import rms_radius
from ..plugins.stage import FINEST, Stage
from .level_set_checks import SCALED, check_spacing, spacing_mistake
from .level_set_data import estimate_of, meshed


class PaperLevelSet(Stage):
    """Minimise the paper's energy from the prior under the similarity, equations 8-16, and mesh the zero set.

    For comparison with `level_set`. Parts that the points cut off stay.
    """

    name: ClassVar[str] = "paper_level_set"
    spacing: float = Field(
        default=1.0, ge=FINEST, description="distance between grid nodes", json_schema_extra={"unit": "mm"}
    )
    data: float = Field(default=10.0, ge=0.0, description="weight of the data term, over the squared noise")
    area: float = Field(default=0.2, ge=0.0, description="weight of the area term")
    shape: float = Field(default=0.3, ge=0.0, description="weight of the shape term")
    # what has not converged by then does not
    iterations: int = Field(default=20, ge=1, le=1000, description="most reinitialisations")
    # a hundred leave no detail
    smoothing: int = Field(default=3, ge=0, le=100, description="Taubin passes on the extracted mesh")
    keep: float = Field(
        default=0.5, gt=0.0, le=1.0, description="fraction of the isosurface's faces that decimation keeps"
    )

    def mistake(self, case: Case) -> str | None:
        return spacing_mistake(self.spacing, case.prior, case.units, SCALED)

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..adapters.self_intersections import crossing
        from ..evaluation.distances import distances
        from ..levelset.paper import Weights, descend
        from ..noise.robust import robust_sd
        from ..noise.settings import MixtureSettings

        if not (case.points.type == "eam").any():
            raise InputError(f"paper_level_set: case {case.name} has no points of type eam")
        check_spacing(self.spacing, start.surface, case.units)
        # psi.T is the prior under the similarity alone, as the paper has it
        prior = case.prior.transformed(start.T_map_prior)
        points = case.points.of("eam").xyz
        noise = start.sigma if start.motion is not None else None
        least = MixtureSettings().least_noise * rms_radius(prior.vertices)
        sigma = noise or max(robust_sd(distances(points, prior)), least)
        weights = Weights(self.data, self.area, self.shape)
        reached = descend(prior, points, sigma, weights, spacing=self.spacing, cycles=self.iterations)
        reached, mesh = meshed(reached, self.spacing, self.smoothing, self.keep)
        warnings = [*start.warnings, *reached.warnings, *reached.faults(mesh.surface, crossing)]
        return replace(estimate_of(start, reached, mesh), warnings=tuple(warnings))
