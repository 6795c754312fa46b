"""From a moved prior to its refined level set: corrections by evidence, and no tear or merger without it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from ..arrays import Array
from ..geometry.components import component_areas, components_and_euler
from ..geometry.surface import Surface
from ..run_warning import RunWarning
from .correction import Correction, Limits, fit_correction
from .grid.distance import SignedDistance
from .normal_displacement import Wall
from .observation import Measured
from .repair import Attempt, Crossing, Mesher, Repair

COARSE = "walls are closer than the grid resolves"


@dataclass(frozen=True, eq=False)
class Refinement:
    """A level set phi, the wall that it is the signed distance of (with fields per vertex, unless `fields`
    tells them), and how it was reached.
    """

    phi: SignedDistance
    wall: Surface
    sigma: float
    status: str
    converged: bool
    trace: tuple[Mapping[str, float], ...] = ()
    warnings: tuple[RunWarning, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)
    weights: Array | None = None  # (n,) probabilities of contact of the points, where they were asked again
    fields: Callable[[Array], dict[str, Array]] | None = None  # values (n,) at places (n, d) of the wall
    exact: bool = False  # whether the wall is the zero set of phi, face by face
    unchanged: bool = False  # whether nothing was added to the moved prior
    # whether components beside the largest belong to the result: those of the wall, or what the paper's
    # forces cut off
    islands: bool = False

    @property
    def smallest(self) -> float:
        """Area of the wall's smallest component, over that of its largest; 1 where no other than the largest
        stays.
        """
        if not self.islands:
            return 1.0
        _, areas = component_areas(self.wall)
        return float(areas.min() / areas.max())

    def faults(self, mesh: Surface, crossing: Crossing) -> tuple[RunWarning, ...]:
        """A warning where a mesh of phi has another topology than the wall; none where islands belong to the
        result.
        """
        found = components_and_euler(mesh.vertices, mesh.faces)
        meant = components_and_euler(self.wall.vertices, self.wall.faces)
        if found == meant or (self.islands and meant[0] == 1):
            return ()
        why = (
            "it intersects itself, and walls were merged there"
            if crossing(self.wall).any()
            else f"{COARSE}; try a smaller spacing"
        )
        return (
            RunWarning(
                "mesh-differs", f"the mesh has {_words(*found)}, the moved prior {_words(*meant)}: {why}"
            ),
        )


def refine_surface(
    surface: Surface,
    observe: Callable[[Wall], Measured],
    relative_sd: Array,
    limits: Limits,
    *,
    mesh: Mesher,
    crossing: Crossing,
) -> Refinement:
    """Refine a surface by corrections along its normals.

    observe: the points as seen from a wall; relative_sd (v,): standard deviation that the motion leaves at
    every vertex, over its root mean square; mesh: what will mesh phi, since methods cut cells of ambiguous
    signs differently, and it is the mesh that has to be whole; crossing: which faces (m,) of a surface cut
    through others. The result is the surface itself where no correction is needed.
    """
    wall = Wall(surface, limits.settings.observation)
    measured = observe(wall)
    found = fit_correction(wall, measured, relative_sd, limits)
    final, phi, warnings = _kept_whole(wall, found, limits, mesh, cache(crossing))
    return Refinement(
        phi=phi,
        wall=final,
        sigma=found.noise * float(np.median(measured.likelihood.sigma)),
        status=found.status,
        converged=found.converged,
        trace=found.trace,
        warnings=warnings,
        facts={"fields": [f.record for f in found.fields], "band_nodes": len(phi.band)},
        unchanged=not found.fields,
        islands=components_and_euler(wall.rest, wall.faces)[0] > 1,
    )


def _kept_whole(
    wall: Wall, found: Correction, limits: Limits, mesh: Mesher, crossing: Crossing
) -> tuple[Surface, SignedDistance, tuple[RunWarning, ...]]:
    """The corrected wall and its level set: gaps are closed where it intersects itself; a correction that
    splits or merges it is halved.

    Where a wall intersects itself all the same it is united; the mesh may still have the wall's topology.
    """
    kind = components_and_euler(wall.rest, wall.faces)
    lattice = limits.settings.lattice
    repair = Repair(limits.spacing, kind, crossing, lattice, mesh)
    for fraction in lattice.fractions if found.fields else (0.0,):
        final = _corrected(wall, fraction * found.u)
        for attempt in repair.attempts(final, thorough=fraction == 0.0):
            if components_and_euler(*mesh(attempt.phi)) == kind:
                reduced = _reduced(fraction) if found.fields else []
                repairs = _repairs(attempt, final, crossing, limits.unit)
                return final, attempt.phi, (*reduced, *repairs)
    phi = repair.united(final)
    if not found.fields:
        return final, phi, ()
    # the wall comes out otherwise without the correction too: then that must do no harm
    corrected = _corrected(wall, found.u)
    after = repair.united(corrected)
    if components_and_euler(*mesh(after)) == components_and_euler(*mesh(phi)):
        return corrected, after, ()
    left_out = (
        "the correction was left out: the grid cannot hold the corrected surface; try a smaller spacing"
    )
    return final, phi, (RunWarning("correction-left-out", left_out),)


def _reduced(fraction: float) -> list[RunWarning]:
    """A warning where only a fraction of the correction was applied."""
    if fraction == 1.0:
        return []
    if fraction == 0.0:
        left_out = "the correction was left out: any part of it would split or merge the surface"
        return [RunWarning("correction-left-out", left_out)]
    reduced = f"only {fraction:.0%} of the correction was applied: more would split or merge the surface"
    return [RunWarning("correction-reduced", reduced)]


def _repairs(attempt: Attempt, surface: Surface, crossing: Crossing, unit: str) -> list[RunWarning]:
    """A warning on how a level set was repaired; none where nothing was done."""
    done = list(attempt.done)
    if attempt.closing > 0.0:
        done.insert(0, f"gaps narrower than {2.0 * attempt.closing:g} {unit} were closed")
    if not done:
        return []
    if crossing(surface).any():  # which takes its time: asked only here
        intersects = f"the moved prior intersects itself: {', '.join(done)}"
        return [RunWarning("self-intersection-repaired", intersects)]
    return [RunWarning("thin-gap-repaired", f"{COARSE}: {', '.join(done)}; try a smaller spacing")]


def _words(components: int, euler: int) -> str:
    return f"{components} component{'s' * (components != 1)} (Euler number {euler})"


def _corrected(wall: Wall, u: Array) -> Surface:
    """The wall moved by u (v,) along its normals, and u as a field."""
    fields = {**wall.surface.fields, "correction": u}
    return Surface(wall.rest + u[:, None] * wall.normals, wall.faces, fields)
