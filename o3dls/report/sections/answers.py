"""What a reader asks first, each answered in a sentence: how far off the surface is, where not to rely on it,
and what to do next.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...evaluation.next_places import MEAN_OVER_SD
from ..expected import Scatter, left_out_scatter
from ..grading.check import Check, worst_grade
from ..grading.doubts import NAMED, doubted_regions
from ..grading.expected_error import NARROW, at_least
from ..grading.remedies import remedies
from ..mapping.advice import located, shown_advice
from ..markup import Html, tag
from ..subject import SETS, Subject
from ..verdict import SMALLEST_SHARE
from ..wall_parts import MAPPED, PRIOR_ONLY, Part, compared_parts


def answers(subject: Subject, found: Sequence[Check]) -> Html:
    """List the three answers that stand under the verdict, in the order in which they are asked."""
    said = (
        ("Typical error", "; ".join(_describe_errors(subject))),
        ("Do not rely on", _describe_doubts(subject, found)),
        ("Next", _describe_next(subject, found)),
    )
    items = (tag("div", tag("dt", name), tag("dd", f"{text}.")) for name, text in said)
    return tag("dl", *items, class_="answers")


def _describe_errors(subject: Subject) -> list[str]:
    """Describe the error of each part of the wall, and whether it was measured or comes from the model."""
    shown = [part for part in compared_parts(subject) if part.name != PRIOR_ONLY or _has_unmapped(subject)]
    found = [_describe_error(part, subject) for part in shown]
    return [one for one in found if one] or [
        "not known: no stage gives a posterior, and no point was left out"
    ]


def _has_unmapped(subject: Subject) -> bool:
    """Whether the wall without points does not round to nothing, so that its error means something."""
    return (subject.unmapped or 0.0) >= SMALLEST_SHARE


def _describe_error(part: Part, subject: Subject) -> str | None:
    """Give the error of a part: of what unseen points measure and what the model expects, neither may hide
    the other. Wall without points has few points to measure by, so there the model speaks.
    """
    name = part.short
    measured, expected = (None if part.n == 0 else part.found), part.expected
    if part.name == PRIOR_ONLY and expected is not None:
        measured = None
    if measured is None and expected is None:
        return None
    scatter = left_out_scatter(subject.last)
    if part.name == MAPPED and expected is not None and scatter and subject.headline == "cross_validated":
        return f"{name} {expected:.1f} {subject.unit} ({_describe_support(subject, scatter)})"
    # as they are shown: of 1.12 and 1.14 neither is more
    if measured is not None and (expected is None or round(measured, 1) >= round(expected, 1)):
        by = f"measured, {part.n} {SETS[subject.headline or 'fitted']}"
        return f"{name} {measured:.1f} {subject.unit} ({by.removesuffix(' points')} points)"
    beside = "" if measured is None else f", more than the {measured:.1f} measured at {part.n} points"
    bound = at_least(subject) if part.name == PRIOR_ONLY else ""
    return f"{name} {bound}{expected:.1f} {subject.unit} (by the model{beside})"


def _describe_support(subject: Subject, scatter: Scatter) -> str:
    """Say whether left-out points bear the model out. Their distances from the wall have their own noise in
    them, and are those of fits that lacked their neighbours too, so that they are no error of this surface;
    what they are to the deviation that such a fit predicted for them, is.
    """
    count = f"{scatter.count} left-out points"
    if scatter.ratio > NARROW:
        said = f"{scatter.ratio:.1f} times what the model expects, as {count} show"
    else:
        said = f"by the model, which {count} bear out"
    if not subject.last.estimate.sigma:
        return said
    # the colours that a page opens with are distances of points
    noise = f"{MEAN_OVER_SD * subject.last.estimate.sigma:.1f} {subject.unit}"
    return f"{said}; the noise of the points, {noise}, is in the colours"


def _describe_doubts(subject: Subject, found: Sequence[Check]) -> str:
    """Name the parts not to rely on, each with its error."""
    if worst_grade(found) == "bad":
        return "the whole surface: a check failed"
    doubts = doubted_regions(subject, found)
    named = "; ".join(f"{one.name} ({one.said})" for one in doubts[:NAMED])
    more = f" and {len(doubts) - NAMED} more" if len(doubts) > NAMED else ""
    share = 0.0 if any(one.unmapped for one in doubts) else subject.unmapped or 0.0
    rest = f"the {share:.0%} of the wall without points (hatched)" if share >= SMALLEST_SHARE else ""
    return "; ".join(filter(None, [named + more, rest])) or "no part in particular"


def _describe_next(subject: Subject, found: Sequence[Check]) -> str:
    """Say what to do in one sentence: what failed comes first, then each check that asks for a look, then
    points.
    """
    faulty = [one.name for one in found if one.grade == "bad"]
    todo = [f"find out why this failed: {', '.join(faulty)}"] if faulty else []
    todo += remedies(subject, found)
    todo += [] if faulty else _places_to_map(subject)
    if subject.headline == "fitted":
        todo.append("cross-validate (folds = 5)")
    return "; ".join(todo) or "nothing is asked for"


def _places_to_map(subject: Subject) -> list[str]:
    """Name the best places for one more point each, with what it gains there, where the last estimate can
    tell.
    """
    advice = shown_advice(subject)
    if advice is None or not advice.places:
        return []
    named = list[str]()
    for k, one in enumerate(located(subject, advice), 1):
        where = f"{one.name}; " if one.name else ""
        named.append(f"{k} ({where}error {'' if named else 'there '}{one.gain} {subject.unit})")
    numbered = "as the pictures number them" if subject.case.dimension == 3 else "as numbered below"
    return [f"take points, {numbered}, at {', '.join(named)}"]
