"""Refine the deformed prior by what the points still say: corrections along its normals, coarse to fine,
where evidence asks for them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from ..arrays import Array, Ints
from ..errors import SolverError
from ..geometry.similarity import apply
from ..geometry.surface import Surface
from .distance import signed_distance
from .matern_prior import MaternPrior
from .normal_displacement import Wall
from .observation import Measured
from .residual_field import ResidualField, residual_field
from .settings import CorrectionSettings, LevelSetSettings

Terms = Callable[[Array], tuple[float, float]]  # field -> energies of data and prior


@dataclass(frozen=True)
class Limits:
    """spacing: of the lattice that the result will have; coarse_to_fine: whether fields of all correlation
    lengths are tried, or the shortest alone; unit: of lengths in sentences.
    """

    spacing: float
    coarse_to_fine: bool = True
    unit: str = "mm"
    settings: LevelSetSettings = field(default_factory=LevelSetSettings)


@dataclass(frozen=True, eq=False)
class Correction:
    """Outward correction u (v,) of a surface's vertices, the fields it is made of, and how the descent
    went.
    """

    u: Array
    fields: tuple[ResidualField, ...]
    noise: float  # factor on the noise given
    trace: tuple[Mapping[str, float], ...]
    converged: bool
    status: str


def fit_correction(wall: Wall, measured: Measured, relative_sd: Array, limits: Limits) -> Correction:
    """Minimise the energy over the correction u of a wall: coarse to fine, the strongest Matern field of
    those left.

    relative_sd (v,): standard deviation that the motion leaves at every vertex, over its root mean square:
    the prior holds where it is small.
    """
    surface = wall.surface
    settings = limits.settings.correction
    u = np.zeros(len(wall.rest))
    noise = 1.0
    fields: list[ResidualField] = []
    trace: list[Mapping[str, float]] = []
    converged = True
    lengths = _lengths(wall, measured, limits.spacing, settings)
    lengths = lengths if limits.coarse_to_fine else lengths[-1:]
    while lengths:
        found = [
            _best_field(wall, measured.with_noise(noise), measured, length, limits.settings)
            for length in lengths
        ]
        best = max(one.gain for one in found)
        if best < settings.evidence:
            break
        strongest = next(one for one in found if one.gain >= max(best - settings.as_good, settings.evidence))
        level = Level.of(surface, relative_sd, strongest.length, settings)
        u, strongest, steps, settled = _fit(wall, level, measured, u, strongest, noise, limits.settings)
        noise = strongest.noise
        converged = converged and settled
        fields.append(strongest)
        trace += steps
        lengths = [length for length in lengths if length < strongest.length]
    if not fields:
        data = float(measured.likelihood.loss(measured.distance - measured.bias).sum())
        trace.append({"iteration": 0, "data": data, "prior": 0.0, "energy": data})
    return Correction(
        u, tuple(fields), noise, tuple(trace), converged, _sentence(fields, trace, converged, limits.unit)
    )


def _lengths(wall: Wall, measured: Measured, spacing: float, settings: CorrectionSettings) -> list[float]:
    """Correlation lengths from coarse to fine; shorter ones than the points' distance cannot be told from
    noise.
    """
    surface = wall.surface
    between = (surface.area / len(measured.points)) ** (1.0 / (surface.dimension - 1))
    lengths = settings.longest * wall.radius * 0.5 ** np.arange(settings.lengths)
    return [float(length) for length in lengths if length >= max(between, settings.shortest * spacing)]


def _best_field(
    wall: Wall,
    believed: Measured,
    given: Measured,
    length: float,
    settings: LevelSetSettings,
    made: Array | None = None,
) -> ResidualField:
    """The field of a length in what the wall leaves unexplained, plus what `made` (v,) of the wall's position
    this field has made.

    believed: the points with the noise as it is now, which says who is an outlier; given: with the noise as
    it was given.
    """
    distance, corners, weights = wall.look(believed.points)
    rest = distance - believed.bias
    pull = believed.likelihood.pull(rest)
    weight = pull * believed.likelihood.weight(rest)
    if made is not None:
        rest = rest + np.einsum("nc,nc->n", weights, made[corners])
    feet = np.einsum("nc,ncd->nd", weights, wall.rest[corners])
    sigma, log_sd = given.likelihood.sigma, given.sigma_log_sd
    in_frame = apply(wall.frame, feet)
    return residual_field(in_frame, pull * rest, weight, sigma, log_sd, length, settings.residual_field)


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


def _fit(
    wall: Wall,
    level: Level,
    measured: Measured,
    base: Array,
    field: ResidualField,
    noise: float,
    settings: LevelSetSettings,
) -> tuple[Array, ResidualField, list[Mapping[str, float]], bool]:
    """Descend, then ask the evidence again from where the wall has come to, until amplitude and noise stay.

    The noise falls slowly from the level before: points that the wall has yet to reach must not be taken for
    outliers.
    """
    chosen = settings.correction
    f = np.zeros(level.to_vertices.shape[1])
    trace: list[Mapping[str, float]] = []
    for _ in range(chosen.rounds):
        now = max(field.noise, chosen.cooling * noise)
        f, steps, settled = _descend(
            wall, level.of_amplitude(field.amplitude), measured.with_noise(now), base, f, chosen
        )
        trace += steps
        again = _best_field(
            wall, measured.with_noise(now), measured, field.length, settings, level.to_vertices @ f
        )
        steady = (
            abs(np.log(again.amplitude / field.amplitude)) + abs(np.log(again.noise / now)) < chosen.steady
        )
        field = replace(again, gain=max(again.gain, field.gain), noise=max(again.noise, chosen.cooling * now))
        noise = now
        if steady:
            break
    return base + level.to_vertices @ f, replace(field, noise=noise), trace, settled


def _descend(
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


def _sentence(
    fields: list[ResidualField], trace: list[Mapping[str, float]], converged: bool, unit: str
) -> str:
    if not fields:
        return "nothing to add: the residuals of the points hold no field that the noise would not explain"
    said = ", ".join(
        f"{field.amplitude:.2g} over {field.length:.3g} {unit} (evidence {field.gain:+.1f} nats)"
        for field in fields
    )
    how = "converged" if converged else "stopped at the iteration limit"
    iterations = sum(row["iteration"] > 0 for row in trace)
    return f"{how} after {iterations} iteration{'s' * (iterations != 1)}; fields: {said}"
