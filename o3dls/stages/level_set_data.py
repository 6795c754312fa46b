"""What the stage `level_set` is given: the points as a motion left them, how they look from a wall, the
noise; and what its surface is given back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..case import FITTED_TYPES, Case
from ..estimate import Estimate
from ..geometry.similarity import rms_radius
from ..geometry.surface import Surface

if TYPE_CHECKING:
    from ..levelset.normal_displacement import Wall
    from ..levelset.observation import Measured, Noise
    from ..levelset.reconstruction.reconstruct import Believed
    from ..motion.result import MotionFit

SIGMA_LOG_SD = 0.1  # of the logarithm of a noise level that the motion found


def believed(fit: MotionFit, *, template: bool) -> Believed:
    """The points that may touch the wall as the motion left them, and those that are known to be inside.

    template: whether the prior is one (`prior_of`).
    """
    from ..levelset.reconstruction.reconstruct import Believed, Inside

    data, state = fit.problem.data, fit.state
    wall = ~data.inside
    noise = state.scales.noises[data.group] * data.relative
    inside = Inside(data.points[~wall], noise[~wall])
    touching = data.points[wall], state.weights[wall], noise[wall], data.outlier_odds[wall]
    return Believed(*touching, state.contact, inside, template)


def of_mapping(fit: MotionFit | None, weights: Array) -> Array:
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


def with_existence(surface: Surface, case: Case, start: Estimate, weights: Array | None) -> Surface:
    """The surface with the field `existence`: how likely there is wall, by the points of a fitted motion.

    weights: probabilities (n,) of contact, where they are not those of the motion.
    """
    from ..levelset.reconstruction.deviation import existence
    from ..levelset.settings import LevelSetSettings

    if start.fit is None or case.dimension == 2:
        return surface
    points = believed(start.fit, template=case.prior_of == "template")
    if weights is not None:
        points = replace(points, weights=weights)
    between = float(np.sqrt(surface.area / len(points.points)))
    likely = existence(surface.vertices, points, between, LevelSetSettings().reconstruction)
    return replace(surface, fields={**surface.fields, "existence": likely})
