"""Descent of one field of corrections: Gauss-Newton with reweighting, on its own band."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from ..arrays import Array, Ints
from ..errors import SolverError
from ..geometry.surface import Surface
from .grid.distance import signed_distance
from .matern_prior import MaternPrior
from .normal_displacement import Wall
from .observation import Measured
from .settings import CorrectionSettings

Terms = Callable[[Array], tuple[float, float]]  # field -> energies of data and prior


@dataclass(frozen=True, eq=False)
class Level:
    """One field on its band: `to_vertices` (v, n) carries nodes to vertices, times their relative sd."""

    prior: MaternPrior
    to_vertices: sparse.csr_matrix

    @classmethod
    def of(cls, surface: Surface, relative_sd: Array, length: float, settings: CorrectionSettings) -> Level:
        step = length / settings.nodes_per_length
        band = signed_distance(surface.vertices, surface.faces, step, settings.half_band * step).band
        to_vertices = sparse.diags(relative_sd) @ band.interpolation(surface.vertices)
        return cls(MaternPrior.on(band, length, 1.0), sparse.csr_matrix(to_vertices))

    def of_amplitude(self, amplitude: float) -> Level:
        return replace(self, prior=replace(self.prior, amplitude=amplitude))


def descend(
    wall: Wall, level: Level, measured: Measured, base: Array, f: Array, settings: CorrectionSettings
) -> tuple[Array, list[Mapping[str, float]], bool]:
    """Gauss-Newton with reweighting over the nodes of one field, on top of base (v,); the energy with exact
    distances never rises.
    """

    def terms(f: Array) -> tuple[float, float]:
        wall.move(base + level.to_vertices @ f)
        return float(
            measured.likelihood.loss(wall.look(measured.points)[0] - measured.bias).sum()
        ), level.prior.energy(f)

    found = terms(f)
    length = level.prior.length
    energy = sum(found)
    trace: list[Mapping[str, float]] = [_record(length, 0, *found)]
    for iteration in range(1, settings.iterations + 1):
        f, found = _backtrack(
            terms, f, _newton(wall, level, measured, f, settings), energy, settings.halvings
        )
        trace.append(_record(length, iteration, *found))
        fall = energy - sum(found)
        energy = sum(found)
        if not np.isfinite(energy):
            raise SolverError(
                f"level set: the energy is {energy} after iteration {iteration} at length {length:.3g}"
            )
        if fall <= settings.settled:
            return f, trace, True
    return f, trace, False


def _record(length: float, iteration: int, data: float, prior: float) -> Mapping[str, float]:
    return {"length": length, "iteration": iteration, "data": data, "prior": prior, "energy": data + prior}


def _newton(wall: Wall, level: Level, measured: Measured, f: Array, settings: CorrectionSettings) -> Array:
    """Gauss-Newton step (n,): to the minimum of the energy with feet and weights held, by conjugate
    gradients.
    """
    noise, prior = measured.likelihood, level.prior
    distance, corners, weights = wall.look(measured.points)
    rest = distance - measured.bias
    # moving the wall out by 1 shortens a distance by 1
    at_feet = _rows(corners, weights, level.to_vertices.shape[0]) @ level.to_vertices
    slope = prior.slope(f) - at_feet.T @ noise.slope(rest)
    believed = noise.weight(rest) * noise.pull(rest) / noise.sigma**2

    def hessian(step: Array) -> Array:
        return np.asarray(prior.slope(step) + at_feet.T @ (believed * (at_feet @ step)))

    diagonal = (
        _squares(prior.operator).T @ np.full(len(f), prior.amplitude**-2.0) + _squares(at_feet).T @ believed
    )
    matrix = LinearOperator((len(f), len(f)), matvec=hessian, dtype=np.float64)
    step, _ = cg(
        matrix,
        -slope,
        rtol=settings.solver_tolerance,
        maxiter=settings.solver_iterations,
        M=sparse.diags(1.0 / diagonal),
    )
    return np.asarray(step)


def _squares(matrix: sparse.csr_matrix) -> sparse.csr_matrix:
    return sparse.csr_matrix(matrix.multiply(matrix))


def _rows(corners: Ints, weights: Array, count: int) -> sparse.csr_matrix:
    """Reading of values per vertex at feet, a (k, count) matrix."""
    rows = np.repeat(np.arange(len(corners)), corners.shape[1])
    return sparse.csr_matrix((weights.ravel(), (rows, corners.ravel())), shape=(len(corners), count))


def _backtrack(
    terms: Terms, f: Array, direction: Array, energy: float, halvings: int
) -> tuple[Array, tuple[float, float]]:
    """Half the step until the energy does not rise; after so many halvings stay."""
    for halving in range(halvings):
        trial = f + 0.5**halving * direction
        found = terms(trial)
        if sum(found) <= energy:
            return trial, found
    return f, terms(f)
