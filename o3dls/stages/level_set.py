"""Stage `level_set`: the deformed prior as a narrow-band level set, refined where the points ask for it, and
meshed again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Literal, Self

from pydantic import Field, model_validator

from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..geometry.similarity import rms_radius
from ..geometry.surface import Surface
from ..plugins.parameters import unfitting
from ..plugins.stage import FINEST, Stage
from .level_set_checks import SCALED, check_mesh, check_spacing, lost_parts, spacing_mistake
from .level_set_data import believed, noise_of, observer, of_mapping, relative_sd, with_existence

if TYPE_CHECKING:
    from ..adapters.meshing import Extraction
    from ..levelset.refine import Refinement

PAPER_ONLY = ("data", "area", "shape")
DEFAULT_ONLY = ("evidence", "coarse_to_fine", "reconstruct")


class LevelSet(Stage):
    """Correct the level set phi of the moved prior where the points ask for it; mesh its zero set.

    Corrections along its normals, coarse to fine, that the evidence supports; or, where points show a wall
    that these cannot reach, phi is reconstructed from them. The motion stays.
    """

    name: ClassVar[str] = "level_set"
    formulation: Literal["default", "paper"] = Field(
        default="default",
        description="ours, or equations 8-16 of the paper with the least repairs that make them computable",
    )
    spacing: float = Field(
        default=1.0, ge=FINEST, description="distance between grid nodes", json_schema_extra={"unit": "mm"}
    )
    evidence: float = Field(
        default=3.0,
        ge=0.0,
        description="default: log evidence that a field of corrections must have",
        json_schema_extra={"unit": "nats"},
    )
    coarse_to_fine: bool = Field(
        default=True,
        description="default: try corrections of all correlation lengths, longest first; or the shortest",
    )
    reconstruct: bool = Field(
        default=True,
        description="default: reconstruct the wall from the points where this predicts left-out points "
        "better than the moved prior does",
    )
    data: float = Field(
        default=10.0, ge=0.0, description="paper: weight of the data term, over the squared noise"
    )
    area: float = Field(default=0.2, ge=0.0, description="paper: weight of the area term")
    shape: float = Field(default=0.3, ge=0.0, description="paper: weight of the shape term")
    # what has not converged by then does not
    iterations: int = Field(
        default=20, ge=1, le=1000, description="most iterations per level; paper: most reinitialisations"
    )
    # a hundred leave no detail
    smoothing: int = Field(default=3, ge=0, le=100, description="Taubin passes on the extracted mesh")
    keep: float = Field(
        default=0.5, gt=0.0, le=1.0, description="fraction of the isosurface's faces that decimation keeps"
    )

    @model_validator(mode="after")
    def _nothing_in_vain(self) -> Self:
        other = "paper" if self.formulation == "default" else "default"
        for parameter in PAPER_ONLY if other == "paper" else DEFAULT_ONLY:
            unfitting(self, parameter, f'unless formulation = "{other}"')
        return self

    def mistake(self, case: Case) -> str | None:
        return spacing_mistake(self.spacing, case.prior, case.units, SCALED)

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..adapters.self_intersections import crossing

        if not (case.points.type == "eam").any():
            raise InputError(f"level_set: case {case.name} has no points of type eam")
        check_spacing(self.spacing, start.surface, case.units)
        paper = self.formulation == "paper"
        reached = self._by_the_paper(case, start) if paper else self._by_default(case, start)
        reached, mesh = self._meshed(reached)
        warnings = [*start.warnings, *reached.warnings, *reached.faults(mesh.surface, crossing)]
        if not paper:
            check_mesh(mesh.surface, reached.wall, self.spacing, self.keep, case.units)
            warnings += lost_parts(mesh.surface, reached.wall, self.spacing, case.units)
        found = replace(self._estimate(case, start, reached, mesh), warnings=tuple(warnings))
        return found if paper or case.dimension == 2 else _with_removed(found, start.surface)

    def _meshed(self, reached: Refinement) -> tuple[Refinement, Extraction]:
        """The mesh of what was reached, and its phi as a distance everywhere."""
        from ..adapters.meshing import extract, isosurface
        from ..levelset.grid.distance import signed_distance
        from ..levelset.settings import LatticeSettings

        mesh = extract(
            reached.phi,
            smoothing=self.smoothing,
            keep=self.keep,
            islands=reached.islands,
            smallest=reached.smallest,
            raw=reached.wall if reached.exact else None,
        )
        wall, width = reached.wall, LatticeSettings().half_band * self.spacing
        # a polyline needs no repair, and a grid would cut its tips
        if wall.dimension == 2 and reached.unchanged:
            phi = signed_distance(wall.vertices, wall.faces, self.spacing, width)
            return replace(reached, phi=phi, warnings=()), replace(mesh, surface=wall)
        if reached.warnings and not reached.exact:  # where gaps were closed or parts cut, phi is no distance
            width = max(width, reached.phi.band.width)
            reached = replace(reached, phi=signed_distance(*isosurface(reached.phi), self.spacing, width))
        return reached, mesh

    def _estimate(self, case: Case, start: Estimate, reached: Refinement, mesh: Extraction) -> Estimate:
        """The start with the refined surface; the motion, its fit and the weights stay."""
        from ..adapters.meshing import carry_fields

        # a motion that is still moving leaves a level set that is
        moving = self.formulation == "default" and start.fit is not None and not start.fit.converged
        unfinished = ["the motion had not converged"] if moving else []
        changes = [*start.facts.get("changes", []), *reached.facts.get("changes", [])]
        shifts = {"meshing_shift_mean": mesh.shift_mean, "meshing_shift_max": mesh.shift_max}
        surface = carry_fields(reached.wall if reached.fields is None else start.surface, mesh.surface)
        if reached.fields is not None:
            surface = replace(surface, fields={**surface.fields, **reached.fields(surface.vertices)})
        surface = with_existence(surface, case, start, reached.weights)
        return replace(
            start,
            surface=_with_unit(surface, case.units),
            status="; ".join([*unfinished, reached.status]),
            converged=reached.converged and not unfinished,
            iterations=sum(row["iteration"] > 0 for row in reached.trace),
            sigma=reached.sigma,
            weights=start.weights if reached.weights is None else of_mapping(start.fit, reached.weights),
            phi=reached.phi,
            trace=reached.trace,
            facts={**reached.facts, "changes": changes, **shifts},
        )

    def _by_default(self, case: Case, start: Estimate) -> Refinement:
        from ..adapters.meshing import isosurface
        from ..adapters.self_intersections import crossing
        from ..geometry.fold_repair import uncrossed
        from ..levelset.correction import Limits
        from ..levelset.reconstruction.refinement import reconstructed
        from ..levelset.refine import refine_surface
        from ..levelset.settings import LevelSetSettings

        usual = LevelSetSettings()
        chosen = replace(usual.correction, evidence=self.evidence, iterations=self.iterations)
        settings = replace(usual, correction=chosen)
        limits = Limits(self.spacing, self.coarse_to_fine, case.units, settings)
        surface = uncrossed(start.surface) if case.dimension == 2 else start.surface
        if self.reconstruct and start.fit is not None and case.dimension == 3:
            points = believed(start.fit, template=case.prior_of == "template")
            found = reconstructed(surface, points, f"sd_{case.units}", limits, isosurface)
            if found is not None:
                return found
        return refine_surface(
            surface,
            observer(case, start),
            relative_sd(case, start),
            limits,
            mesh=isosurface,
            crossing=crossing,
        )

    def _by_the_paper(self, case: Case, start: Estimate) -> Refinement:
        """psi.T is the prior under the similarity alone, as the paper has it."""
        from ..evaluation.distances import distances
        from ..levelset.paper import Weights, descend
        from ..levelset.settings import ObservationSettings
        from ..noise.robust import robust_sd

        prior = case.prior.transformed(start.T_map_prior)
        points = case.points.of("eam").xyz
        sigma = noise_of(start).sigma or max(
            robust_sd(distances(points, prior)),
            ObservationSettings().exact_noise * rms_radius(prior.vertices),
        )
        weights = Weights(self.data, self.area, self.shape)
        return descend(prior, points, sigma, weights, spacing=self.spacing, cycles=self.iterations)


def _with_unit(surface: Surface, unit: str) -> Surface:
    """The correction's field under the name that tells its unit."""
    names = {"correction": f"correction_{unit}"}
    return replace(surface, fields={names.get(name, name): x for name, x in surface.fields.items()})


def _with_removed(found: Estimate, before: Surface) -> Estimate:
    """The estimate with how much of the wall before is gone, where a warning says that some is."""
    from ..evaluation.removed_wall import removed_wall

    told = {warning.code for warning in found.warnings} & {"topology-changed", "parts-lost"}
    return replace(found, facts={**found.facts, **removed_wall(before, found.surface)}) if told else found
