"""What the process of activation times is made of: at any place, the features whose products are its
covariance.

The time is t = m + smooth + a rough, with a constant m, a smooth part over all of the wall and a rough one
whose size a varies from place to place: it is large where the wave is slow, turns or meets a line of block.
log a is itself smooth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array
from .harmonics import Harmonics

SMOOTH_LENGTH, ROUGH_LENGTH = 45.0, 10.0  # mm
LOCAL_LENGTH, LOCAL_COUNT = 20.0, 80  # mm over which the size of the rough part varies
LOCAL_SD = 1.0  # of its logarithm
FAINT = 0.3  # of the usual size: nearer to nought a phase is not told


@dataclass(frozen=True, eq=False)
class Features:
    """Features at places have those of the smooth part (k, a), the rough part (k, m) and its size (k, b)."""

    smooth: Array
    rough: Array
    local: Array


def make_features(
    harmonics: Harmonics, values: Array, length: float = SMOOTH_LENGTH, wave: Array | None = None
) -> Features:
    """Make features of places where the harmonics have values (k, m). length: of the smooth part in mm. wave
    (k,): of a wave that comes again and again, exp(i phase) there, of which the usual size is 1.

    With a circular wave z = exp(i phase) that is a smooth process on the plane, a small change of it turns
    its phase by Im(conj(z) dz) / |z|^2.
    """
    smooth = values * np.sqrt(harmonics.spectrum(length))
    if wave is not None:
        size = np.abs(wave)
        turned = wave / np.maximum(size, 1e-12) / np.maximum(size, FAINT)
        smooth = np.hstack([turned.real[:, None] * smooth, turned.imag[:, None] * smooth])
    rough = values * np.sqrt(harmonics.spectrum(ROUGH_LENGTH))
    weights = LOCAL_SD * np.sqrt(harmonics.spectrum(LOCAL_LENGTH))[1:LOCAL_COUNT]  # its mean is learnt apart
    return Features(smooth, rough, values[:, 1:LOCAL_COUNT] * weights)
