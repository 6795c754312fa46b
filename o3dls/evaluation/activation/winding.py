"""Waves that come again and again: times are known but for whole cycles, so they are places on a circle."""

from __future__ import annotations

import numpy as np

from ...arrays import Array
from .features import SMOOTH_LENGTH
from .harmonics import Harmonics
from .velocity import USUAL

SD, NOISE = 0.7, 0.4  # of each coordinate of exp(i phase), and of what a point adds to it
MEAN = 0.5  # variance of a constant
WAVES = 0.4  # lengths of the wave over which it varies as one on the circle


def choose_length(cycle: float) -> float:
    """Return over how many mm a wave of a cycle length varies as a place on the circle."""
    return min(SMOOTH_LENGTH, WAVES * USUAL * cycle)


def find_wave(harmonics: Harmonics, at: Array, times: Array, cycle: float) -> tuple[Array, Array]:
    """Return exp(i phase) at points (k,), where the harmonics have values at (k, m), and at the vertices
    (n,): the mean of a process on the plane, so that early meets late without a step. Its usual size is 1.

    It is as smooth as may be and still goes round: what it followed of the noise and of uneven speed would be
    missing from the times beside it, of which the process learns how unsure they are.
    """
    spectrum = SD**2 * harmonics.spectrum(SMOOTH_LENGTH)
    joint = (at * spectrum) @ at.T + MEAN
    joint[np.diag_indices_from(joint)] += NOISE**2
    answer = np.linalg.solve(joint, np.exp(2j * np.pi * times / cycle))
    weights, constant = spectrum * (at.T @ answer), MEAN * answer.sum()
    points, vertices = at @ weights + constant, harmonics.values @ weights + constant
    usual = float(np.median(np.abs(points)))
    return points / usual, vertices / usual


def wrap(times: Array, cycle: float | None) -> Array:
    """Return times in (-cycle / 2, cycle / 2], as they are where there is no cycle."""
    return times if cycle is None else times - cycle * np.rint(times / cycle)


def phase_times(wave: Array, cycle: float) -> Array:
    """Return the times of a wave (k,) by its phase, in ms."""
    return np.asarray(np.angle(wave) * cycle / (2.0 * np.pi))


def phase_slopes(harmonics: Harmonics, wave: Array, cycle: float) -> Array:
    """Return the slope (2, n) of the times of a wave (n,) over the wall, in ms per mm."""
    size = np.maximum(np.abs(wave), 1e-3)
    turning = (np.conj(wave) * harmonics.slopes(wave)).imag / size**2
    return np.asarray(turning * cycle / (2.0 * np.pi))
