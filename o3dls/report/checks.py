"""The strip at the top of a page: what decides whether the last surface can be used, each graded in words and
in colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..runs.far_points import FEW, far_points
from .expected import DUE, OFF, shares_within
from .grading.check import Check, Grade, count_words, write_share
from .grading.convergence import check_convergence
from .grading.expected_error import NO_POSTERIOR, check_expected_error
from .grading.landmarks import check_landmarks
from .grading.remarks import count_remarks, remarks, warnings_of
from .grading.size import check_size
from .grading.wall import farthest, prior_only, removed_wall, volume
from .shape_words import words_of
from .subject import Subject
from .wall_parts import Part, compared, compared_parts

WARNINGS = "Warnings"
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
        check_landmarks(subject),
        check_size(subject),
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
    share = write_share(found[0], DUE[0] - OFF, DUE[0] + OFF)
    said = f"{share} of the {shape} is within the {DUE[0]:.0%} band of the truth"
    short, limit = (
        f"{share} in the {DUE[0]:.0%} band",
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
    share, limit = write_share(found, MANY_OUTLIERS), f"up to {MANY_OUTLIERS:.0%}"
    return Check("Share of outliers", grade, f"{share} of the points", share, limit)


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
