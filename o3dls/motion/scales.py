"""Amplitudes and noise levels of a motion: what is usual, what the evidence says, and how early rounds are
held back.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Array
from .field.marginal_likelihood import MarginalLikelihood, Scales
from .field.observations import Rows
from .problem import MotionProblem
from .settings import IterationSettings


def first_scales(problem: MotionProblem) -> Scales:
    """Return usual amplitudes and noise levels by the residuals of the start pose, with their priors."""
    settings = problem.settings.covariance
    log = expected_scales(problem, settings.noise_fraction)
    fields = len(settings.vector_lengths) + len(settings.normal_lengths)
    anchors = int(len(problem.marks) > 0)
    noises = problem.data.groups + anchors
    log_sd = np.repeat(
        [
            settings.field_log_sd,
            settings.field_log_sd * settings.mode_log_sd,
            settings.field_log_sd * settings.anchor_log_sd,
            settings.field_log_sd * settings.noise_log_sd,
        ],
        [fields, 2, anchors, noises],
    )
    least_noise = np.full(noises, np.log(settings.least_noise * problem.size))
    least = np.r_[np.full(len(log) - noises, -np.inf), least_noise]
    return Scales(log, log, log_sd, least, len(log) - noises)


def tune_scales(problem: MotionProblem, scales: Scales, rows: Rows) -> Scales:
    """Tune amplitudes and noise levels to maximise the evidence, with priors by the current noise."""
    errors = float(np.hypot(scales.noises[0], np.linalg.norm(scales.drift_sds)))
    usual = expected_scales(problem, errors / problem.residual_sd)
    s = problem.settings.covariance
    if problem.residual_sd < s.most_residuals * problem.size:
        # another heart's prior leaves large residuals, which are no sign of much noise
        points = slice(scales.fields, scales.fields + problem.data.groups)  # drift has a prior of its own
        usual[points] = np.minimum(usual[points], np.log(s.most_usual_noise * problem.size))
    drift = scales.prior_log[scales.fields : scales.amplitudes]
    scales = replace(scales, prior_log=np.insert(usual, scales.fields, drift))
    likelihood = MarginalLikelihood.of(problem.covariance, rows)
    return replace(scales, log=likelihood.maximise(scales, problem.settings.iteration))


def expected_scales(problem: MotionProblem, noise_fraction: float) -> Array:
    """Return the logarithms of the usual amplitudes and noise levels if noise makes up so much of the
    residuals of the start and motion the rest.
    """
    s = problem.settings.covariance
    rms = problem.residual_sd
    rest = 1.0 - min(noise_fraction, s.most_noise_fraction) ** 2
    motion = float(np.sqrt(rest / (1.0 - s.noise_fraction**2)))
    moved = motion * rms
    landmarks = len(problem.marks) > 0
    amplitudes = [s.vector_amplitude * moved / 2**k for k in range(len(s.vector_lengths))]
    amplitudes += [s.normal_amplitude * moved / 2**k for k in range(len(s.normal_lengths))]
    amplitudes += [s.bend_amplitude * moved / problem.size, s.strain_amplitude * motion]
    amplitudes += [s.anchor_amplitude * moved] * landmarks
    noises = [s.noise_fraction * rms] * problem.data.groups + [s.landmark_noise * problem.size] * landmarks
    return np.asarray(np.log(amplitudes + noises))


def annealed(iteration: int | None, scales: Scales, groups: int, settings: IterationSettings) -> Array:
    """Return the change of the logarithms in the first rounds: amplitudes grow to 1, noise shrinks to 1."""
    change = np.zeros(len(scales.log))
    if iteration is not None:
        grown = settings.first_amplitude + settings.amplitude_growth * iteration
        change[: scales.fields] = np.log(min(1.0, grown))
    change[scales.amplitudes : scales.amplitudes + groups] = np.log(noise_factor(iteration, settings))
    return change


def noise_factor(iteration: int | None, settings: IterationSettings) -> float:
    """Return the factor on the noise in the first rounds: points pull from afar, and none decides alone."""
    factors = settings.noise_factors
    return factors[-1] if iteration is None else factors[min(iteration, len(factors) - 1)]
