"""Numbers of the motion that a person could want to change."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Free of units: lengths in rms radii of the prior, amplitudes in rms residuals of the start, of which
    NOISE is noise; the spreads are of their logarithms.
    """

    vector: tuple[float, ...] = (1.15, 0.46)
    normal: tuple[float, ...] = (0.46,)
    anchor_length: float = 0.38
    vector_amplitude: float = 0.5  # of the longest; each further length starts at half the one before
    normal_amplitude: float = 0.25
    anchor_amplitude: float = 1.2
    landmark_noise: float = 0.08  # rms radii
    bend_amplitude: float = (
        0.3  # of a rotation that changes over the chamber: what it moves over one rms radius;
    )
    tilt_amplitude: float = (
        0.6  # of one that changes from bottom to top, where that is known: others are then half as large
    )
    broad: float = 0.2  # rms radii: the field's normals do not follow bumps shorter than this
    # rms radii: bumps shorter than one of these may be roughness of the prior; they
    fairing: tuple[float, ...] = (
        0.35,
        0.5,
        0.6,
    )
    fairing_nats: float = 3.0  # go where the evidence prefers it by so much
    unfold: bool = True  # mend faces that a steep field turned over
    strain: float = (
        0.02  # what large strains explain where the points are, they carry to where there are none
    )
    depth: float = (
        0.3  # rms radii: one over the density of points off the wall inside, which is the same however deep
    )
    spread: float = 1.0  # of the fields' amplitudes; times what follows
    whole_spread: float = 0.5  # for bends, tilts and strains: few parameters, of which one case tells little,
    anchor_spread: float = 0.3  # for the anchors, which are few,
    noise_spread: float = 0.5  # and for noise levels
    odds: float = 0.0  # nats against a motion beyond the pose, before the points are seen
    finest: float = 0.01  # rms radii: no point is believed better than this
    rows: int = 600  # more points than this share rows by patches of the surface
    # of more points of a kind than this, an even part finds amplitudes, noise and motion; all have the last
    # word
    many: int = 3000
    iterations: int = 25
    tune_at: tuple[int, ...] = (5, 9, 13)
    tolerance: float = 2e-4  # rms radii: mean step of the surface that counts as standing still
