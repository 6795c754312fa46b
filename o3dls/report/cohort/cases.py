"""Runs gathered by their case: means over the runs of one case, differences within a case and over cases."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from ...arrays import Array
from ...evaluation.statistics import Difference, difference_over_cases, paired_difference
from ..sections.paired import SMALLEST
from ..subject import MOST_SHOWN
from .entries import Entry, stages_of

Pair = tuple[str, str]  # estimates: the difference is the second less the first
CLOSER, FARTHER, NEITHER = "▼", "▲", "="


@dataclass(frozen=True, eq=False)
class CaseOfRuns:
    """A case comes with its runs that are judged by one set of points."""

    name: str
    runs: Sequence[Entry]

    def means(self, estimate: str) -> list[float]:
        """Return the mean distance of an estimate in each run that has it."""
        return [float(run.measured[estimate][1].mean()) for run in self.runs if estimate in run.measured]

    def mean(self, estimate: str) -> float:
        """Return the mean distance of an estimate over the case's runs, NaN where none has it."""
        return float(np.mean(self.means(estimate) or [np.nan]))

    def difference(self, pair: Pair) -> Difference | None:
        """Return the paired difference at the same points, over the runs' mean distances; None where there
        are none.
        """
        first, second = self._average_runs(pair[0]), self._average_runs(pair[1])
        if first is None or second is None or not _same_points(first[0], second[0]) or len(first[0]) < 2:
            return None
        return paired_difference(first[1], second[1], first[0])

    def _average_runs(self, estimate: str) -> tuple[Array, Array] | None:
        """Return positions, and the distance of each in the mean of the runs; None where the runs differ in
        positions.
        """
        found = [run.measured[estimate] for run in self.runs if estimate in run.measured]
        if not found or not all(_same_points(found[0][0], positions) for positions, _ in found):
            return None
        return found[0][0], np.mean([gaps for _, gaps in found], axis=0)


def _same_points(a: Array, b: Array) -> bool:
    return np.array_equal(a, b)


@dataclass(frozen=True, eq=False)
class Block:
    """A block has runs that are judged by the same set of points, in the same unit: only like is averaged
    with like.
    """

    group: str
    unit: str
    runs: Sequence[Entry]

    @cached_property
    def estimates(self) -> list[str]:
        """What is compared, in the order of the pipelines."""
        depth: dict[str, int] = {}
        for run in self.runs:
            for name, made in run.made.items():
                depth[name] = max(depth.get(name, 0), len(stages_of(made)))
        return sorted(depth, key=lambda name: (depth[name], name))

    @cached_property
    def main(self) -> tuple[str | None, str]:
        """The baseline and the result of most runs."""
        return Counter((run.first, run.last) for run in self.runs).most_common(1)[0][0]

    @cached_property
    def cases(self) -> list[CaseOfRuns]:
        """The cases, the worst result first; a case without the main result after those that have it."""
        by_case: dict[str, list[Entry]] = {}
        for run in self.runs:
            by_case.setdefault(run.case_key, []).append(run)
        names = Counter(runs[0].case for runs in by_case.values())
        found = [
            CaseOfRuns(
                runs[0].case if names[runs[0].case] == 1 else f"{runs[0].case} ({runs[0].name})",
                sorted(runs, key=lambda run: -float(run.measured[run.last][1].mean())),
            )
            for runs in by_case.values()
        ]
        return sorted(found, key=lambda case: (np.isnan(case.mean(self.main[1])), -_worst_mean(case, self)))

    @cached_property
    def differences(self) -> dict[Pair, list[tuple[CaseOfRuns, Difference]]]:
        """The difference of every pair of estimates in each case that has both, the main pair first; of more
        than four estimates only those from the baseline.
        """
        pairs = sorted(combinations(self.estimates, 2), key=lambda pair: pair != self.main)
        if len(self.estimates) > MOST_SHOWN:
            pairs = [pair for pair in pairs if self.main[0] in pair]
        found = {
            pair: [(case, one) for case in self.cases if (one := case.difference(pair))] for pair in pairs
        }
        return {pair: some for pair, some in found.items() if some}

    def over_cases(self, pair: Pair) -> Difference:
        """Return the mean difference over cases, with its interval."""
        return difference_over_cases([one for _, one in self.differences[pair]])


def _worst_mean(case: CaseOfRuns, block: Block) -> float:
    main = case.mean(block.main[1])
    return max(max(case.means(run.last)) for run in case.runs) if np.isnan(main) else main


def outcome(found: Difference, pair: Pair) -> str:
    """Say in words which of the pair is closer; neither is where the interval includes zero or the difference
    is too small to be seen in the table.
    """
    if np.isnan(found.low):
        return "too few for an interval"
    if not found.clear or abs(found.mean) < SMALLEST:
        return "no significant difference"
    return f"{pair[1] if found.mean < 0 else pair[0]} closer"


def sign_of(found: Difference, pair: Pair) -> str:
    """Return the outcome as a mark without colour: the second of the pair is closer, farther, or neither."""
    said = outcome(found, pair)
    if not said.endswith("closer"):
        return NEITHER
    return CLOSER if found.mean < 0 else FARTHER
