"""Refine the deformed prior by what the points still say: corrections along its normals, coarse to fine,
where evidence asks for them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ..arrays import Array
from ..geometry.similarity import apply
from ..parallel import one_blas_thread, side_by_side
from .descent import Level, descend
from .normal_displacement import Wall
from .observation import Measured
from .residual_field import ResidualField, residual_field
from .settings import CorrectionSettings, LevelSetSettings


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


@one_blas_thread()
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
        seen = measured.with_noise(noise)
        with side_by_side() as threads:
            best_field = partial(_best_field, wall, seen, measured, settings=limits.settings)
            found = list(threads.map(best_field, lengths))
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
        f, steps, settled = descend(
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


def _sentence(
    fields: list[ResidualField], trace: list[Mapping[str, float]], converged: bool, unit: str
) -> str:
    if not fields:
        return "no correction needed: the residuals are consistent with noise"
    corrections = ", ".join(
        f"{field.amplitude:.2g} {unit} with correlation length {field.length:.3g} {unit} "
        f"(evidence {field.gain:+.1f} nats)"
        for field in fields
    )
    how = "converged" if converged else "stopped at the iteration limit"
    iterations = sum(row["iteration"] > 0 for row in trace)
    return f"{how} after {iterations} iteration{'s' * (iterations != 1)}; corrections: {corrections}"
