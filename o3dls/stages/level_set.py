"""Stage `level_set`: the moved prior as a narrow-band level set, reconstructed from the points where they ask
for it, and meshed again where it is not a valid mesh as it came.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..geometry.surface import Surface
from ..plugins.stage import FINEST, Stage
from .level_set_checks import LOST, SCALED, check_mesh, check_spacing, lost_parts, spacing_mistake
from .level_set_data import GivenPoints, estimate_of, given_points, meshed, with_existence

if TYPE_CHECKING:
    from ..levelset.result import Result

FINER = (
    0.5  # of the spacing: a second lattice, where the first changed or lost something of a wall that stays
)


class LevelSet(Stage):
    """Turn the moved prior into a level set phi, reconstruct it where the points ask for it, and mesh the
    reconstruction.

    Where points show a wall that no motion reaches, phi is reconstructed from them; elsewhere, and always in
    2D, it is the moved prior's signed distance. If nothing is reconstructed, the surface is the moved prior,
    vertex by vertex, but for faces that the motion folded over, whose corners are moved between their
    neighbours. Only where it still cuts through itself is it repaired on the lattice and meshed anew. The
    motion stays.
    """

    name: ClassVar[str] = "level_set"
    spacing: float = Field(
        default=1.0, ge=FINEST, description="distance between grid nodes", json_schema_extra={"unit": "mm"}
    )
    reconstruct: bool = Field(
        default=True,
        description="reconstruct the wall from the points where this predicts left-out points better than "
        "the moved prior does",
    )
    # a hundred leave no detail
    smoothing: int = Field(default=3, ge=0, le=100, description="Taubin passes on phi's mesh")
    keep: float = Field(
        default=0.5,
        gt=0.0,
        le=1.0,
        description="fraction of the faces of phi's mesh that decimation keeps",
    )

    def mistake(self, case: Case) -> str | None:
        return spacing_mistake(self.spacing, case.prior, case.units, SCALED)

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..adapters.self_intersections import crossing

        if not (case.points.type == "eam").any():
            raise InputError(f"level_set: case {case.name} has no points of type eam")
        check_spacing(self.spacing, start.surface, case.units)
        given = given_points(case, start) if case.dimension == 3 else None
        asked = given is not None and self.reconstruct
        reached = self._reconstruct_wall(case, start, given) if given and asked else None
        spacing, keep = self.spacing, self.keep
        reached = reached or self._moved_prior(case, start.surface, spacing, asked=asked)
        reached, mesh = meshed(reached, spacing, self.smoothing, keep)
        faults = reached.faults(mesh.surface, crossing)
        if faults and reached.unchanged and not spacing_mistake(FINER * spacing, start.surface, case.units):
            # walls are closer than the lattice tells apart: a finer one, of which as many faces are kept
            spacing, keep = FINER * spacing, FINER**2 * keep
            reached = self._moved_prior(case, start.surface, spacing, asked=asked)
            reached, mesh = meshed(reached, spacing, self.smoothing, keep)
            faults = reached.faults(mesh.surface, crossing)
        check_mesh(mesh.surface, reached.wall, spacing, keep, case.units)
        warnings = [*start.warnings, *reached.warnings, *faults]
        warnings += lost_parts(mesh.surface, reached.wall, spacing, case.units)
        found = replace(estimate_of(start, reached, mesh), warnings=tuple(warnings))
        return _complete_estimate(found, start, reached, given)

    def _reconstruct_wall(self, case: Case, start: Estimate, given: GivenPoints) -> Result | None:
        """Return the reconstruction that the points ask for, if they do."""
        from ..adapters.meshing import isosurface
        from ..reconstruction.reconstructed import reconstructed

        return reconstructed(start.surface, given.believed, case.units, self.spacing, isosurface)

    def _moved_prior(self, case: Case, surface: Surface, spacing: float, *, asked: bool) -> Result:
        """Return the level set of the moved prior; asked: whether the points were asked for another wall."""
        from ..adapters.meshing import isosurface
        from ..adapters.self_intersections import crossing
        from ..geometry.components import components_and_euler
        from ..geometry.flipped_faces import flipped
        from ..geometry.fold_repair import uncrossed
        from ..levelset.grid.distance import signed_distance
        from ..levelset.repair import relaxed_in_place, whole_level_set
        from ..levelset.result import Result
        from ..levelset.settings import LatticeSettings

        surface = uncrossed(surface) if case.dimension == 2 else surface
        valid = relaxed_in_place(
            surface, int(flipped(case.prior).sum()), LOST * spacing, case.units, crossing
        )
        if valid:
            surface, warnings = valid
            width = LatticeSettings().half_band * spacing
            phi = signed_distance(surface.vertices, surface.faces, spacing, width)
        else:
            phi, warnings = whole_level_set(surface, spacing, case.units, mesh=isosurface, crossing=crossing)
        pieces, _ = components_and_euler(surface.vertices, surface.faces)
        why = "the points ask for no other wall" if asked else "no reconstruction was asked for"
        why = "outlines in the plane are not reconstructed" if case.dimension == 2 else why
        nothing = {f"correction_{case.units}": np.zeros(len(surface.vertices))}
        return Result(
            phi,
            replace(surface, fields={**surface.fields, **nothing}),
            sigma=None,
            status=f"the moved prior stays: {why}",
            warnings=warnings,
            facts={"band_nodes": len(phi.band)},
            unchanged=True,
            valid=valid is not None,
            islands=pieces > 1,
        )


def _complete_estimate(
    found: Estimate, start: Estimate, reached: Result, given: GivenPoints | None
) -> Estimate:
    """Return the estimate with what the points say of its wall, and how much of the wall before is gone,
    where a warning says that some is; it is not converged where the motion is not.
    """
    from ..evaluation.removed_wall import removed_wall

    if start.fit is not None and not start.fit.converged:  # a motion that still moves takes its wall along
        status = f"the motion had not converged; {found.status}"
        found = replace(found, status=status, converged=False)
    if given is None:
        return found
    points = given.believed
    if reached.weights is not None:
        points = replace(points, weights=reached.weights)
        found = replace(found, weights=given.of_mapping(reached.weights))
    if start.fit is not None:
        found = replace(found, surface=with_existence(found.surface, points))
    told = {warning.code for warning in found.warnings} & {"topology-changed", "parts-lost"}
    gone = removed_wall(start.surface, found.surface) if told else {}
    return replace(found, facts={**found.facts, **gone})
