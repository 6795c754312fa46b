"""The outcome in one sentence."""

from __future__ import annotations

import math

from ..evaluation.interpolation import REACH
from ..evaluation.next_places import MEAN_OVER_SD
from ..evaluation.statistics import Difference, paired_difference
from .contribution import credit
from .markup import signed
from .subject import Result, Subject
from .wall_parts import compared, wall_parts

WORDS = {
    "held_out": "the held-out points",
    "cross_validated": "the cross-validated points",
    "ablation": "the ablation points (not fitted)",
    "fitted": "the fitted points (no evidence of accuracy: it was fitted to them)",
}
SMALLEST_SHARE = 0.005


def verdict(subject: Subject) -> str:
    """Say in one sentence which is closer to unseen data, by how much and how sure.

    It ends with how much of the surface has no data.
    """
    parts = [_describe_comparison(subject) or _describe_alone(subject), *_describe_noise(subject)]
    parts += _describe_harm(subject)
    if told := credit(subject):
        parts.append(told)
    if subject.unmapped is not None:
        parts.append(_describe_unmapped(subject.unmapped, f"{REACH:g} {subject.unit}"))
    return " ".join(parts)


def _describe_noise(subject: Subject) -> list[str]:
    """Say how much of the distance to left-out points is the points' own, so that nobody takes it for the
    wall's error.
    """
    sigma = subject.last.estimate.sigma
    if subject.headline != "cross_validated" or not sigma:
        return []
    own = f"{MEAN_OVER_SD * sigma:.2f} {subject.unit}"
    return [f"The points' own noise, about {own} in the mean, is in these distances."]


def _describe_harm(subject: Subject) -> list[str]:
    """Say where the baseline is clearly closer on a part of the wall, which a mean over all can hide."""
    first = subject.first
    worse = [one for one in wall_parts(subject) if one.worse] if first else []
    return [
        f"Worse than {first.name if first else ''} ({one.name}): {compared(one, subject.unit)}."
        for one in worse
    ]


def _describe_unmapped(share: float, far: str) -> str:
    if share < SMALLEST_SHARE:
        return f"Less than {SMALLEST_SHARE:.1%} of the surface is farther than {far} from every fitted point."
    return (
        f"{100 * share:.0f} % of the surface is farther than {far} from every fitted point: there "
        "are no points, and the shape is that of the image alone."
    )


def headline_difference(subject: Subject) -> Difference | None:
    """Return the paired difference between the first and the last estimate shown, on the headline set."""
    return (
        None
        if subject.first is None or subject.headline is None
        else difference(subject.first, subject.last, subject.headline)
    )


def difference(first: Result, second: Result, group: str) -> Difference | None:
    """Return the paired difference of two results on a set of points, that of the second.

    None where they do not share it.
    """
    positions, a = first.measured(group, second)
    other, b = second.measured(group)
    if len(a) < 2 or positions.shape != other.shape or (positions != other).any():
        return None
    return paired_difference(a, b, positions)


def _describe_comparison(subject: Subject) -> str | None:
    found = headline_difference(subject)
    if found is None or subject.first is None or subject.headline is None:
        return None
    last = subject.last.name
    first = subject.first.name
    unit = subject.unit
    means = f"mean distance {found.second:.2f} against {found.first:.2f} {unit}"
    if math.isnan(found.low):
        return (
            f"{last} and {first} on {WORDS[subject.headline]}: {means} ({found.n} points, too few for "
            "an interval)."
        )
    if not found.clear:
        interval = f"95 % interval of the difference {signed(found.low)} to {signed(found.high)} {unit}"
        return (
            f"No significant difference between {last} and {first} on {WORDS[subject.headline]}: {means} "
            f"({interval})."
        )
    way = "closer to" if found.mean < 0 else "farther from"
    small, large = sorted((abs(found.low), abs(found.high)))
    gain = (
        f"{abs(found.mean):.2f} {unit} ({abs(found.percent):.0f} %), 95 % interval {small:.2f} to "
        f"{large:.2f} {unit}"
    )
    return f"{last} is {way} {WORDS[subject.headline]} than {first} by {gain}: {means}."


def _describe_alone(subject: Subject) -> str:
    if subject.headline is None:
        return f"{subject.last.name}: there are no points to judge it by."
    score = subject.last.scores[subject.headline]
    mean = f"{score[f'mean_{subject.unit}']:.2f} {subject.unit}"
    return f"{subject.last.name} is on average {mean} from {WORDS[subject.headline]} ({score['n']} points)."
