"""What to do about each check that is not OK, in words: by the check, or by the warning that it repeats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...run_warning import RunWarning, each_once
from ..subject import Subject
from .check import Check, doubtful
from .landmarks import WARNED, warned_landmarks, worst_landmark

# what is to be compared between prior and map, by check or code: asked for in one sentence
COMPARED: Mapping[str, Sequence[str]] = {
    "Size": ("units", "heart phase", "patient"),
    "Volume change": ("units", "heart phase", "missing veins"),
    "many-outliers": ("units", "landmarks", "frame"),
    "points-on-a-ball": ("units", "patient", "chamber"),
    "points-beside-the-wall": ("names of landmarks", "heart phase"),
    "volume-changed": ("units", "frame", "chamber"),
}
REMEDIES: Mapping[str, str] = {
    # checks
    "Valid surface": "see Validity of the surfaces for the fault",
    "Converged": "give the motion more rounds",
    "Expected error": "do not rely on the error that is given, and look where the points lie far off",
    "Calibration": "do not rely on the standard deviation",
    "Far points": "see whose points lie far off, and leave out those of another chamber",
    "Share of outliers": "look at the points that were judged outliers",
    "Removed wall": "see whether the removed wall is missing in the patient",
    "Prior-only area": "map the hatched wall, or do not use it",
    "Farthest part": "see whether the wall that is far from all points is part of this chamber",
    # warnings
    "start-pose-doubtful": "compare the start pose with the pictures, and give three named landmarks",
    "component-without-points": "remove pieces of the prior that are no part of this chamber",
    "large-noise": "look for points without contact or of another chamber",
    "uncertain-pose": "give three landmarks, which decide between the two poses",
    "crumpled-prior": "smooth the prior, or give the label volume",
    "sigma-range": "give all values of the column sigma in one unit",
    "stretched-wall": "see whether the points at the stretched wall are of this chamber",
    "alternative-start": "give landmarks or more points, which decide between two surfaces",
    "alternative-points": "look at the points that the warning names, and remove those without contact",
    "map-shift": "ask whether the patient moved or the reference slipped during the map",
    "outdated-amplitudes": "run deform anew on all points",
    "mesh-differs": "set a smaller level_set.spacing, or do not use the surface for simulation",
    "stage-rejected": "keep {better}, which left-out points prefer to {stage}",
    "stage-kept": "use {better}, which left-out points prefer{unless}",
    "other": "see the documentation of the stage {stage} for its warning",
}


def remedies(subject: Subject, found: Sequence[Check]) -> list[str]:
    """Return what to do about the checks that ask for a look, each remedy once; what is to be compared comes
    first.
    """
    raised = [one.name for one in doubtful(found)]
    told = _list_grave(subject) if "Warnings" in raised else []
    keys = [*raised, *(one.code for one in told)]
    compared = list(dict.fromkeys(what for key in keys for what in COMPARED.get(key, ())))
    todo = [f"check {_join_words(compared)}"] if compared else []
    todo += [REMEDIES[name] for name in raised if name in REMEDIES]
    if subject.first and f"Against {subject.first.name}" in raised:
        todo.append(f"see whether {subject.first.name} is the better surface here")
    todo += [f"mark {name} again" for name in _landmarks_to_mark(subject, raised, keys)]
    todo += [_fill_in(one, subject) for one in told if one.code in REMEDIES]
    return list(dict.fromkeys(todo))


def _list_grave(subject: Subject) -> list[RunWarning]:
    """List the warnings of the last run that put its result in doubt, each once."""
    estimates = subject.last.run.estimates.values()
    return [one for one in each_once(w for e in estimates for w in e.warnings) if one.grade != "good"]


def _landmarks_to_mark(subject: Subject, raised: Sequence[str], keys: Sequence[str]) -> list[str]:
    warned = list(warned_landmarks(subject))
    if any(code in keys for code in WARNED) and not warned:
        warned = ["the landmark of the warning"]
    return [*([worst_landmark(subject)] if "Landmarks" in raised else []), *warned]


def _fill_in(one: RunWarning, subject: Subject) -> str:
    """Name the stages in the remedy of a warning; a run folder keeps only its sentence."""
    run = subject.last.run
    better = next((key for key in run.estimates if f"than {key} (" in one.sentence), "")
    unless = ", unless you need a valid surface" if better and run.faults_of(better) else ""
    named = {"better": better or "the earlier estimate", "stage": one.stage or "that gave it"}
    return REMEDIES[one.code].format(**named, unless=unless)


def _join_words(words: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
