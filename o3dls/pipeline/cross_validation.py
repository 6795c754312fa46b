"""Error on points that a fit has not seen: spatial blocks of the case's own points, the whole pipeline
refitted without each; and which estimate these points prefer.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import replace
from threading import Thread

import numpy as np

from ..arrays import Ints
from ..case import Case
from ..errors import O3dlsError
from ..estimate import Estimate
from ..evaluation.left_out import LeftOut, fold_of, left_out_points
from ..evaluation.statistics import Difference, paired_difference
from ..run_warning import RunWarning
from ..runs.log import recorded_log

# ratio of distances above which an earlier estimate takes the place of the last, which is meshed and repaired
# anew: without a bound, a hundredth of a millimetre that is the same at all points decides
MINDED = 1.03
log = logging.getLogger("o3dls")

Fit = Callable[[Case], Mapping[str, Estimate]]


def cross_validate(fit: Fit, case: Case, folds: int) -> dict[str, LeftOut]:
    """Return how the case's eam points lie to the estimates fitted without their block, by estimate, in file
    order; without the offset of a part of the map where the fold's last estimate took one out.
    """
    return Folds(fit, case, folds).left_out()


class Folds:
    """Folds are the refits of a cross-validation: from the first one on here, once they are asked for, and
    from the last one on in a process of `pool`, which begins at once. Either gives the same.
    """

    def __init__(self, fit: Fit, case: Case, folds: int, pool: Executor | None = None) -> None:
        self._fit, self._case, self._count = fit, case, folds
        self._rows = np.flatnonzero(case.points.type == "eam")
        self._fold_of = fold_of(case.points.xyz[self._rows], folds)
        self._waiting = deque(range(folds))
        self._beside: dict[int, Future[tuple[dict[str, LeftOut], list[str]]]] = {}
        self._thread = Thread(target=self._begin_beside, args=(pool,), daemon=True) if pool else None
        if self._thread:
            self._thread.start()

    def left_out(self) -> dict[str, LeftOut]:
        """Return what `cross_validate` does. Raises what a fit raises, with its fold."""
        found: dict[int, dict[str, LeftOut]] = {}
        while (fold := _take_fold(self._waiting.popleft)) is not None:
            with self._name_fold(fold):
                found[fold] = _measure_gaps(self._fit, self._case, self._rows_left_out(fold))
        if self._thread:
            self._thread.join()
        for fold in sorted(set(range(self._count)) - found.keys()):
            with self._name_fold(fold):
                found[fold] = self._await_beside(fold)
        whole = {name: LeftOut.unknown(len(self._rows)) for name in found[0]}
        for fold, by_name in found.items():
            for name, part in by_name.items():
                whole[name].fill(self._fold_of == fold, part)
        return whole

    def _begin_beside(self, pool: Executor) -> None:
        """Begin folds beside this process one by one, as a process that is still to begin shall not keep a
        fold that can be done here.
        """
        with suppress(RuntimeError, CancelledError):  # the other process, or the whole run, was ended
            pool.submit(int).result()
            while (fold := _take_fold(self._waiting.pop)) is not None:
                away = self._rows_left_out(fold)
                self._beside[fold] = pool.submit(_measure_and_log, self._fit, self._case, away)
                wait([self._beside[fold]])

    def _await_beside(self, fold: int) -> dict[str, LeftOut]:
        try:
            found, lines = self._beside[fold].result()
        except (KeyError, BrokenExecutor, CancelledError):  # its process was ended, as where memory is short
            return _measure_gaps(self._fit, self._case, self._rows_left_out(fold))
        for line in lines:
            log.debug("%s", line)
        return found

    def _rows_left_out(self, fold: int) -> Ints:
        return np.asarray(self._rows[self._fold_of == fold])

    @contextmanager
    def _name_fold(self, fold: int) -> Iterator[None]:
        """Do a fold within this: the log and errors name it."""
        log.info("fold %d of %d: %d points left out", fold + 1, self._count, len(self._rows_left_out(fold)))
        try:
            yield
        except O3dlsError as error:
            self._waiting.clear()
            where = f"fold {fold + 1} of {self._count} of the cross-validation"
            points = len(self._rows_left_out(fold))
            raise type(error)(
                f"in {where}, with {points} points left out: {error}; folds = 0 leaves it away"
            ) from error


def _take_fold(take: Callable[[], int]) -> int | None:
    """Return the next fold, which no other thread has; None where there is no more."""
    try:
        return take()
    except IndexError:
        return None


def _measure_gaps(fit: Fit, case: Case, away: Ints) -> dict[str, LeftOut]:
    """Return, by estimate, how the points `away` lie to what is fitted without them."""
    estimates = fit(without(case, away))
    left = list(estimates.values())[-1].corrected(case).points.xyz[away]
    return {name: left_out_points(left, estimate, case.units) for name, estimate in estimates.items()}


def _measure_and_log(fit: Fit, case: Case, away: Ints) -> tuple[dict[str, LeftOut], list[str]]:
    """Return what `_measure_gaps` does, with the lines of the log of that process, which nobody reads
    there.
    """
    with recorded_log(logging.DEBUG) as lines:
        return _measure_gaps(fit, case, away), lines


def ending(
    chain: Sequence[str],
    left_out: Mapping[str, LeftOut],
    case: Case,
    faulty: Collection[str] = (),
    *,
    keep_last: bool = False,
) -> tuple[str, list[RunWarning]]:
    """Return the name of the estimate that a run ends with; and, where the last is rejected, or kept because
    `keep_last` says so, a warning that says why.

    chain: the last estimate and those that it started from, last first; left_out: by estimate, how the eam
    points of the case lie to what was fitted without them. The last is rejected where another is
    closer in the mean, by more than nobody minds, and the 95 % interval of the difference leaves out zero;
    but never for one of the faulty ones, whose surface is not valid, where its own is.
    """
    last = chain[0]
    known = {name: left_out[name].distance for name in chain if name in left_out}
    if not known:
        return last, []
    best = min(known, key=lambda name: float(known[name].mean()))
    farther = paired_difference(known[best], known[last], case.points.of("eam").xyz)
    if not (farther.low > 0.0 and farther.second > MINDED * farther.first):
        return last, []
    said = _describe_harm(last, best, farther, case.units)
    flawed = best in faulty and last not in faulty
    if keep_last or flawed:
        reason = f"the surface of {best} is not valid" if flawed else "keep_last says so"
        why = f"{last} is the result all the same, as {reason}; compare the two in the pictures"
        return last, [RunWarning("stage-kept", f"{said}: {why}", last)]
    return best, [RunWarning("stage-rejected", f"{said}: {best} is the result", last)]


def _describe_harm(last: str, best: str, farther: Difference, unit: str) -> str:
    return (
        f"{last} lies {farther.mean:.2f} {unit} farther from left-out points than {best} ("
        f"{farther.second:.2f} against {farther.first:.2f} {unit}, more than by chance)"
    )


def too_many(case: Case, folds: int) -> list[str]:
    """Return a sentence where the case has fewer points than folds."""
    points = int((case.points.type == "eam").sum())
    return (
        [f"folds = {folds}: {points} points of type eam are there: must be at most {points}, or 0 for none"]
        if folds > points
        else []
    )


def without(case: Case, rows: Ints) -> Case:
    """Return the case without some of its points, and without truth: its rows would no longer fit."""
    keep = np.ones(len(case.points), dtype=bool)
    keep[rows] = False
    return replace(case, points=case.points.select(keep), truth=None)
