"""What times of a map are compared with: a plain Gaussian process, the mean of near points, and the slope of
the true times at the resolution of a map.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from data_synth.waves import MappedWave, Wave
from o3dls.arrays import Array
from o3dls.evaluation.activation.harmonics import Harmonics
from o3dls.evaluation.activation.winding import phase_slopes
from o3dls.evaluation.interpolation import to_surface
from o3dls.evaluation.measures.numbers import slopes
from o3dls.geometry.surface import Surface

FINE = 3.0  # mm, sd of the Gaussian


def _coordinates(mapped: MappedWave, cycle: float | None) -> Array:
    """Return what is fitted at the points (k, c): the time, or exp(i phase)."""
    if cycle is None:
        return mapped.time[:, None]
    phase = 2.0 * np.pi * mapped.time / cycle
    return np.column_stack([np.cos(phase), np.sin(phase)])


def fit_plain(surface: Surface, mapped: MappedWave, cycle: float | None) -> tuple[Array, Array]:
    """Return the mean and sd (n,) of a plain Gaussian process in ms."""
    values = _coordinates(mapped, cycle)
    middle, scale = values.mean(axis=0), float(values.std())
    values = (values - middle) / scale
    distance = cdist(mapped.xyz, mapped.xyz)

    def covariance(apart: Array, log: Array) -> Array:
        scaled = np.sqrt(3.0) * apart / np.exp(log[1])
        return np.exp(2.0 * log[0]) * (1.0 + scaled) * np.exp(-scaled)

    def surprise(log: Array) -> float:
        joint = covariance(distance, log)
        joint[np.diag_indices_from(joint)] += np.exp(2.0 * log[2]) + 1e-8
        factor = np.linalg.cholesky(joint)
        white = np.linalg.solve(factor, values)
        return float(0.5 * (white**2).sum() + values.shape[1] * np.log(np.diag(factor)).sum())

    bounds = [(-3.0, 3.0), (0.0, 5.0), (-4.0, 1.0)]
    log = minimize(surprise, np.log([1.0, 30.0, 0.3]), method="L-BFGS-B", bounds=bounds).x
    joint = covariance(distance, log)
    joint[np.diag_indices_from(joint)] += np.exp(2.0 * log[2]) + 1e-8
    cross = covariance(cdist(surface.vertices, mapped.xyz), log)
    answer = np.linalg.solve(joint, np.hstack([values, cross.T]))
    mean = middle + scale * cross @ answer[:, : values.shape[1]]
    left = np.exp(2.0 * log[0]) - (cross.T * answer[:, values.shape[1] :]).sum(axis=0)
    sd = scale * np.sqrt(np.maximum(left, 0.0))
    if cycle is None:
        return mean[:, 0], sd
    turn = cycle / (2.0 * np.pi)
    return np.arctan2(mean[:, 1], mean[:, 0]) * turn, sd / np.linalg.norm(mean, axis=1) * turn


def average(surface: Surface, mapped: MappedWave, cycle: float | None) -> tuple[Array, Array]:
    """Return the mean of near times (n,) and the speed (n,) by its slope."""
    values = np.column_stack([
        to_surface(mapped.xyz, one, surface) for one in _coordinates(mapped, cycle).T
    ])  # fmt: skip
    steep = np.stack([slopes(surface, one) for one in values.T])
    if cycle is None:
        return values[:, 0], 1.0 / np.maximum(np.linalg.norm(steep[0], axis=1), 1e-9)
    turn, size = cycle / (2.0 * np.pi), (values**2).sum(axis=1)
    steep = turn * (values[:, :1] * steep[1] - values[:, 1:] * steep[0]) / size[:, None]
    speed = 1.0 / np.maximum(np.linalg.norm(np.nan_to_num(steep), axis=1), 1e-9)
    return np.arctan2(values[:, 1], values[:, 0]) * turn, speed


def blur_speed(harmonics: Harmonics, true: Wave) -> Array:
    """Return one over the length (n,) in m/s of the slope of the true times, averaged by a Gaussian of FINE:
    what a map without noise would tell that sees no finer.
    """
    time = true.time
    steep = harmonics.slopes(time) if true.cycle is None else _turn(harmonics, time, true.cycle)
    slope = np.einsum("an,nad->nd", steep, harmonics.frames)
    known = np.isfinite(slope).all(axis=1)
    tree = cKDTree(harmonics.surface.vertices)
    near = sparse.csr_array(tree.sparse_distance_matrix(tree, 3.0 * FINE, output_type="coo_matrix"))
    near.data = np.exp(-0.5 * (near.data / FINE) ** 2)
    weights = (near + sparse.eye_array(len(time))) @ sparse.diags_array(
        harmonics.surface.vertex_areas * known
    )
    mean = (weights @ np.where(known[:, None], slope, 0.0)) / np.maximum(weights.sum(axis=1), 1e-9)[:, None]
    return np.asarray(1.0 / np.maximum(np.linalg.norm(mean, axis=1), 1e-9))


def _turn(harmonics: Harmonics, time: Array, cycle: float) -> Array:
    return phase_slopes(harmonics, np.exp(2j * np.pi * time / cycle), cycle)
