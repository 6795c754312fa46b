"""Checks of the wall: what was removed of it, how much of it nobody visited, how its volume changed."""

from __future__ import annotations

from ...evaluation.interpolation import REACH
from ...geometry.cut_wall import on_cut
from ..expected import absent_share
from ..mapping.place_words import describe_place
from ..markup import signed
from ..shape_words import words_of
from ..subject import Subject, unmapped
from .check import Check, Grade, count_decimals, write_share
from .farthest_part import farthest_part
from .size import found_scale

# of the volume: healthy atria empty by 55 % of their largest (58 of 103 ml in men, 48 of 89 in women;
# Hudsmith et al., J Cardiovasc Magn Reson 2005;7:775): half is about the most that a heart phase explains
BEAT, LARGE_CHANGE = 0.55, 0.5
SMALL_CHANGE = 0.1  # beside which the strip does not say what is normal
REMOVED = 0.005  # share of the wall whose removal is to be looked at: 5 mm of a tube that is 4 mm thick
LITTLE = f"below {REMOVED:.1%}"
OF_TEMPLATE = "any amount, of a template"
FAR_REACH = 25.0  # mm from every point, from which a part of the wall is named,
FAR_SHARE = 0.15  # and its share of the wall from which it is to be looked at
NEAR = f"up to {FAR_REACH:g} mm, or below {FAR_SHARE:.0%}"
HALF = 0.5  # of the wall without points: the result is more prior than map
FLAT = "in 3D only"


def removed_wall(subject: Subject) -> Check:
    """Return what stages have taken away of the wall, each against the surface that it was given.

    Of a template it is no doubt: it has wall that the patient lacks, and nearly all results whose template
    lost wall were good (docs/accuracy_verdict.md).
    """
    name = "Removed wall"
    facts = [one.facts for one in subject.last.run.estimates.values()]
    share = max((float(one.get("removed_share", 0.0)) for one in facts), default=0.0)
    reach = max((float(one.get("removed_reach_mm", 0.0)) for one in facts), default=0.0)
    if share == 0.0:
        return Check(name, "good", "no part of the prior was removed", "nothing", LITTLE)
    amount = write_share(share, REMOVED, usual=1)
    removed = f"{amount} of the wall was removed, up to {reach:.0f} mm from what is left"
    said = f"{removed}: check that the patient lacks it"
    template = subject.case.prior_of == "template"
    grade: Grade = "good" if template or share < REMOVED else "amber"
    return Check(name, grade, said, f"{amount}, {reach:.0f} mm", OF_TEMPLATE if template else LITTLE)


def prior_only(subject: Subject) -> Check:
    """Grade how much of the wall was never mapped, also before a stage removed wall, which must not hide that
    nobody was there.
    """
    name = "Prior-only area"
    share = subject.unmapped
    if share is None:
        return Check(name, "none", "is measured on surfaces in 3D", FLAT)
    before = _unmapped_before_removal(subject)
    amount = write_share(share, HALF)
    said = f"{amount} of the surface is farther than {REACH:g} {subject.unit} from every fitted point"
    if before is not None and before > share:
        said += f"; {before:.0%} before wall was removed"
    if cut := _share_cut(subject):
        said += f"; {cut:.1%} is the cap where the border of the image cut the chamber off, and no wall"
    if missing := absent_share(subject.last.estimate.surface):
        said += f"; {missing:.1%} of the surface may not exist"
    half = max(share, before or 0.0) > HALF
    return Check(name, "amber" if half else "good", said, amount, f"up to {HALF:.0%}")


def _share_cut(subject: Subject) -> float:
    surface = subject.last.estimate.surface
    return float(surface.vertex_areas @ on_cut(surface) / surface.area)


def _unmapped_before_removal(subject: Subject) -> float | None:
    """Return the share without points of the surface that the first stage was given which removed wall; None
    where none did.
    """
    run = subject.last.run
    names = list(run.estimates)
    removed = [k for k, key in enumerate(names) if run.estimates[key].facts.get("removed_share", 0.0) > 0.0]
    return unmapped(run.estimates[names[removed[0] - 1]].surface, subject.unit) if removed else None


def farthest(subject: Subject) -> Check:
    """Return the one connected part of the wall without points that is farthest from any: a vein, or what a
    segmentation has leaked into.
    """
    name, surface = "Farthest part", subject.last.estimate.surface
    found = farthest_part(surface, subject.unit)
    if found is None:
        return Check(name, "none", "is measured on surfaces in 3D", FLAT)
    at = f"around ({', '.join(f'{x:.0f}' for x in found.middle)})"
    where = ", ".join(filter(None, [describe_place(subject, found.middle), at]))
    share = write_share(found.share, FAR_SHARE)
    reach = f"{found.reach:.{count_decimals(found.reach, (FAR_REACH,), 0)}f} mm"
    said = (
        f"a part of {share} of the wall, {where}, has no point and reaches "
        f"{reach} from the nearest: is it part of this chamber?"
    )
    if found.reach <= FAR_REACH:
        said = f"no wall is farther than {FAR_REACH:g} mm from a point"
        return Check(name, "good", said, f"{reach} from a point", NEAR)
    grade: Grade = "amber" if found.share >= FAR_SHARE else "good"
    short = f"{share} of the wall, up to {reach} from any point"
    return Check(name, grade, said, short, NEAR)


def volume(subject: Subject) -> Check:
    words = words_of(subject)
    name = f"{words.amount.capitalize()} change"
    change = subject.last.validity.get("volume_change")
    if change is None:
        return Check(name, "none", f"an open {words.shape} has no {words.amount}", f"open {words.shape}")
    large = abs(change) >= LARGE_CHANGE
    digits = count_decimals(100 * abs(change), (100 * LARGE_CHANGE,), 0)
    short = f"{signed(100 * change, digits)} %"
    said = f"{short} against the prior{_explain_change(subject, large)}"
    notable = subject.case.dimension == 3 and abs(change) >= SMALL_CHANGE
    size = _describe_size(subject)
    beside = "; ".join(filter(None, [size, f"a beat: {BEAT:.0%}" if notable else ""]))
    beside = f" ({beside})" if beside else ""
    return Check(name, "amber" if large else "good", said, short + beside, f"below {LARGE_CHANGE:.0%}")


def _describe_size(subject: Subject) -> str:
    """Say how much of the change of the volume is the scale that ICP found, where that is notable."""
    found = found_scale(subject)
    alone = 0.0 if found is None else found[1] ** 3 - 1.0
    return f"size alone: {signed(100 * alone, 0)} %" if abs(alone) >= SMALL_CHANGE else ""


def _explain_change(subject: Subject, large: bool) -> str:
    """Say what is normal, and how much of the wall shows the change by points of its own."""
    if subject.case.dimension == 2:
        return ""
    phase = "another heart phase alone is unlikely to explain it" if large else "a heart phase can explain it"
    normal = f"; a healthy atrium empties by about {BEAT:.0%} of its largest volume in a beat: {phase}"
    share = subject.unmapped
    return normal if share is None else f"{normal}; {1.0 - share:.0%} of the wall has points that show it"
