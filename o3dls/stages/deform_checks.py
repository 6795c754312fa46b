"""Warnings of the stage `deform` on the points of a fit and on the motion that was found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..case import Case
from ..columns import times_of
from ..errors import SolverError
from ..geometry.surface import Surface
from ..run_warning import RunWarning

if TYPE_CHECKING:
    from ..motion.field.observations import Data
    from ..motion.result import MotionFit
    from ..noise.shifted_part import MapShift

NO_WALL = 0.95  # fraction of outliers that leaves no wall
MANY = 0.5  # fraction of outliers that is worth a warning
GROWS = 3.0  # factor on the volume that no heartbeat has: a ventricle keeps a third at least
WRONG = "the start, scale, frame or landmarks may be wrong"
CAPTURED = 0.05  # fraction of points that a motion captures: .04 is the most of good fits
OUTDATED = 1.1  # points over those that amplitudes and noise were estimated from
# rms gradient of the motion: motions of one heart have up to 0.19, a prior bent into another has 0.2 to 0.4
ANOTHER_HEART = 0.2
CLOSE = 3.0  # nats: a surface whose evidence is within a factor of 20 of the best is almost as probable
# what an update judges again
POINT_CODES = ("duplicate-points", "many-outliers", "outdated-amplitudes", "errors-together")


def point_warnings(fit: MotionFit, tuned_on: int, status: str, unit: str) -> list[RunWarning]:
    """Warn of faults of the points of a fit or an update, with the codes POINT_CODES.

    tuned_on: how many points amplitudes and noise were estimated from. Raises SolverError where almost no
    point touches the wall.
    """
    data = fit.problem.data
    return [
        *_warn_of_duplicates(data, unit),
        *_warn_of_outliers(fit, status),
        *_warn_if_outdated(tuned_on, len(data.points)),
        *_warn_of_drift(fit, unit),
    ]


def motion_warnings(fit: MotionFit, start: Surface, found: Surface, unit: str) -> list[RunWarning]:
    """Warn of a motion that can hardly be right. Raises SolverError where it turns the surface inside out."""
    return [*changed_volume(start, found), *captured(fit), *stretched(fit, found, unit)]


def another_heart(case: Case, fit: MotionFit) -> list[RunWarning]:
    """Warn if a patient's prior bends as another person's does; only a question, nothing is decided by it."""
    if case.prior_of != "patient" or case.dimension == 2 or fit.gradient <= ANOTHER_HEART:
        return []
    sentence = (
        f"the prior bends as into another heart (rms gradient {fit.gradient:.2f}; one heart's motion has at "
        'most 0.19): is it another person\'s or a mean anatomy? Then say prior_of = "template" in case.toml'
    )
    return [RunWarning("prior-of-another", sentence)]


def allow_for_lost_order(case: Case, fit: MotionFit) -> MotionFit:
    """Return the fit with a deviation that allows for what `order_lost` warns of."""
    from ..motion.drift import with_doubt  # imported late: who lists the stages needs no compiled code

    share = fit.problem.settings.drift.doubted
    return with_doubt(fit, float(np.sqrt(share)) * (_find_lost_detail(case, fit) or 0.0))


def order_lost(case: Case, fit: MotionFit) -> list[RunWarning]:
    """Warn if a patient's prior took on detail that may be errors of the points, and no order tells."""
    if (detail := _find_lost_detail(case, fit)) is None:
        return []
    moves = f"the wall moves by {detail:.2g} {case.units} over short lengths, or points share errors: "
    why = "without their order these look alike, and the deviation allows for a part of it; "
    why += "export the points with their times"
    return [RunWarning("order-lost", moves + why)]


def _find_lost_detail(case: Case, fit: MotionFit) -> float | None:
    """Another person's atrium differs in such detail anyway, so nothing is said of a template."""
    from ..motion.drift import lost_order

    return None if case.prior_of != "patient" or case.dimension == 2 else lost_order(fit)


def shifted(shift: MapShift | None, case: Case, *, taken_out: bool) -> list[RunWarning]:
    """Warn of a part of the map that is shifted, and say what was done with its offset."""
    if shift is None:
        return []
    done = "the offset was taken out" if taken_out else 'deform.map_shift = "fit" takes the offset out'
    times = times_of(case.points.columns, case.points.type)
    later = case.points.taken > shift.part.beyond
    begin = None if times is None else float(times[later].min(initial=np.inf))
    sentence = f"{shift.sentence(case.units, begin)}: did the patient move, or the reference slip? {done}"
    return [RunWarning("map-shift", sentence)]


def alternatives(best: MotionFit, fits: Sequence[MotionFit], unit: str) -> list[RunWarning]:
    """Warn of other surfaces almost as probable: from another start, or from a fit without some points."""
    found = list[RunWarning]()
    noise = best.sigma
    for other in fits:
        apart = float(np.linalg.norm(other.vertices - best.vertices, axis=1).mean())
        behind = other.energy - best.energy
        if behind < CLOSE and apart > noise:
            words = f"another start {_describe_rival(behind, apart, unit)}"
            found.append(RunWarning("alternative-start", words))
            break
    facts = best.facts
    if "alternative_behind" in facts:
        behind, apart = facts["alternative_behind"], facts["alternative_apart"]
        if behind < CLOSE and apart > noise:
            points = f"{facts['alternative_excluded']:.0f} points that may have pulled the wall outward"
            words = f"a fit that begins without {points} {_describe_rival(behind, apart, unit)}"
            found.append(RunWarning("alternative-points", words))
    return found


def _describe_rival(behind: float, apart: float, unit: str) -> str:
    return (
        f"is almost as probable ({max(behind, 0.0):.1f} nats less) and leads to a surface {apart:.1f} {unit} "
        "away on average"
    )


def _warn_of_outliers(fit: MotionFit, status: str) -> list[RunWarning]:
    fraction = fit.facts["outlier_fraction"]
    if fraction > NO_WALL:
        raise SolverError(f"deform: {status}: the points do not belong to this surface, or {WRONG}")
    sentence = f"{fraction:.0%} of the points are judged to be outliers: {WRONG}"
    return [RunWarning("many-outliers", sentence)] if fraction > MANY else []


def _warn_if_outdated(before: int, now: int) -> list[RunWarning]:
    sentence = f"amplitudes, noise and pose were estimated from the first {before} of {now} points: fit again"
    return [RunWarning("outdated-amplitudes", sentence)] if now > OUTDATED * before else []


def _warn_of_drift(fit: MotionFit, unit: str) -> list[RunWarning]:
    scales = fit.state.scales
    if not scales.drifts:
        return []
    together, own = float(np.linalg.norm(scales.drift_sds)), float(scales.noises[0])
    sentence = (
        f"points that were taken one after the other share an error of {together:.2g} {unit}, beside "
        f"{own:.2g} {unit} of each point's own: the wall does not follow it, and its deviation allows for it"
    )
    return [RunWarning("errors-together", sentence)]


def changed_volume(start: Surface, found: Surface) -> list[RunWarning]:
    """Warn if the motion changes the volume too much. Raises SolverError where it turns the surface inside
    out.
    """
    factor = found.volume / start.volume
    if factor <= 0.0:
        raise SolverError(f"deform: the motion turns the surface inside out: {WRONG}")
    if 1.0 / GROWS < factor < GROWS:
        return []
    amount = "volume" if start.dimension == 3 else "area"
    sentence = f"the motion changes the enclosed {amount} by a factor of {factor:.2g}: {WRONG}"
    return [RunWarning("volume-changed", sentence)]


def captured(fit: MotionFit) -> list[RunWarning]:
    """Warn if the wall seems to follow points that do not touch it."""
    from ..motion.leverage_points import captured_points

    points = captured_points(fit.problem, fit.state)
    if points.sum() <= fit.problem.settings.leverage.captured_points or points.mean() <= CAPTURED:
        return []
    sentence = (
        f"{points.mean():.0%} of the points lie far from the wall at the start and on it after the motion: "
        "does the wall follow points without contact, or a structure that the prior lacks?"
    )
    return [RunWarning("captured-points", sentence)]


def stretched(fit: MotionFit, found: Surface, unit: str) -> list[RunWarning]:
    """Warn if a part of the wall is stretched, and say where."""
    from ..motion.leverage_points import stretched_faces

    usual = fit.problem.settings.leverage
    rest = found.with_vertices(fit.motion.rest.at)
    long, fraction = stretched_faces(rest, found.vertices, usual)
    if fraction <= usual.stretched_area:
        return []
    middle = ", ".join(f"{x:.0f}" for x in found.vertices[rest.faces[long]].mean(axis=(0, 1)))
    sentence = (
        f"{fraction:.0%} of the wall is stretched to more than {usual.stretch:g} times its length, around "
        f"({middle}) {unit}: do the points there belong to this chamber?"
    )
    return [RunWarning("stretched-wall", sentence)]


def _warn_of_duplicates(data: Data, unit: str) -> list[RunWarning]:
    """Warn if mapping points share a place: they are no new evidence."""
    place = np.asarray(data.mapping)
    more = len(place) - len(np.unique(place))
    if not more:
        return []
    near = f" or lie within {data.duplicate_distance:.2g} {unit} of it, too close for independent noise"
    others = f"the place of another{near if data.duplicate_distance else ''}"
    sentence = f"{more} of {len(place)} points repeat {others}; each place counts once"
    return [RunWarning("duplicate-points", sentence)]
