"""The rules of the method that can do without: how each is switched off, by numbers of the settings classes.

A rule is a part of the method that another set of numbers leaves out, with the rest as it is. Numbers that
only say how finely something is computed are none.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from typing import Any

Numbers = Mapping[str, Any]
ALL = "all rules"
NEVER = 10**9  # of points, nats or lengths that no case has

# name: what is switched off, and "class.number" with the value that does it
RULES: dict[str, Numbers] = {
    # contact (o3dls/noise)
    "copies are one place": {"DuplicateSettings.excess_pairs": NEVER},
    "outliers come in runs": {"ContactSettings.most_persistence": 0.0},
    "isolated points float": {
        "ContactSettings.isolation_small": -2.0,
        "ContactSettings.isolation_large": -1.0,
    },
    "points float in company": {"ContactSettings.company_floats": 1.0},
    "the share inside is found": {"ContactSettings.inside_points": NEVER},
    "a crowd inside is one point": {"ContactSettings.crowd": 1e-9},
    "noise is off a curved wall": {"CurvedWallSettings.most_bias": 0.0},
    # the motion's fields and their amplitudes (o3dls/motion)
    "bends": {"CovarianceSettings.bend_amplitude": 1e-4},
    "strains": {"CovarianceSettings.strain_amplitude": 1e-5},
    "fields along the normal": {"CovarianceSettings.normal_amplitude": 1e-4},
    "landmarks move by themselves": {"CovarianceSettings.anchor_amplitude": 1e-4},
    "large residuals are no noise": {"CovarianceSettings.most_usual_noise": NEVER},
    "normals of a smoothed prior": {"CovarianceSettings.normals_length": 1e-3},
    # how the fit iterates
    "large noise at first": {"IterationSettings.noise_factors": (1.0,) * 5},
    "stiff at first": {"IterationSettings.first_amplitude": 1.0},
    "steps are mixed": {"IterationSettings.mixed_steps": 0},
    "inside points are damped": {"IterationSettings.inside_step": 1.0},
    "a subset of the points first": {"IterationSettings.most_points": NEVER},
    "folds of the wall are repaired": {"IterationSettings.repair_folds": False},
    # decisions of the fit
    "a pose may be enough": {"SelectionSettings.motion_log_odds": -float(NEVER)},
    "the pose is corrected": {"SelectionSettings.pose_corrections": 0},
    "the prior may be too rough": {"SelectionSettings.smoothing_lengths": ()},
    "captured points may pull": {"LeverageSettings.captured_points": NEVER},
    "stretched wall may be pulled": {"LeverageSettings.stretched_area": NEVER},
    "a part in time is shifted": {"MapShiftSettings.first_in_order": NEVER},
    "a side is shifted": {"MapShiftSettings.first_evidence": NEVER},
    "no shift at one place": {"MapShiftSettings.shared": 0.0},
    "no shift as small as the motion": {
        "MapShiftSettings.over_motion": 0.0,
        "MapShiftSettings.first_over_motion": 0.0,
    },
    "errors go together": {"DriftSettings.least_pull": NEVER},
    "a tip presses": {"DriftSettings.pressures": ()},
    "detail may be errors": {"DriftSettings.doubted": 0.0},
    # topology (o3dls/topology)
    "parts are cut off": {"CutSettings.witnesses": NEVER},
    "tubes are grown": {"TubeSettings.witnesses": NEVER},
    "a large tube is a chamber": {"TubeSettings.large": NEVER},
    "no tube is that wide": {"TubeSettings.widest": NEVER},
    "a tube is searched again": {"TubeSettings.another": NEVER},
    "hopeless trials end": {"TopologySettings.trial_lead": NEVER},
    # the reconstruction (o3dls/reconstruction)
    "points make the surface": {
        "ReconstructionSettings.evidence": NEVER,
        "ReconstructionSettings.field_evidence": NEVER,
    },
    "evidence near the prior is enough": {"ReconstructionSettings.field_evidence": NEVER},
    "necks are gaps": {"ReconstructionSettings.expected": NEVER},
    "cuts are smoothed": {"ReconstructionSettings.cut_smoothing": 1e-3},
    "normals are turned": {"NormalSettings.least_slope": NEVER},
    "inside points are added": {"ReconstructionSettings.rounds_inside": 0},
    "contact is found again": {"ReconstructionSettings.rounds_of_template": 1},
    "points off the prior show a wall": {"SplineSettings.offset_noise": NEVER},
    "wall inside out is turned": {"NormalSettings.inverted": NEVER},
    "sides by the prior": {"NormalSettings.prior_near": 0.0},
    "the amplitude is local": {"AmplitudeSettings.reach": NEVER},
    "the noise is found again": {"AmplitudeSettings.noise_factors": (1.0,)},
    "parts without points go": {"SurplusSettings.most": 0.0},
    "a mouth need not be closed where all is mapped": {"SurplusSettings.even": 0.0},
    "a closed mouth is enough": {"SurplusSettings.closed": 1.1},
    "parts go only behind closed mouths": {"SurplusSettings.closed": -1.0},
    "parts stay on which wall hangs": {"SurplusSettings.severed": NEVER},
    "parts stay that are too much": {"SurplusSettings.most": 1.0},
    "a patient's part stays": {"OwnPartSettings.evidence": 0.0},
    "handles are kept": {"HandleSettings.most_handles": 0},
}


@contextmanager
def switched(numbers: Numbers) -> Iterator[None]:
    """Other numbers, by class and name, in every settings object there is and in those made meanwhile.

    Raises KeyError where there is no such number.
    """
    before: list[tuple[Any, str, Any]] = []
    try:
        for name, value in numbers.items():
            kind, _, number = name.partition(".")
            found = _find_class(kind)
            if number not in {one.name for one in fields(found)}:
                raise KeyError(name)
            for owner in (found, *(thing for thing in gc.get_objects() if type(thing) is found)):
                before.append((owner, number, getattr(owner, number)))
                _assign(owner, number, value)
            rank = [one.name for one in fields(found)].index(number)
            made = list(found.__init__.__defaults__)
            before.append((found.__init__, "__defaults__", tuple(made)))
            made[rank] = value
            found.__init__.__defaults__ = tuple(made)
        yield
    finally:
        for owner, number, value in reversed(before):
            _assign(owner, number, value)


def package_of(name: str) -> str:
    """The package of o3dls whose settings have a number, by class and name. Raises KeyError."""
    return str(_find_class(name.partition(".")[0]).__module__.split(".")[1])


def _find_class(name: str) -> Any:
    """The settings class of that name among the modules that are loaded."""
    for module in [loaded for key, loaded in sys.modules.items() if key.startswith("o3dls.")]:
        found = getattr(module, name, None)
        if isinstance(found, type) and is_dataclass(found):
            return found
    raise KeyError(name)


def _assign(owner: Any, name: str, value: Any) -> None:
    """Set a number also where the class is frozen."""
    if isinstance(owner, type) or callable(owner):
        setattr(owner, name, value)
    else:
        object.__setattr__(owner, name, value)
