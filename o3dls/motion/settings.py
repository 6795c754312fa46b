"""Numbers of the motion.

Free of units: lengths in rms radii of the prior, amplitudes in rms residuals of the start, of which a part is
noise. `log_sd` are standard deviations of logarithms.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ..noise.settings import ContactSettings
from ..settings import number
from .drift_settings import DriftSettings
from .map_shift_settings import MapShiftSettings


@dataclass(frozen=True)
class CovarianceSettings:
    """These settings give the components of the field's prior covariance, with their usual amplitudes and how
    sure these are.
    """

    vector_lengths: tuple[float, ...] = number(
        (1.15, 0.46), "rms radii", "correlation lengths of the vector fields: 30 and 12 mm for an atrium"
    )
    normal_lengths: tuple[float, ...] = number(
        (0.46,), "rms radii", "correlation lengths of the fields along the normal, for a wall that fills"
    )
    vector_amplitude: float = number(
        0.5,
        "rms residuals",
        "expected amplitude of the longest vector field; each shorter one has half of the one before",
    )
    normal_amplitude: float = number(
        0.25,
        "rms residuals",
        "expected amplitude of the longest normal field; each shorter one has half of the one before",
    )
    bend_amplitude: float = number(
        0.3, "rms residuals", "expected displacement by a changing rotation over one rms radius"
    )
    strain_amplitude: float = number(
        0.02, "1", "expected large strain: small, since a strain extrapolates to where no points are"
    )
    anchor_amplitude: float = number(
        1.2, "rms residuals", "expected shift of a landmark's surroundings, independent for each landmark"
    )
    translation_sd: float = number(
        0.2, "rms radii", "prior sd of the translation: nearly free, since the start may be off by several mm"
    )
    rotation_sd: float = number(
        0.1, "rad", "prior sd of the rotation: nearly free, since the start may be off by several degrees"
    )
    scale_sd: float = number(
        0.1, "1", "prior sd of the scale: nearly free, since the start may be off by several percent"
    )
    noise_fraction: float = number(
        0.7, "1", "expected share of noise in the residuals of the start: the rest sets the amplitudes"
    )
    most_usual_noise: float = number(
        0.045, "rms radii", "largest expected noise, 1.2 mm: larger residuals show the prior of another heart"
    )
    most_residuals: float = number(
        0.3,
        "rms radii",
        "residuals, 8 mm, above which the start is wrong: another heart leaves up to 0.25",
    )
    most_noise_fraction: float = number(0.95, "1", "largest share of noise in the residuals of the start")
    landmark_noise: float = number(
        0.08, "rms radii", "expected noise of landmarks, which are picked to within 2 mm"
    )
    least_noise: float = number(0.01, "rms radii", "smallest noise level: no point is better than 0.3 mm")
    field_log_sd: float = number(1.0, "1", "log_sd of the fields' amplitudes: a factor of e either way")
    mode_log_sd: float = number(
        0.5, "1", "factor on `field_log_sd` for bends and strains: one case says little about so few numbers"
    )
    anchor_log_sd: float = number(
        0.3, "1", "factor on `field_log_sd` for landmarks' shifts: one case says little about so few numbers"
    )
    noise_log_sd: float = number(0.5, "1", "factor on `field_log_sd` for the noise levels")
    normals_length: float = number(
        0.2, "rms radii", "length over which the prior is smoothed to take normals: they ignore shorter bumps"
    )
    node_spacing: float = number(
        0.27,
        "shortest lengths",
        "distance between nodes from which the field is interpolated: exact to a hundredth",
    )
    node_neighbours: int = number(8, "nodes", "nodes from which a vertex is interpolated, by local kriging")


@dataclass(frozen=True)
class IterationSettings:
    """These settings say how the fit iterates: what stands still, what is annealed, and what many points
    share.
    """

    iterations: int = number(25, "", "most iterations of one fit: most fits stand still after 16 to 20")
    tolerance: float = number(
        2e-4, "rms radii", "mean step along the normals below which the surface stands still"
    )
    tune_at: tuple[int, ...] = number(
        (5, 9, 13), "", "iterations at which the evidence sets amplitudes and noise"
    )
    tuning_steps: int = number(
        12, "", "most steps of L-BFGS per tuning: the next tuning continues from there"
    )
    tuning_memory: int = number(8, "", "steps that L-BFGS remembers: there are fewer amplitudes")
    tuning_tolerance: float = number(
        0.1, "nats", "evidence per factor e of an amplitude below which tuning ends: less decides nothing"
    )
    noise_factors: tuple[float, ...] = number(
        (3.0, 2.0, 1.5, 1.2, 1.0),
        "1",
        "factors on the noise in the first rounds: points pull from afar, and none decides",
    )
    first_amplitude: float = number(
        0.3, "1", "factor on the amplitudes in the first round: the field is stiff first, then softer"
    )
    amplitude_growth: float = number(
        0.14, "1", "growth per round of the factor on the amplitudes: it is 1 after five rounds"
    )
    mixed_steps: int = number(
        2, "rounds", "earlier rounds whose steps are mixed with that of the present round"
    )
    longest_step: float = number(2.0, "1", "longest mixed step, over the present round's own step")
    inside_step: float = number(
        0.5,
        "1",
        "share of its new weight that an `inside` point takes per round: such points come and go",
    )
    most_rows: int = number(
        600, "rows", "rows of the linear system: more points than this share rows by patches of the surface"
    )
    patch: float = number(
        0.4,
        "shortest lengths",
        "width of the patches that share a row: smaller ones change little but the time",
    )
    most_points: int = number(
        3000, "points", "most points of a kind in the first fit: of more, a subset is fitted first, then all"
    )
    rounds_with_all: int = number(8, "", "rounds with all points after a fit to a subset of them")
    update_tolerance: float = number(
        0.1, "noise levels", "step below which an update has converged: the surface stands within the noise"
    )
    foot_cutoff: float = number(
        3.0, "1", "wall that is less likely than exp(-3) of the closest is no foot: it changes no result"
    )
    foot_resolution: float = number(
        3.0, "1", "squared size over squared noise below which a face is seen as its centre"
    )
    repair_folds: bool = number(True, "", "whether faces that a steep field turned over are repaired")


@dataclass(frozen=True)
class SelectionSettings:
    """These settings say what the points must show before a motion beyond the pose, or a smoother prior, is
    followed.
    """

    motion_log_odds: float = number(
        0.0, "nats", "prior log odds against a motion beyond the pose, before points are seen"
    )
    certain: float = number(0.999, "1", "probability above which a motion counts as certain")
    decisive: float = number(5.0, "nats", "lead by which a fit is taken without further weighing")
    pose_corrections: int = number(
        3, "", "most restarts from a corrected pose: points of no surface would cause endless ones"
    )
    pose_rounds: int = number(12, "", "most rounds of the fit of the pose alone")
    steady_points: float = number(
        0.5, "points", "total change of contact probabilities in a round below which they are steady"
    )
    steady_energy: float = number(
        0.2, "nats", "change of the free energy below which it is steady: no decision depends on so little"
    )
    pose_decay: float = number(
        3.0, "1", "bound on all further falls of the energy over the last: each is a quarter smaller at least"
    )
    smoothing_lengths: tuple[float, ...] = number(
        (0.35, 0.5, 0.6),
        "rms radii",
        "lengths below which bumps may be roughness of the prior that the wall lacks",
    )
    smoothing_evidence: float = number(
        3.0, "nats", "evidence that a smoother prior must gain to be preferred"
    )
    trial_rounds: int = number(
        2, "", "rounds of a trial of a smoother prior: the first still has the rougher prior's feet"
    )
    doubtful_noise: float = number(
        0.1, "rms radii", "noise above which a fit may be in a wrong basin: 2.6 mm, more than contact leaves"
    )


@dataclass(frozen=True)
class LeverageSettings:
    """These settings say when points may have pulled the wall out to them, and what stands against it."""

    captured_points: int = number(
        5, "points", "usual number of points that are off the wall at the start and on it after the motion"
    )
    stretch: float = number(2.0, "1", "ratio of lengths above which a face of the wall counts as stretched")
    stretched_area: float = number(
        0.03, "1", "share of stretched wall that causes a second fit: good fits have at most 0.015"
    )
    majority: float = number(0.5, "1", "share of suspect points above which they are the map itself")
    strain_log_sd: float = number(
        0.15, "1", "log_sd of a wall's lengthening, in patches of the shortest correlation length"
    )
    exclusion_odds: float = number(
        1e6, "1", "factor on the odds of being an outlier, for points that a second fit leaves out at first"
    )


@dataclass(frozen=True)
class MotionSettings:
    """These are all numbers of the motion, and of who touches the wall."""

    covariance: CovarianceSettings = field(default_factory=CovarianceSettings)
    iteration: IterationSettings = field(default_factory=IterationSettings)
    selection: SelectionSettings = field(default_factory=SelectionSettings)
    leverage: LeverageSettings = field(default_factory=LeverageSettings)
    contact: ContactSettings = field(default_factory=ContactSettings)
    map_shift: MapShiftSettings = field(default_factory=MapShiftSettings)
    drift: DriftSettings = field(default_factory=DriftSettings)
    inflation: float = number(
        1.3,
        "1",
        "factor on the sd, which takes feet, normals and amplitudes as known: by development seeds",
    )


@dataclass(frozen=True)
class TemplateSettings:
    """These are the numbers of a template of several phases."""

    variance: float = number(0.98, "1", "fraction of the phases' variance that the modes keep")
    pose_sd: float = number(1.0, "mm", "how far the start pose may be off: phases and prior share one frame")
    iterations: int = number(50, "", "most iterations of the search for the phase")
    aside: float = number(
        0.1, "sd", "how far modes may leave the path through the phases, where too few phases show it"
    )
    trial_iterations: int = number(6, "", "iterations from each phase, before the best one is refined")
    least_aside: float = number(
        1e-3, "1", "least deviation across the path through the phases, for a phase exactly between others"
    )
    few_phases: int = number(
        4, "phases", "fewer phases than this do not show how far one lies off the path through them"
    )
    most_samples: int = number(400, "points", "most points of a phase to which the prior is registered")
    settled: float = number(
        3e-4, "rms radii", "longest step of a vertex below which the template stands still"
    )
