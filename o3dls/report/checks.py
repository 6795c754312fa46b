"""The strip at the top of a page: what decides whether the last surface can be used, each graded in words and
in colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..runs.far_points import FEW, far_points
from .expected import DUE, OFF, shares_within
from .grading.check import Check, Grade, count_words
from .grading.convergence import check_convergence
from .grading.expected_error import NO_POSTERIOR, check_expected_error
from .grading.remarks import count_remarks, remarks, warnings_of
from .grading.wall import farthest, prior_only, removed_wall, volume
from .shape_words import words_of
from .subject import Subject
from .wall_parts import Part, compared, compared_parts

WARNINGS = "Warnings"
FAR_LANDMARK = 15.0  # mm from its place on the result: as of a landmark in another vein
# mm rms, of all of them, on a patient's own prior: places marked to 2 mm per axis lie 3.5 mm off, and 3.9 at
# most in healthy maps; another person's veins are elsewhere
LANDMARKS_RMS = 4.6
SIZE = 0.13  # of the logarithm of a scale: no heart is an eighth larger or smaller than it was imaged
FARTHER = 0.1  # mm behind the baseline that always count as worse
MANY_OUTLIERS = 0.2  # share of outliers that bad contact brings about
FAULTLESS, CLOSER, UNDOUBTED = "without new faults", "where clearly closer", "without warnings"


def checks(subject: Subject) -> list[Check]:
    """Return the entries of the strip on the last estimate, in their order; every number is that of its
    run.
    """
    known = subject.case.truth is not None and subject.case.truth.surface is not None
    return [
        _check_validity(subject),
        check_convergence(subject),
        _against_baseline(subject),
        check_expected_error(subject),
        *([_check_calibration(subject)] if known else []),  # that a patient's truth is not known is no fault
        _check_landmarks(subject),
        _check_size(subject),
        _far_points(subject),
        _check_outliers(subject),
        removed_wall(subject),
        prior_only(subject),
        farthest(subject),
        volume(subject),
        _check_warnings(subject),
    ]


def _check_validity(subject: Subject) -> Check:
    name = f"Valid {words_of(subject).shape}"
    faults = subject.last.run.faults_of(subject.last.key)
    if faults:
        said, short = "not valid: " + "; ".join(faults), count_words(faults, "fault")
        return Check(name, "bad", said, short, FAULTLESS)
    kind = "self-intersections" if subject.case.dimension == 2 else "holes or folds"
    return Check(name, "good", f"valid: no new {kind}", "valid", FAULTLESS)


def _check_calibration(subject: Subject) -> Check:
    """Compare the posterior with the errors that were made, where the truth is known."""
    found = shares_within(subject)
    if found is None:
        return Check(
            "Calibration", "none", "no stage gives a posterior to compare with the truth", NO_POSTERIOR
        )
    off = found[0] - DUE[0]
    shape = words_of(subject).shape
    said = f"{found[0]:.0%} of the {shape} is within the {DUE[0]:.0%} band of the truth"
    short, limit = (
        f"{found[0]:.0%} in the {DUE[0]:.0%} band",
        f"from {DUE[0] - OFF:.0%} to {DUE[0] + OFF:.0%}",
    )
    if abs(off) <= OFF:
        return Check("Calibration", "good", said, short, limit)
    said = f"{said}: {'too cautious' if off > 0 else 'too confident'}"
    return Check("Calibration", "amber", said, short, limit)


def _against_baseline(subject: Subject) -> Check:
    """Compare the last estimate with the baseline, separately on the mapped wall and where there are no
    points: a gain on one must not hide harm. Where neither is clearly closer, that is no merit.
    """
    parts = [one for one in compared_parts(subject) if one.gain]
    name = f"Against {subject.first.name}" if subject.first else "Against a baseline"
    if not parts:
        said = "no points left out, or no baseline"
        return Check(name, "none", said, said)
    said = "; ".join(f"{one.name}: {compared(one, subject.unit)}" for one in parts)
    if behind := [one for one in parts if _is_behind(one, subject)]:
        return Check(name, "amber", said, _describe_gain(behind, subject.unit), CLOSER)
    closer = [one for one in parts if one.gain and one.gain.clear]
    grade: Grade = "good" if closer else "even"
    return Check(name, grade, said, _describe_gain(closer or parts, subject.unit), CLOSER)


def _is_behind(part: Part, subject: Subject) -> bool:
    """Say whether the baseline is clearly closer on a part, or closer by what is never passed over."""
    return part.worse or (subject.unit == "mm" and part.gain is not None and part.gain.mean > FARTHER)


def _describe_gain(parts: Sequence[Part], unit: str) -> str:
    """Describe the gain on that of the parts on which the last estimate does least well."""
    least, where = max(((one.gain, one.short) for one in parts if one.gain), key=lambda one: one[0].mean)
    if not least.clear and least.mean <= FARTHER:
        return "no significant difference"
    # a reader knows the mean of the whole wall, which may say the opposite
    return (
        f"closer by {-least.mean:.2f} {unit}"
        if least.mean < 0
        else f"farther by {least.mean:.2f} {unit}, {where}"
    )


def _check_landmarks(subject: Subject) -> Check:
    """Check how far each landmark of the map lies from its place on the result. (Left out of the fit of four,
    one is predicted to 10 mm in the median of good results, and to 50 mm in the worst.)
    """
    name, unit, last = "Landmarks", subject.unit, subject.last
    marks = last.run.points.of("landmark")
    gap = marks.numbers(f"distance_{last.key}_{unit}")
    if not np.isfinite(gap).any():
        return Check(name, "none", "no landmark has its place on the prior", "no landmark on the prior")
    worst, rms = int(np.nanargmax(gap)), float(np.sqrt(np.nanmean(gap**2)))
    own = subject.case.prior_of == "patient"
    far = unit == "mm" and (gap[worst] > FAR_LANDMARK or (own and rms > LANDMARKS_RMS))
    who = f"{marks.columns['name'][worst]}, {gap[worst]:.1f} {unit}"
    asked = ": were they marked there?" if far else ""
    said = f"{rms:.1f} {unit} rms from their places; worst: {who}{asked}"
    limit = f"up to {FAR_LANDMARK:g} mm{f', {LANDMARKS_RMS:g} mm rms' if own else ''}" if unit == "mm" else ""
    return Check(name, "amber" if far else "good", said, who, limit)


def _check_size(subject: Subject) -> Check:
    """Check the scale that ICP finds between image and map, which are both in millimetres."""
    name = "Size"
    first = next((one for one in subject.results.values() if one.key.startswith("icp")), None)
    first = subject.first if subject.first and subject.first.key.startswith("icp") else first
    if first is None or subject.case.prior_of != "patient" or subject.unit != "mm":
        said = "there is no ICP, the prior is a template, or lengths are not in mm"
        return Check(name, "none", said, "does not apply")
    scale = float(np.cbrt(np.linalg.det(first.estimate.T_map_prior[:3, :3])))
    off = abs(np.log(scale)) > SIZE
    asked = ": are units, heart phase and patient the same?" if off else ""
    said = f"{first.name} makes the prior {scale:.2f} times as large{asked}"
    limit = f"from x {np.exp(-SIZE):.2f} to x {np.exp(SIZE):.2f}"
    return Check(name, "amber" if off else "good", said, f"x {scale:.2f}", limit)


def _far_points(subject: Subject) -> Check:
    """Check the points that were not fitted, by the set that lies farthest off."""
    name, found = "Far points", far_points(subject.last.run, subject.last.key)
    if not found:
        said = "no held-out point, ablation site or landmark to measure"
        return Check(name, "none", said, "no such points")
    far = [one for one in found if one.doubtful]
    if not far:
        said = f"no {', '.join(one.name for one in found)} lie centimetres off"
        return Check(name, "good", said, "none", FEW)
    grade: Grade = "bad" if any(one.failed for one in found) else "amber"
    return Check(name, grade, "; ".join(one.said for one in far), "; ".join(one.short for one in far), FEW)


def _check_outliers(subject: Subject) -> Check:
    """Grade the share of outliers by the last stage that looked for them."""
    found = _last_fact(subject, "outlier_fraction")
    if found is None:
        said = "no stage looked for outliers"
        return Check("Share of outliers", "none", said, said)
    grade: Grade = "amber" if found > MANY_OUTLIERS else "good"
    said, limit = f"{found:.0%} of the points", f"up to {MANY_OUTLIERS:.0%}"
    return Check("Share of outliers", grade, said, f"{found:.0%}", limit)


def _last_fact(subject: Subject, key: str) -> Any:
    facts = (estimate.facts.get(key) for estimate in reversed([*subject.last.run.estimates.values()]))
    return next((value for value in facts if value is not None), None)


def _check_warnings(subject: Subject) -> Check:
    """Repeat the warnings, since no verdict is better than the gravest of them."""
    told = remarks(subject)
    grave = warnings_of(told)
    if not grave:
        short = count_remarks(told) or "no warning"
        return Check(WARNINGS, "good", "no warning puts the result in doubt", short, UNDOUBTED)
    grade: Grade = "bad" if grave[0].grade == "bad" else "amber"
    said = "; ".join(one.sentence for one in grave)
    return Check(WARNINGS, grade, said, count_remarks(grave), UNDOUBTED)
