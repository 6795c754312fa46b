"""How far the landmarks of the map lie from their places on the result, and which of them are warned of."""

from __future__ import annotations

import numpy as np

from ..subject import Subject
from .check import Check, count_decimals

NAME = "Landmarks"
FAR_LANDMARK = 15.0  # mm from its place on the result: as of a landmark in another vein
# mm rms, of all of them, on a patient's own prior: places marked to 2 mm per axis lie 3.5 mm off, and 3.9 at
# most in healthy maps; another person's veins are elsewhere
LANDMARKS_RMS = 4.6
WARNED = {"landmark-not-used": "not used", "landmark-swapped-place": "warned of"}


def check_landmarks(subject: Subject) -> Check:
    """Check how far each landmark of the map lies from its place on the result. (Left out of the fit of four,
    one is predicted to 10 mm in the median of good results, and to 50 mm in the worst.)
    """
    unit, last = subject.unit, subject.last
    marks = last.run.points.of("landmark")
    gap = marks.numbers(f"distance_{last.key}_{unit}")
    if not np.isfinite(gap).any():
        return Check(NAME, "none", "no landmark has its place on the prior", "no landmark on the prior")
    worst, rms = int(np.nanargmax(gap)), float(np.sqrt(np.nanmean(gap**2)))
    limited = unit == "mm" and subject.case.prior_of == "patient"
    far = unit == "mm" and (gap[worst] > FAR_LANDMARK or (limited and rms > LANDMARKS_RMS))
    who = f"{marks.columns['name'][worst]} {_write_apart(gap[worst], FAR_LANDMARK)} {unit}"
    mean = f"{_write_apart(rms, LANDMARKS_RMS)} {unit} rms"
    asked = ": were they marked there?" if far else ""
    told = "".join(f"; {name} {how}" for name, how in warned_landmarks(subject).items())
    said = f"{mean} from their places on the result; worst: {who}{asked}{told}"
    # a number that has a limit stands there, whichever of them fails
    short = f"{mean}; {who}" if limited else who
    limit = f"up to {FAR_LANDMARK:g} mm{f', {LANDMARKS_RMS:g} mm rms' if limited else ''}"
    after = f"{' on the result' if told else ''}{told}"
    return Check(NAME, "amber" if far else "good", said, short + after, limit if unit == "mm" else "")


def _write_apart(value: float, limit: float) -> str:
    return f"{value:.{count_decimals(value, (limit,), 1)}f}"


def warned_landmarks(subject: Subject) -> dict[str, str]:
    """Return the landmarks of the map that the run's warnings name, each with what was done with it."""
    names = [str(name) for name in subject.case.points.of("landmark").columns.get("name", ())]
    found: dict[str, str] = {}
    for estimate in subject.last.run.estimates.values():
        for one in estimate.warnings:
            if one.code in WARNED:
                # the sentence is all that a run folder keeps of it
                found |= {n: WARNED[one.code] for n in names if f"landmark {n} " in one.sentence}
    return found


def worst_landmark(subject: Subject) -> str:
    """Return the name of the landmark that lies farthest from its place on the result."""
    marks = subject.last.run.points.of("landmark")
    gap = marks.numbers(f"distance_{subject.last.key}_{subject.unit}")
    return str(marks.columns["name"][int(np.nanargmax(gap))])
