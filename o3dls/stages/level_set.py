"""Stage `level_set`: the deformed prior as a narrow-band level set, refined where the points ask for it, and meshed again."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from ..case import Case
from ..estimate import Estimate
from ..geometry import Array
from ..stage import Stage

if TYPE_CHECKING:
    from ..levelset.distance import SignedDistance
    from ..levelset.observe import Measured

BAND = 3.0  # half width of the band in lattice spacings


class LevelSet(Stage):
    """Refine phi around the moved prior psi.T: robust foot-point forces, second-order prior, free topology; then extract its surface."""

    name: ClassVar[str] = "level_set"
    spacing: float = Field(1.0, gt=0.0, description="distance of the lattice nodes", json_schema_extra={"unit": "mm"})
    evidence: float = Field(3.0, ge=0.0, description="log evidence that a correction needs to be made", json_schema_extra={"unit": "nats"})
    iterations: int = Field(20, ge=1, description="most iterations per level")
    smoothing: int = Field(5, ge=0, description="Taubin passes on the extracted mesh")
    keep: float = Field(0.5, gt=0.0, le=1.0, description="share of the isosurface's faces left by decimation")

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..extract import carry_fields, extract
        from ..levelset.distance import signed_distance
        from ..levelset.solver import Limits, refine

        began = time.perf_counter()
        prior = start.surface
        psi = signed_distance(prior.vertices, prior.faces, self.spacing, BAND * self.spacing)
        measured = _measured(case, start, psi)
        found = refine(prior, measured, lambda: _doubt(case, start), Limits(self.spacing, self.evidence, self.iterations))
        wall = prior.with_vertices(prior.vertices + found.u[:, None] * prior.vertex_normals) if found.fields else prior
        phi = signed_distance(wall.vertices, wall.faces, self.spacing, BAND * self.spacing) if found.fields else psi
        mesh = extract(phi, smoothing=self.smoothing, keep=self.keep)
        surface = carry_fields(replace(wall, fields={**prior.fields, f"correction_{case.units}": found.u}), mesh.surface)
        return replace(
            start,
            surface=surface,
            status=found.status,
            converged=found.converged,
            iterations=len(found.trace) - len(found.fields),
            seconds=time.perf_counter() - began,
            sigma=float(np.median(measured.likelihood.sigma)) * found.noise,
            phi=phi,
            trace=found.trace,
            facts={"shift_mean": mesh.shift_mean, "shift_max": mesh.shift_max, "band_nodes": len(phi.band)},
        )


def _measured(case: Case, start: Estimate, psi: SignedDistance) -> Measured:
    """The fitted points with the noise and the outliers that the start found among them."""
    from ..levelset.observe import Noise, observe

    points = case.points.of("eam", "inside")
    noise = Noise()
    if start.motion is not None and start.sigma is not None and start.weights is not None:
        noise = Noise(start.sigma, 0.25, float(1.0 - start.weights.mean()))
    own = np.asarray(points.columns.get("sigma", np.full(len(points), np.nan)), dtype=np.float64)
    return observe(start.surface, psi, points.xyz, points.type == "inside", own, noise)


def _doubt(case: Case, start: Estimate) -> Array:
    """How uncertain the motion is at each vertex, relative to its root mean square: half to twice; 1 everywhere where it does not say."""
    if start.motion is None or len(start.surface.vertices) != len(case.prior.vertices):
        return np.ones(len(start.surface.vertices))
    sd = start.motion.sd(case.prior.vertices, start.surface.vertex_normals)
    return np.asarray(np.clip(sd / np.sqrt((sd**2).mean()), 0.5, 2.0))
