"""Stage `level_set`: the deformed prior as a narrow-band level set, refined where the points ask for it, and
meshed again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from ..arrays import Array
from ..case import FITTED_TYPES, Case
from ..errors import InputError, SolverError
from ..estimate import Estimate
from ..geometry.similarity import rms_radius
from ..geometry.surface import Surface
from ..plugins.stage import Stage

if TYPE_CHECKING:
    from ..levelset.distance import SignedDistance
    from ..levelset.normal_displacement import Wall
    from ..levelset.observation import Measured, Noise
    from ..levelset.refine import Refinement

SIGMA_LOG_SD = 0.1  # of the logarithm of a noise level that the motion found
COARSEST = 0.1  # spacing over the surface's diagonal: such a lattice cuts off a fifth of an atrium
MOST_NODES = 1e7  # of the narrow band: 4 GB; an atrium has so many at a spacing of 0.07 mm
LOST = 2.0  # spacings: a sharp edge that the lattice rounds off is nearer to what it leaves
NOTHING = 8.0  # cells of the lattice: less is no surface
UNLIKE = (
    0.25  # relative difference in volume from what was to be meshed that is no matter of accuracy any more
)


class LevelSet(Stage):
    """Refine phi around the moved prior psi.T by robust foot-point forces and a second-order prior, topology
    free; mesh its zero set.
    """

    name: ClassVar[str] = "level_set"
    formulation: Literal["default", "paper"] = Field(
        "default",
        description="ours, or equations 8-16 of the paper with the least repairs that make them computable",
    )
    spacing: float = Field(
        1.0, gt=0.0, description="distance of the lattice nodes", json_schema_extra={"unit": "mm"}
    )
    evidence: float = Field(
        3.0,
        ge=0.0,
        description="default: log evidence that a field of corrections must earn",
        json_schema_extra={"unit": "nats"},
    )
    change: float = Field(
        10.0,
        ge=0.0,
        description="default: log evidence that a change of topology must earn",
        json_schema_extra={"unit": "nats"},
    )
    coarse_to_fine: bool = Field(
        True,
        description=(
            "default: try corrections of all correlation lengths, the longest first; or the shortest alone"
        ),
    )
    data: float = Field(10.0, ge=0.0, description="paper: weight of the data term, over the squared noise")
    area: float = Field(0.2, ge=0.0, description="paper: weight of the area term")
    shape: float = Field(0.3, ge=0.0, description="paper: weight of the shape term")
    iterations: int = Field(20, ge=1, description="most iterations per level; paper: most reinitialisations")
    smoothing: int = Field(3, ge=0, description="Taubin passes on the extracted mesh")
    keep: float = Field(0.5, gt=0.0, le=1.0, description="share of the isosurface's faces left by decimation")

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..adapters.meshing import carry_fields, extract
        from ..adapters.self_intersections import crossing
        from ..levelset.isosurface import reinitialise

        if not (case.points.type == "eam").any():
            raise InputError(f"level_set: case {case.name} has no points of type eam")
        self._check_spacing(start.surface, case.units)
        start, changes = self._reshaped(case, start)
        unfinished = self._unfinished(start)
        reached = (
            self._by_the_paper(case, start) if self.formulation == "paper" else self._by_default(case, start)
        )
        mesh = extract(
            reached.phi,
            smoothing=self.smoothing,
            keep=self.keep,
            islands=reached.islands,
            smallest=reached.smallest,
        )
        # a polyline needs no repair, and a lattice would cut its tips
        if case.dimension == 2 and reached.unchanged:
            mesh = replace(mesh, surface=reached.wall)
            reached = replace(reached, phi=self._distance(reached.wall), warnings=())
        elif reached.warnings:  # closed or cut, phi is no distance where it was
            reached = replace(reached, phi=reinitialise(reached.phi.band, reached.phi.phi))
        said = [*reached.faults(mesh.surface, crossing)]
        if self.formulation == "default":
            self._check_mesh(mesh.surface, reached.wall, case.units)
            said += self._lost(mesh.surface, reached.wall, case.units)
        return replace(
            start,
            surface=_with_unit(carry_fields(reached.wall, mesh.surface), case.units),
            status="; ".join([*changes, *unfinished, reached.status]),
            converged=reached.converged and not unfinished,
            iterations=sum(row["iteration"] > 0 for row in reached.trace),
            sigma=reached.sigma,
            phi=reached.phi,
            trace=reached.trace,
            warnings=(
                *start.warnings,
                *(f"{change}: look at it" for change in changes),
                *reached.warnings,
                *said,
            ),
            facts={
                **reached.facts,
                "changes": changes,
                "meshing_shift_mean": mesh.shift_mean,
                "meshing_shift_max": mesh.shift_max,
            },
        )

    def _unfinished(self, start: Estimate) -> list[str]:
        """A sentence where the motion that is refined had not come to stand still: then nor has the
        result.
        """
        lean = self.formulation == "default" and start.fit is not None and not start.fit.converged
        return ["the motion had not converged"] if lean else []

    def _distance(self, surface: Surface) -> SignedDistance:
        from ..levelset.distance import signed_distance
        from ..levelset.settings import LatticeSettings

        return signed_distance(
            surface.vertices, surface.faces, self.spacing, LatticeSettings().half_band * self.spacing
        )

    def _check_spacing(self, surface: Surface, unit: str) -> None:
        """Raise InputError where such a lattice cannot hold the surface, as when lengths are not in mm, or
        would fill the memory.
        """
        from ..levelset.settings import LatticeSettings

        d, size = surface.dimension, surface.diagonal
        # two digits round by up to a twentieth: what is said to be right must not be refused
        said = f"level_set.spacing = {self.spacing:g} {unit}: the surface is {size:.3g} {unit} across"
        if self.spacing > COARSEST * size:
            raise InputError(
                f"{said}; take at most {0.94 * COARSEST * size:.2g} {unit}, or check that its lengths "
                f"are in {unit}"
            )
        least = (2.0 * LatticeSettings().half_band * surface.area / MOST_NODES) ** (1.0 / (d - 1))
        if self.spacing < least:
            raise InputError(
                f"{said}, and the lattice too large for the memory; take at least {1.06 * least:.2g} {unit}"
            )

    def _check_mesh(self, mesh: Surface, wall: Surface, unit: str) -> None:
        """Raise SolverError where the mesh encloses far more or less than the wall that it stands for."""
        change = mesh.volume / wall.volume - 1.0
        if mesh.volume < NOTHING * self.spacing**wall.dimension:
            raise SolverError(
                "level_set: the surface shrank to nothing: the start or the scale may be wrong, or the "
                "points another surface's"
            )
        if abs(change) > UNLIKE:
            raise SolverError(
                f"level_set: the mesh encloses {abs(change):.0%} {'more' if change > 0.0 else 'less'} "
                "than the surface it stands for; "
                f"a spacing below {self.spacing:g} {unit} or a share to keep above {self.keep:g} may "
                "follow it, unless that is folded"
            )

    def _lost(self, mesh: Surface, wall: Surface, unit: str) -> list[str]:
        """A sentence where parts of the wall, however little they enclose, are not in the mesh."""
        from ..levelset.normal_displacement import Wall

        far = float(Wall(mesh).look(wall.vertices)[0].max()) / self.spacing
        if far < LOST:
            return []
        lost = f"parts of the moved prior, up to {far * self.spacing:.2g} {unit} from the mesh, are lost"
        return [
            f"{lost}: thinner than the lattice can hold, or cut off where it runs into itself; a smaller "
            "spacing may keep them"
        ]

    def _reshaped(self, case: Case, start: Estimate) -> tuple[Estimate, list[str]]:
        """The start with the changes of topology that earn their nats, and these as sentences: none without a
        motion that was fitted.
        """
        if self.formulation == "paper" or start.fit is None:
            return start, []
        from ..adapters.meshing import carry_fields
        from ..topology.search import change_topology
        from ..topology.settings import TopologySettings

        fit, changes = change_topology(
            start.fit, spacing=self.spacing, settings=TopologySettings(evidence=self.change)
        )
        if not changes:
            return start, []
        surface = carry_fields(start.surface, Surface(fit.vertices, fit.motion.faces))
        surface = replace(surface, fields={**surface.fields, f"sd_{case.units}": fit.sd})
        found = replace(start, surface=surface, sigma=fit.sigma, weights=fit.weights, fit=fit)
        # a motion that begins earlier, as that of `phases`, stays what it was
        if start.motion is start.fit.motion:
            found = replace(found, T_map_prior=fit.similarity, motion=fit.motion)
        return found, [change.sentence for change in changes]

    def _by_default(self, case: Case, start: Estimate) -> Refinement:
        from ..adapters.meshing import isosurface
        from ..adapters.self_intersections import crossing
        from ..geometry.fold_repair import uncrossed
        from ..levelset.correction import Limits
        from ..levelset.refine import refine_surface
        from ..levelset.settings import LevelSetSettings

        usual = LevelSetSettings()
        chosen = replace(usual.correction, evidence=self.evidence, iterations=self.iterations)
        settings = replace(usual, correction=chosen)
        limits = Limits(self.spacing, self.coarse_to_fine, case.units, settings)
        surface = uncrossed(start.surface) if case.dimension == 2 else start.surface
        return refine_surface(
            surface,
            _observer(case, start),
            _relative_sd(case, start),
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
        sigma = _noise(start).sigma or max(
            robust_sd(distances(points, prior)),
            ObservationSettings().exact_noise * rms_radius(prior.vertices),
        )
        weights = Weights(self.data, self.area, self.shape)
        return descend(prior, points, sigma, weights, spacing=self.spacing, cycles=self.iterations)


def _observer(case: Case, start: Estimate) -> Callable[[Wall], Measured]:
    """How the fitted points look from a wall, with the noise and the outliers that the start found among
    them.
    """
    from ..levelset.observation import observe
    from ..noise.duplicates import distinct_places, duplicate_distance

    every = case.points.of(*FITTED_TYPES)
    data = start.fit.problem.data if start.fit else None
    radius = rms_radius(case.prior.vertices)
    within = data.duplicate_distance if data else duplicate_distance(every.xyz, every.type, radius)
    rows, _ = distinct_places(every.xyz, every.type, within)
    points = every.select(rows)
    relative = every.relative_noise(data.typical_sigma if data else None)[rows]
    return lambda wall: observe(wall, points.xyz, points.type == "inside", relative, _noise(start))


def _noise(start: Estimate) -> Noise:
    from ..levelset.observation import Noise

    if start.motion is None or start.sigma is None or start.weights is None:
        return Noise()
    inside = start.fit.state.contact.inside_fraction if start.fit else None
    return Noise(start.sigma, SIGMA_LOG_SD, float(1.0 - start.weights.mean()), inside)


def _relative_sd(case: Case, start: Estimate) -> Array:
    """How uncertain the motion is at each vertex, relative to its root mean square, half to twice; 1
    everywhere where it does not say.
    """
    sd = start.surface.fields.get(f"sd_{case.units}")
    if sd is None or not sd.any():
        return np.ones(len(start.surface.vertices))
    return np.asarray(np.clip(sd / np.sqrt((sd**2).mean()), 0.5, 2.0))


def _with_unit(surface: Surface, unit: str) -> Surface:
    """The correction's field under the name that tells its unit."""
    fields = {
        f"{name}_{unit}" if name == "correction" else name: values for name, values in surface.fields.items()
    }
    return replace(surface, fields=fields)
