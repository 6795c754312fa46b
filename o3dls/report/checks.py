"""The strip at the top of a page: what decides whether the last surface can be used, each graded in words and
in colour.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from ..evaluation.interpolation import REACH
from ..runs.far_points import far_points
from .expected import DUE, OFF, expected_error, shares_within
from .markup import signed
from .shape_words import words_of
from .subject import Subject
from .wall_parts import MAPPED, PRIOR_ONLY, Part, compared, wall_parts

Grade = Literal["good", "amber", "bad", "none"]
WORDS: Mapping[Grade, str] = {"good": "OK", "amber": "CHECK", "bad": "FAIL", "none": "NO DATA"}
FAR_LANDMARK = 10.0  # mm: wider than a vein's ostium is uncertain, as of a landmark in another vein
LARGE_CHANGE = 1 / 3  # of the volume: more than an atrium fills and empties by
MANY_OUTLIERS = 0.2  # as many as bad contact brings
HALF = 0.5  # of the wall without points: the result is more prior than map


@dataclass(frozen=True)
class Check:
    """One entry of the strip: what is looked at, how it came out, and why in a sentence and in short."""

    name: str
    grade: Grade
    said: str
    short: str = ""


def checks(subject: Subject) -> list[Check]:
    """The entries of the strip on the last estimate, in their order; every number is that of its run."""
    return [
        _valid(subject),
        _converged(subject),
        _against_baseline(subject),
        _expected(subject),
        _calibrated(subject),
        _landmarks(subject),
        _far_points(subject),
        _outliers(subject),
        _prior_only(subject),
        _volume(subject),
    ]


def _valid(subject: Subject) -> Check:
    name = f"Valid {words_of(subject).shape}"
    faults = subject.last.run.faults_of(subject.last.key)
    if faults:
        return Check(name, "bad", "not valid: " + "; ".join(faults), _counted(faults, "fault"))
    kind = "self-intersections" if subject.case.dimension == 2 else "holes or folds"
    return Check(name, "good", f"valid: no new {kind}", "valid")


def _counted(found: Sequence[str], word: str) -> str:
    return f"{len(found)} {word}{'' if len(found) == 1 else 's'}"


def _converged(subject: Subject) -> Check:
    run, last = subject.last.run, subject.last.key
    not_yet = [name for name, estimate in run.estimates.items() if not estimate.converged]
    if not not_yet:
        return Check("Converged", "good", "all stages converged", "all stages")
    grade: Grade = "bad" if last in not_yet else "amber"
    return Check("Converged", grade, f"not converged: {', '.join(not_yet)}", _counted(not_yet, "stage"))


def _expected(subject: Subject) -> Check:
    found = expected_error(subject)
    if found is None:
        return Check("Expected error", "none", "no stage gives a posterior")
    parts = ((MAPPED, found.mapped), (PRIOR_ONLY, found.prior_only))
    apart = "; ".join(f"{name}: {value:.2f} {subject.unit}" for name, value in parts if value is not None)
    said = f"mean {found.all:.2f} {subject.unit}, from the posterior ({apart})"
    return Check("Expected error", "good", said, f"{found.all:.2f} {subject.unit}")


def _calibrated(subject: Subject) -> Check:
    """Where the truth is known, whether the posterior expects the errors that were made."""
    found = shares_within(subject)
    if found is None:
        return Check("Calibration", "none", "no truth and posterior to compare")
    off = found[0] - DUE[0]
    shape = words_of(subject).shape
    said = f"{found[0]:.0%} of the {shape} is within one standard deviation of the truth"
    said = f"{said} ({DUE[0]:.0%} expected)"
    short = f"{found[0]:.0%} within 1 SD"
    if abs(off) <= OFF:
        return Check("Calibration", "good", said, short)
    return Check("Calibration", "amber", f"{said}: {'too cautious' if off > 0 else 'too confident'}", short)


def _against_baseline(subject: Subject) -> Check:
    """Apart on the mapped wall and where there are no points: a gain on one must not hide harm."""
    parts = [one for one in wall_parts(subject) if one.gain]
    name = f"Against {subject.first.name}" if subject.first else "Against a baseline"
    if not parts:
        return Check(name, "none", "no points left out, or no baseline")
    said = "; ".join(f"{one.name}: {compared(one, subject.unit)}" for one in parts)
    return Check(
        name, "amber" if any(one.worse for one in parts) else "good", said, _worst(parts, subject.unit)
    )


def _worst(parts: Sequence[Part], unit: str) -> str:
    """Of the part on which the last estimate does least well, so that a gain on the other hides nothing."""
    least = max((one.gain for one in parts if one.gain), key=lambda gain: gain.mean)
    if not least.clear:
        return "no clear difference"
    return f"{'closer' if least.mean < 0 else 'farther'} by {abs(least.mean):.2f} {unit}"


def _landmarks(subject: Subject) -> Check:
    name = "Landmarks, leave-one-out"
    unit = subject.unit
    errors = {
        mark: float(found["leave_one_out"])
        for result in subject.last.run.estimates.values()
        for mark, found in result.facts.get("landmarks", {}).items()
        if found.get("leave_one_out") is not None
    }
    if not errors:
        return Check(name, "none", "no stage fits landmarks and leaves each out")
    worst = max(errors, key=lambda mark: errors[mark])
    far = unit == "mm" and errors[worst] > FAR_LANDMARK
    said = f"worst: {worst}, {errors[worst]:.1f} {unit}" + (f" (above {FAR_LANDMARK:g} mm)" if far else "")
    return Check(name, "amber" if far else "good", said, f"{worst}, {errors[worst]:.1f} {unit}")


def _far_points(subject: Subject) -> Check:
    """What was not fitted, by the set that lies farthest off."""
    name, found = "Far points", far_points(subject.last.run, subject.last.key)
    if not found:
        return Check(name, "none", "no held-out point, ablation site or landmark to measure")
    far = [one for one in found if one.doubtful]
    if not far:
        return Check(name, "good", f"no {', '.join(one.name for one in found)} lie centimetres off", "none")
    grade: Grade = "bad" if any(one.failed for one in found) else "amber"
    return Check(name, grade, "; ".join(one.said for one in far), "; ".join(one.short for one in far))


def _outliers(subject: Subject) -> Check:
    """By the last stage that looked for outliers."""
    found = _last_fact(subject, "outlier_fraction")
    if found is None:
        return Check("Share of outliers", "none", "no stage looked for outliers")
    many = found > MANY_OUTLIERS
    return Check(
        "Share of outliers", "amber" if many else "good", f"{found:.0%} of the points", f"{found:.0%}"
    )


def _last_fact(subject: Subject, key: str) -> Any:
    facts = (estimate.facts.get(key) for estimate in reversed([*subject.last.run.estimates.values()]))
    return next((value for value in facts if value is not None), None)


def _prior_only(subject: Subject) -> Check:
    name = "Prior-only area"
    share = subject.unmapped
    if share is None:
        return Check(name, "none", "is measured on surfaces in 3D")
    said = f"{share:.0%} of the surface is farther than {REACH:g} {subject.unit} from every fitted point"
    return Check(name, "amber" if share > HALF else "good", said, f"{share:.0%}")


def _volume(subject: Subject) -> Check:
    words = words_of(subject)
    name = f"{words.amount.capitalize()} change"
    change = subject.last.validity.get("volume_change")
    if change is None:
        return Check(name, "none", f"an open {words.shape} has no {words.amount}")
    large = abs(change) >= LARGE_CHANGE
    short = f"{signed(100 * change, 0)} %"
    return Check(name, "amber" if large else "good", f"{short} against the prior", short)
