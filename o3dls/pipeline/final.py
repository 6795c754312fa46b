"""Which estimate a run ends with: the last, unless points that were left out reject it for an earlier one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..arrays import Array
from ..case import Case
from ..evaluation.statistics import Difference, paired_difference
from ..run_warning import RunWarning


def ending(chain: Sequence[str], left_out: Mapping[str, Array], case: Case) -> tuple[str, list[RunWarning]]:
    """Name of the estimate that a run ends with; and, where it is not the last, a warning that says why.

    chain: the last estimate and those that it started from, last first; left_out: by estimate, distances (n,)
    of the eam points of the case to what was fitted without them. The last is rejected where another is
    closer in the mean and the 95 % interval of the difference leaves out zero.
    """
    last = chain[0]
    known = [name for name in chain if name in left_out]
    if not known:
        return last, []
    best = min(known, key=lambda name: float(left_out[name].mean()))
    farther = paired_difference(left_out[best], left_out[last], case.points.of("eam").xyz)
    if not farther.low > 0.0:
        return last, []
    return best, [RunWarning("stage-rejected", _sentence(last, best, farther, case.units), last)]


def _sentence(last: str, best: str, farther: Difference, unit: str) -> str:
    return (
        f"{last} is farther from points that were left out than {best} ({farther.second:.2f} against "
        f"{farther.first:.2f} {unit}, by {farther.low:.2f} to {farther.high:.2f}): the result is {best}"
    )
