"""Stage `level_set`: the deformed prior as a narrow-band level set, refined where the points ask for it, and
meshed again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ..arrays import Array
from ..case import FITTED_TYPES, Case
from ..errors import InputError
from ..estimate import Estimate
from ..geometry.similarity import rms_radius
from ..geometry.surface import Surface
from ..plugins.parameters import unfitting
from ..plugins.stage import FINEST, Stage
from .level_set_checks import SCALED, check_mesh, check_spacing, lost_parts, spacing_mistake

if TYPE_CHECKING:
    from ..adapters.meshing import Extraction
    from ..levelset.normal_displacement import Wall
    from ..levelset.observation import Measured, Noise
    from ..levelset.reconstruction.reconstruct import Believed
    from ..levelset.refine import Refinement
    from ..motion.result import MotionFit

SIGMA_LOG_SD = 0.1  # of the logarithm of a noise level that the motion found
PAPER_ONLY = ("data", "area", "shape")
DEFAULT_ONLY = ("evidence", "coarse_to_fine", "reconstruct")


class LevelSet(Stage):
    """Correct the level set phi of the moved prior where the points ask for it; mesh its zero set.

    Corrections along its normals, coarse to fine, that the evidence supports; or, where points show a wall
    that these cannot reach, phi is reconstructed from them. The motion stays.
    """

    name: ClassVar[str] = "level_set"
    formulation: Literal["default", "paper"] = Field(
        "default",
        description="ours, or equations 8-16 of the paper with the least repairs that make them computable",
    )
    spacing: float = Field(
        1.0, ge=FINEST, description="distance between grid nodes", json_schema_extra={"unit": "mm"}
    )
    evidence: float = Field(
        3.0,
        ge=0.0,
        description="default: log evidence that a field of corrections must have",
        json_schema_extra={"unit": "nats"},
    )
    coarse_to_fine: bool = Field(
        True,
        description="default: try corrections of all correlation lengths, longest first; or the shortest",
    )
    reconstruct: bool = Field(
        True,
        description="default: reconstruct the wall from the points where this predicts left-out points "
        "better than the moved prior does",
    )
    data: float = Field(10.0, ge=0.0, description="paper: weight of the data term, over the squared noise")
    area: float = Field(0.2, ge=0.0, description="paper: weight of the area term")
    shape: float = Field(0.3, ge=0.0, description="paper: weight of the shape term")
    # what has not converged by then does not
    iterations: int = Field(
        20, ge=1, le=1000, description="most iterations per level; paper: most reinitialisations"
    )
    # a hundred leave no detail
    smoothing: int = Field(3, ge=0, le=100, description="Taubin passes on the extracted mesh")
    keep: float = Field(
        0.5, gt=0.0, le=1.0, description="fraction of the isosurface's faces that decimation keeps"
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
        return replace(self._estimate(case, start, reached, mesh), warnings=tuple(warnings))

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
        return replace(
            start,
            surface=_with_unit(surface, case.units),
            status="; ".join([*unfinished, reached.status]),
            converged=reached.converged and not unfinished,
            iterations=sum(row["iteration"] > 0 for row in reached.trace),
            sigma=reached.sigma,
            weights=start.weights if reached.weights is None else _of_mapping(start.fit, reached.weights),
            phi=reached.phi,
            trace=reached.trace,
            facts={**reached.facts, "changes": changes, **shifts},
        )

    def _by_default(self, case: Case, start: Estimate) -> Refinement:
        from ..adapters.meshing import isosurface
        from ..adapters.self_intersections import crossing
        from ..geometry.fold_repair import uncrossed
        from ..levelset.correction import Limits
        from ..levelset.reconstruction.deviation import with_doubt
        from ..levelset.reconstruction.refinement import reconstructed
        from ..levelset.refine import refine_surface
        from ..levelset.settings import LevelSetSettings

        usual = LevelSetSettings()
        chosen = replace(usual.correction, evidence=self.evidence, iterations=self.iterations)
        settings = replace(usual, correction=chosen)
        limits = Limits(self.spacing, self.coarse_to_fine, case.units, settings)
        surface = uncrossed(start.surface) if case.dimension == 2 else start.surface
        if self.reconstruct and start.fit is not None and case.dimension == 3:
            points, sd = believed(start.fit), f"sd_{case.units}"
            found = reconstructed(surface, points, sd, limits, isosurface)
            if found is not None:
                return found
            surface = with_doubt(surface, points, sd, settings.reconstruction)
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


def believed(fit: MotionFit) -> Believed:
    """The points that may touch the wall as the motion left them, and those that are known to be inside."""
    from ..levelset.reconstruction.reconstruct import Believed, Inside

    data, state = fit.problem.data, fit.state
    wall = ~data.inside
    noise = state.scales.noises[data.group] * data.relative
    inside = Inside(data.points[~wall], noise[~wall])
    touching = data.points[wall], state.weights[wall], noise[wall], data.outlier_odds[wall]
    return Believed(*touching, state.contact, inside, fit.gradient)


def _of_mapping(fit: MotionFit | None, weights: Array) -> Array:
    """Probabilities of contact (k,) of the mapping points, of those of all points that may touch."""
    assert fit is not None
    wall = ~fit.problem.data.inside
    every = fit.state.weights.copy()
    every[wall] = weights
    return replace(fit, state=replace(fit.state, weights=every)).weights


def observer(case: Case, start: Estimate) -> Callable[[Wall], Measured]:
    """How the fitted points look from a wall, with the noise and the outliers that the start found."""
    from ..levelset.observation import observe
    from ..noise.duplicates import distinct_places, duplicate_distance

    every = case.points.of(*FITTED_TYPES)
    data = start.fit.problem.data if start.fit else None
    radius = rms_radius(case.prior.vertices)
    within = data.duplicate_distance if data else duplicate_distance(every.xyz, every.type, radius)
    rows, _ = distinct_places(every.xyz, every.type, within)
    points = every.select(rows)
    relative = every.relative_noise(data.typical_sigma if data else None)[rows]
    return lambda wall: observe(wall, points.xyz, points.type == "inside", relative, noise_of(start))


def noise_of(start: Estimate) -> Noise:
    from ..levelset.observation import Noise

    if start.motion is None or start.sigma is None or start.weights is None:
        return Noise()
    inside = start.fit.state.contact.inside_fraction if start.fit else None
    return Noise(start.sigma, SIGMA_LOG_SD, float(1.0 - start.weights.mean()), inside)


def relative_sd(case: Case, start: Estimate) -> Array:
    """How uncertain the motion is at each vertex, relative to its root mean square, half to twice; 1
    everywhere where it does not say.
    """
    sd = start.surface.fields.get(f"sd_{case.units}")
    if sd is None or not sd.any():
        return np.ones(len(start.surface.vertices))
    return np.asarray(np.clip(sd / np.sqrt((sd**2).mean()), 0.5, 2.0))


def _with_unit(surface: Surface, unit: str) -> Surface:
    """The correction's field under the name that tells its unit."""
    names = {"correction": f"correction_{unit}"}
    return replace(surface, fields={names.get(name, name): x for name, x in surface.fields.items()})
