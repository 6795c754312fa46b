"""The paper's formulation, equations 8-16, with the least repairs that make it computable. In our sign
(negative inside) it reads

    E(phi) = sum_i phi(p_i)^2 + a_reg int delta(phi) |grad phi| dx + a_shape int (H(phi) - H(psi.T))^2 dx
    (8, 14, 15)
    d phi/dt = -2 sum_i phi(p_i) delta(x - p_i) + a_reg div(grad phi / |grad phi|) delta(phi)
               - 2 a_shape (H(phi) - H(psi.T)) delta(phi)
               (16)

Repairs, each because the printed form cannot be computed or means something else:
 R1  |phi delta|^2 in (8) squares a Dirac function: the data term is phi(p_i)^2, to which the first term of
 (16) belongs.
 R2  |grad phi| = 1 is demanded but not kept by (16): phi is reinitialised every few steps, exactly, from its
 zero set.
 R3  the last term of (16) stands under an integral, which would make it a number: it is meant pointwise.
 R4  mm^2, mm^2 and mm^3 share one weight: each term has its own, and the data term is divided by the squared
 noise.
 R5  explicit steps of the point sources must shrink with spacing^3: they are taken implicitly.
 R6  no equation moves T: it is the similarity of the stage before and stays.
Known limits stay: a point farther from phi = 0 than the band has no pull, and point sources can cut islands
out of a surface in 3D.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import cg

from ..arrays import Array
from ..errors import SolverError
from ..geometry.components import components_and_euler
from ..geometry.surface import Surface
from ..parallel import one_blas_thread
from ..settings import number
from .grid.band import Band
from .grid.distance import SignedDistance, signed_distance
from .grid.isosurface import reinitialise, zero_set
from .grid.operators import delta, gradient, heaviside, mean_curvature
from .result import Result
from .settings import PaperSettings

LEAST_WEIGHT = 1e-9  # a term without weight sets no limit to the step
DEFAULTS = PaperSettings()


@dataclass(frozen=True)
class Weights:
    """These weights scale the terms of the paper's energy."""

    data: float = number(10.0, "1", "weight of the data term, over the squared noise of the points")
    area: float = number(0.2, "1", "weight a_reg of the area term: with 1, veins of 5 to 7 mm are erased")
    shape: float = number(0.3, "1", "weight a_shape of the shape term")


@one_blas_thread()
def descend(
    prior: Surface,
    points: Array,
    sigma: float,
    weights: Weights,
    *,
    spacing: float,
    cycles: int,
) -> Result:
    """Minimise (8)-(15) from phi = psi.T by (16): `cycles` times some steps, a reinitialisation after each
    cycle.

    prior: the prior moved by T; points (n, d); sigma: their noise. Stops where the energy no longer falls.
    """
    psi = signed_distance(prior.vertices, prior.faces, spacing, DEFAULTS.half_band * spacing)
    field = psi
    trace = [
        {"iteration": 0}
        | energies(psi, heaviside(psi.phi, DEFAULTS.delta_width * spacing), points, sigma, weights)
    ]
    how = "stopped at the iteration limit"
    for _ in range(cycles):
        shape = heaviside(_on_band(psi, field.band), DEFAULTS.delta_width * spacing)
        moved = _make_steps(field, shape, points, sigma, weights, DEFAULTS)
        if not np.isfinite(moved).all():
            raise SolverError(
                "level_set: phi is no longer finite: the paper's weights are too large for the spacing"
            )
        candidate = reinitialise(field.band, moved)
        shape = heaviside(_on_band(psi, candidate.band), DEFAULTS.delta_width * spacing)
        record = energies(candidate, shape, points, sigma, weights)
        fall = trace[-1]["energy"] - record["energy"]
        if fall > 0.0:
            field = candidate
            trace.append({"iteration": len(trace)} | record)
        if fall <= DEFAULTS.settled * trace[-1]["energy"]:
            how = (
                "converged"
                if fall >= 0.0
                else "stopped, because the next reinitialisation would raise the energy,"
            )
            break
    status, facts = _describe_outcome(field, f"{how} after {len(trace) - 1} reinitialisations", points)
    return Result(field, prior, sigma, status, how == "converged", tuple(trace), facts=facts, islands=True)


def energies(
    field: SignedDistance,
    shape: Array,
    points: Array,
    sigma: float,
    weights: Weights,
) -> dict[str, float]:
    """Return the terms of the energy; shape (n,) is H(psi.T) on the band of the field."""
    band, phi = field.band, field.phi
    cell = band.spacing**band.dimension
    reach = DEFAULTS.delta_width * band.spacing
    slope = np.linalg.norm(gradient(band, phi), axis=1)
    terms = {
        "data": weights.data * float(((band.interpolation(points) @ phi) ** 2).sum()) / sigma**2,
        "area": weights.area * float((delta(phi, reach) * slope).sum()) * cell,
        "shape": weights.shape * float(((heaviside(phi, reach) - shape) ** 2).sum()) * cell,
    }
    return terms | {"energy": sum(terms.values())}


def _make_steps(
    field: SignedDistance,
    shape: Array,
    points: Array,
    sigma: float,
    weights: Weights,
    settings: PaperSettings,
) -> Array:
    """Make some steps of (16): area and shape explicit within their stability bounds, points implicit
    (R5).
    """
    band, phi = field.band, field.phi
    h = band.spacing
    reach = settings.delta_width * band.spacing
    dt = min(
        h * h * reach / (2.0 * band.dimension * max(weights.area, LEAST_WEIGHT)),
        h * reach / (2.0 * max(weights.shape, LEAST_WEIGHT)),
    )
    at_points = band.interpolation(points)
    pull = 2.0 * weights.data / (sigma**2 * h**band.dimension)
    implicit = sparse.identity(len(band)) + dt * pull * (at_points.T @ at_points)
    for _ in range(settings.steps):
        flow = weights.area * mean_curvature(band, phi) - 2.0 * weights.shape * (
            heaviside(phi, reach) - shape
        )
        phi, _ = cg(
            implicit,
            phi + dt * flow * delta(phi, reach),
            x0=phi,
            rtol=settings.solver_tolerance,
            maxiter=settings.solver_iterations,
        )
    return np.where(np.abs(field.phi) < settings.free * h, phi, field.phi)


def _on_band(psi: SignedDistance, band: Band) -> Array:
    """Return psi (n,) on the nodes of another band of the same lattice; far from its own band only the sign
    counts.
    """
    box = psi.band.dense(psi.phi)
    local = band.nodes + (band.low - psi.band.low)
    inside = ((local >= 0) & (local < psi.band.shape)).all(axis=1)
    values = np.full(len(band), psi.band.width)
    values[inside] = box[tuple(local[inside].T)]
    return values


def _describe_outcome(field: SignedDistance, how: str, points: Array) -> tuple[str, dict[str, int]]:
    """Describe how it went, in words and in numbers: islands and points without effect are what this
    formulation is known for.
    """
    count, _ = components_and_euler(*zero_set(field.band, field.phi))
    lost = int((np.asarray(abs(field.band.interpolation(points)).sum(axis=1)).ravel() == 0.0).sum())
    islands = f"{count} component{'s' * (count > 1)}"
    status = f"{how}: {islands}, {lost} points outside the band, where they have no effect"
    return status, {"components": count, "points_outside_band": lost}
