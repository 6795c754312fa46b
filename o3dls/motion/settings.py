"""Numbers of the motion.

Free of units: lengths in rms radii of the prior, amplitudes in rms residuals of the start, of which a part is
noise. `log_sd` are standard deviations of logarithms.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ..noise.settings import ContactSettings
from ..settings import number


@dataclass(frozen=True)
class CovarianceSettings:
    """Components of the field's prior covariance, with their usual amplitudes and how sure these are."""

    vector_lengths: tuple[float, ...] = number(
        (1.15, 0.46), "rms radii", "correlation lengths of the vector fields: 30 and 12 mm for an atrium"
    )
    normal_lengths: tuple[float, ...] = number(
        (0.46,), "rms radii", "correlation lengths of the fields along the normal: a wall that fills"
    )
    vector_amplitude: float = number(
        0.5, "rms residuals", "of the longest; each further length starts at half the one before"
    )
    normal_amplitude: float = number(0.25, "rms residuals", "likewise")
    bend_amplitude: float = number(0.3, "rms residuals", "what a rotation that changes moves over a radius")
    strain_amplitude: float = number(
        0.02, "1", "what large strains explain where the points are, they carry to where there are none"
    )
    anchor_amplitude: float = number(
        1.2, "rms residuals", "shift of what lies around a landmark, each its own"
    )
    anchor_length: float = number(
        0.46, "rms radii", "correlation length of such a shift: that of the shorter field, 12 mm"
    )
    translation_sd: float = number(0.2, "rms radii", "nearly free: the start may be off by several mm,")
    rotation_sd: float = number(0.1, "rad", "by several degrees,")
    scale_sd: float = number(0.1, "1", "and by several percent")
    noise_fraction: float = number(
        0.7, "1", "of the residuals of the start; the rest is motion, which is how amplitudes follow them"
    )
    most_usual_noise: float = number(
        0.045, "rms radii", "1.2 mm: what larger residuals of the start show is another heart's prior,"
    )
    most_residuals: float = number(
        0.3,
        "rms radii",
        "8 mm: larger ones show a wrong start; another heart's prior leaves up to 0.25",
    )
    most_noise_fraction: float = number(0.95, "1", "some motion there is")
    landmark_noise: float = number(0.08, "rms radii", "landmarks are picked to within 2 mm")
    least_noise: float = number(0.01, "rms radii", "no point is better than 0.3 mm")
    field_log_sd: float = number(1.0, "1", "of the fields' amplitudes: a factor of e either way")
    mode_log_sd: float = number(0.5, "1", "of bends and strains: one case tells little of few numbers")
    anchor_log_sd: float = number(0.3, "1", "of the anchors' amplitude, for the same reason")
    noise_log_sd: float = number(0.5, "1", "of the noise levels")
    normals_length: float = number(0.2, "rms radii", "normals do not follow bumps shorter than this")
    node_spacing: float = number(
        0.27, "shortest lengths", "of the nodes that the field is interpolated from: exact to a hundredth"
    )
    node_neighbours: int = number(8, "nodes", "that a vertex is interpolated from, by local kriging")


@dataclass(frozen=True)
class IterationSettings:
    """How the fit iterates: what stands still, what is annealed, and what many points share."""

    iterations: int = number(25, "", "most of one fit; most fits stand still after 16 to 20")
    tolerance: float = number(2e-4, "rms radii", "mean step along the normals that counts as standing still")
    tune_at: tuple[int, ...] = number((5, 9, 13), "", "iterations at which the evidence sets the amplitudes")
    tuning_steps: int = number(12, "", "of L-BFGS per tuning: the next one goes on from there")
    tuning_memory: int = number(8, "", "steps that L-BFGS remembers: amplitudes are fewer")
    tuning_tolerance: float = number(0.1, "nats", "per factor e of a number: less decides nothing")
    noise_factors: tuple[float, ...] = number(
        (3.0, 2.0, 1.5, 1.2, 1.0),
        "1",
        "on the noise in the first rounds: points pull from afar, none decides",
    )
    first_amplitude: float = number(0.3, "1", "on the amplitudes in the first round: stiff, then softer")
    amplitude_growth: float = number(0.14, "1", "a round: all of it after five")
    mixed_steps: int = number(2, "rounds", "before a round, with whose steps its own is mixed")
    longest_step: float = number(2.0, "1", "over the step of the round alone, when mixed")
    inside_step: float = number(0.5, "1", "of what `inside` points say later: they come and go")
    most_rows: int = number(600, "rows", "more points than this share rows by patches of the surface")
    patch: float = number(0.4, "shortest lengths", "smaller patches change little but the time")
    most_points: int = number(
        3000, "points", "of more of a kind, an even part finds amplitudes, noise and motion; all have a say"
    )
    rounds_with_all: int = number(8, "", "with all points, after a fit to a part of them")
    rounds_of_update: int = number(1, "", "one more point moves the surface by a fraction of the noise")
    update_tolerance: float = number(0.1, "noise levels", "the surface stands within the noise")
    foot_cutoff: float = number(3.0, "1", "exp(-3) of the closest wall's likelihood: less changes no result")
    foot_resolution: float = number(
        3.0, "1", "squared size over noise below which a face is seen as its centre"
    )
    repair_folds: bool = number(True, "", "repair faces that a steep field turned over")


@dataclass(frozen=True)
class SelectionSettings:
    """What the points must show to be followed: a motion beyond the pose, or a smoother prior."""

    motion_log_odds: float = number(0.0, "nats", "against a motion beyond the pose, before points are seen")
    certain: float = number(0.999, "1", "a motion this probable is a motion")
    decisive: float = number(5.0, "nats", "a fit likelier by so much is taken without further weighing")
    pose_corrections: int = number(
        3, "", "points that mean no surface would have the start corrected for ever"
    )
    pose_rounds: int = number(12, "", "most rounds of the pose alone")
    steady_points: float = number(0.5, "points", "total change of belief in a round that counts as steady")
    steady_energy: float = number(0.2, "nats", "less than any decision turns on")
    pose_decay: float = number(3.0, "1", "steady drops shrink by a quarter or more a round, and sum to this")
    smoothing_lengths: tuple[float, ...] = number(
        (0.35, 0.5, 0.6), "rms radii", "bumps shorter than one of these may be roughness of the prior;"
    )
    smoothing_evidence: float = number(3.0, "nats", "they go where the evidence prefers it by so much")
    trial_rounds: int = number(2, "", "of a smoother prior: the first still has the feet of the rougher one")
    doubtful_noise: float = number(
        0.1, "rms radii", "2.6 mm: more than contact leaves, so that the fit may be in a wrong basin"
    )


@dataclass(frozen=True)
class LeverageSettings:
    """When points may have pulled the wall out to them, and what stands against it."""

    captured_points: int = number(5, "points", "off the wall at the start and on it after: so many are usual")
    stretch: float = number(2.0, "1", "a wall so much longer is stretched,")
    stretched_area: float = number(
        0.03, "1", "and that on so much of its area: 0.015 is the most of good fits"
    )
    majority: float = number(0.5, "1", "of the points: so many are the map itself")
    strain_log_sd: float = number(0.15, "1", "of a wall's lengthening, in patches of the shortest length")
    exclusion_odds: float = number(1e6, "1", "on the odds of the points that are left out at first")


@dataclass(frozen=True)
class MapShiftSettings:
    """When one part of the map is shifted against the others, and no motion of the wall."""

    offset_sd: float = number(0.4, "rms radii", "of an offset along each axis: 10 mm for an atrium")
    least_part: float = number(0.1, "1", "of the points, in the order in which they were taken")
    least_side: float = number(0.2, "1", "of the points, on a side of a plane: less is a bump of the wall")
    most_cuts: int = number(
        128, "", "of a kind that are tried: a few points on the wrong side hide an offset"
    )
    first_evidence: float = number(
        4.0, "nats", "in closed form, before a motion is fitted without the offset"
    )
    first_in_order: float = number(-2.0, "nats", "likewise, of a part in time: most whole maps have less")
    first_offset: float = number(
        0.12, "rms radii", "of a part in time, from which a motion is fitted without it"
    )
    first_over_motion: float = number(
        1.4,
        "1",
        "likewise, of one side of a plane, over the rms motion of the whole map, which follows it partly",
    )
    rivals: int = number(
        2, "", "planes for which that is done: the best in closed form is not always the right one"
    )
    rounds: int = number(5, "", "most, of a fit without the offset and the offset again")
    settled: float = number(0.1, "noise levels", "change of the offset that ends them")
    hopeless: float = number(0.5, "1", "share of what an offset needs below which no further round helps it")
    landmark_odds: float = number(7.0, "nats", "against landmarks that move along, as against none that stay")
    evidence: float = number(10.0, "nats", "of a shifted part; in time, whole maps have 3 at most,")
    evidence_per_point: float = number(0.04, "nats", "and of many points more: what they show they share")
    least_points: int = number(150, "points", "that tell one side of a plane from another anatomy")
    least_offset: float = number(0.15, "rms radii", "of one side of a plane: bends move it by as much")
    over_motion: float = number(3.2, "1", "that offset over the rms motion: 2.9 in a map that is whole")
    large_offset: float = number(
        0.25,
        "rms radii",
        "from which it must be over the motion in proportion: a slip leaves motions as they are",
    )
    place: float = number(
        0.7, "rms radii", "of a ball with all that is mapped of a vein or an appendage: 18 mm for an atrium"
    )
    shared: float = number(
        0.25,
        "1",
        "of the evidence, that is left without any such place: 0.34 of shifts, 0.19 of a lacking vein",
    )


@dataclass(frozen=True)
class MotionSettings:
    """All numbers of the motion, and of who touches the wall."""

    covariance: CovarianceSettings = field(default_factory=CovarianceSettings)
    iteration: IterationSettings = field(default_factory=IterationSettings)
    selection: SelectionSettings = field(default_factory=SelectionSettings)
    leverage: LeverageSettings = field(default_factory=LeverageSettings)
    contact: ContactSettings = field(default_factory=ContactSettings)
    map_shift: MapShiftSettings = field(default_factory=MapShiftSettings)
    inflation: float = number(
        1.3, "1", "on the deviation, which takes feet, normals and amplitudes as known: by development seeds"
    )


@dataclass(frozen=True)
class TemplateSettings:
    """Numbers of a template of several phases."""

    variance: float = number(0.98, "1", "fraction of the phases' variance that the modes keep")
    pose_sd: float = number(1.0, "mm", "how far the start pose may be off: phases and prior share one frame")
    iterations: int = number(50, "", "most in finding the phase")
    aside: float = number(0.1, "sd", "how far aside the modes may go where too few phases tell it")
    trial_iterations: int = number(6, "", "from each phase, before the best is refined")
    least_aside: float = number(1e-3, "1", "deviation of a phase that lies just between its neighbours")
    few_phases: int = number(4, "phases", "fewer do not tell how far aside a phase lies")
    most_samples: int = number(400, "points", "of a phase that the prior is registered to")
    settled: float = number(3e-4, "rms radii", "longest step of a vertex that counts as standing still")
