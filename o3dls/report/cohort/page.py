"""The page: what became of the cohort in a sentence, the strip plots, the tables, the worst first."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from ...errors import InputError
from ..drawing.charts import STYLES
from ..grading.check import WORDS
from ..markup import Html, join, signed, tag
from ..page import NOTICE, page
from ..palette import places
from ..subject import SETS
from .cases import Block, outcome
from .entries import Entry, told_apart
from .grades import count_grades, describe_grades, raised
from .metrics import metric_strips
from .strips import strip_plot
from .tables import cases_table, differences_table, means_table, metrics_table, runs_table

MOST_NAMED = 10  # runs whose doubts are not folded
HOW = (
    "Runs with the same prior and the same points are runs of one case, which counts once, by their mean. "
    "Differences are paired within each case at the same points, then averaged over cases, with Student's t "
    "interval; the interval of a single case comes from resampling spatial blocks of its points. "
    "Where an interval includes zero there is no significant difference."
)


def cohort_page(entries: Sequence[Entry], out: Path, failed: Mapping[str, str] | None = None) -> str:
    """Write the page of a cohort; links go to the report.html of each run, as seen from `out`.

    failed: the cases that have no run, each with the reason. Raises InputError where there is nothing to say.
    """
    failed = failed or {}
    if not entries and not failed:
        raise InputError("no run folder is given to compare: name at least one")
    entries, notes = told_apart(entries)
    styles = _choose_styles(entries)
    judged = sorted(
        (one for one in entries if one.group), key=lambda e: (list(SETS).index(e.group or ""), e.unit)
    )
    blocks = [
        Block(group or "", unit, list(alike))
        for (group, unit), alike in groupby(judged, key=lambda e: (e.group, e.unit))
    ]
    mute = [one.name for one in entries if not one.group]
    cases = _write_count(len({e.case_key for e in entries}), "case")
    title = f"{cases}, {_write_count(len(entries), 'run')} compared"
    head = [
        tag("h1", title),
        tag("p", NOTICE, class_="notice"),
        _list_grades(entries),
        _list_wrong_poses(entries),
        _list_failures(failed),
        tag("p", HOW, class_="soft") if blocks else None,
        _list_ways(notes),
    ]
    body = [_write_section(k, block, styles, out) for k, block in enumerate(blocks)]
    if mute:
        body.append(tag("p", f"Without points to judge by: {', '.join(mute)}."))
    return page(title, join(*head, *body), "sort.js", "dots.js")


def _write_count(n: int, word: str) -> str:
    return f"{n} {word}{'' if n == 1 else 's'}"


def _list_grades(entries: Sequence[Entry]) -> Html | None:
    """Say how many runs have each grade, and name those that ask for a look with what is doubtful."""
    if not entries:
        return None
    worst, found = next(iter(count_grades(entries))), raised(entries)
    items = [
        tag("li", tag("b", f"{one.name} {WORDS[one.grade]}"), f": {'; '.join(one.doubts)}") for one in found
    ]
    title = f"{_write_count(len(found), 'run')} to look at before use"
    more = (
        tag("details", tag("summary", title), tag("ul", *items), open=len(items) <= MOST_NAMED)
        if items
        else None
    )
    return join(
        tag("p", tag("strong", "Grades"), f" {describe_grades(entries)}.", class_=f"overall {worst}"), more
    )


def _list_wrong_poses(entries: Sequence[Entry]) -> Html | None:
    """Name the runs in which a stage found another pose than the best, which no mean distance says."""
    found = [one for one in entries if one.wrong_poses]
    if not found:
        return None
    items = [tag("li", tag("b", one.name), f": {'; '.join(one.wrong_poses)}") for one in found]
    title = f"{_write_count(len(found), 'run')} with a pose that a registration got wrong"
    return tag("details", tag("summary", title), tag("ul", *items), open=len(items) <= MOST_NAMED)


def _list_failures(failed: Mapping[str, str]) -> Html | None:
    if not failed:
        return None
    said = (tag("li", tag("strong", name), f": {reason}") for name, reason in failed.items())
    title = f"{_write_count(len(failed), 'case')} failed"
    return join(tag("h2", title), tag("ul", *said, class_="warnings", aria_label=title))


def _list_ways(notes: Mapping[str, str]) -> Html | None:
    """List what differs between estimates of one name, which are never averaged with one another."""
    if not notes:
        return None
    said = (tag("li", tag("strong", name), f": {way}") for name, way in notes.items())
    return join(tag("p", "Estimates of one name that were made in different ways:"), tag("ul", *said))


def _choose_styles(entries: Sequence[Entry]) -> dict[str, int]:
    """Choose the colour of each estimate, by its method as in the reports; those of most runs come first."""
    shown = Counter((one.first, one.last) for one in entries if one.measured).most_common()
    order = dict.fromkeys(name for pair, _ in shown for name in pair if name)
    return {name: place % STYLES for name, place in zip(order, places(list(order)), strict=True)}


def _write_section(k: int, block: Block, styles: Mapping[str, int], out: Path) -> Html:
    means = f"means-{k}"
    count = f"{_write_count(len(block.cases), 'case')}, {_write_count(len(block.runs), 'run')}"
    over = any(len(found) > 1 for found in block.differences.values())
    several = (
        tag("p", "The intervals are not adjusted for the number of comparisons.", class_="soft")
        if len(block.differences) > 1
        else None
    )
    return tag(
        "section",
        tag("h2", f"Judged by: {SETS[block.group]}, in {block.unit}; {count}"),
        tag("p", summary(block), class_="verdict"),
        metric_strips(block, out),
        strip_plot(block, styles, means, out),
        means_table(means, block),
        differences_table(f"differences-{k}", block) if over else None,
        cases_table(f"cases-{k}", block) if block.differences else None,
        several,
        runs_table(f"runs-{k}", block, out),
        metrics_table(f"metrics-{k}", block, out),
    )


def summary(block: Block) -> str:
    """Say what the result gained over the baseline in the mean of the cases, how sure that is, and what is
    not valid.
    """
    invalid = sum(not run.valid for run in block.runs)
    bad = f" {invalid} of {_write_count(len(block.runs), 'result')} not valid." if invalid else ""
    pair = next(iter(block.differences), None)
    if pair is None:
        mean = np.nanmean([case.mean(block.main[1]) for case in block.cases])
        return f"{block.main[1]}: mean distance {mean:.2f} {block.unit}.{bad}"
    by_case = [one for _, one in block.differences[pair]]
    alone = len(by_case) == 1
    found = by_case[0] if alone else block.over_cases(pair)
    over = "in the one case" if alone else f"on average over {len(by_case)} cases"
    means = f"{found.second:.2f} against {found.first:.2f} {block.unit}"
    interval = (
        ""
        if math.isnan(found.low)
        else f", 95 % interval {signed(found.low)} to {signed(found.high)} {block.unit}"
    )
    said = f"{pair[1]} − {pair[0]}: {signed(found.mean)} {block.unit} {over} ({means}){interval}"
    return f"{said}: {outcome(found, pair)}.{'' if alone else _case_by_case(block)}{bad}"


def _case_by_case(block: Block) -> str:
    pair, found = next(iter(block.differences.items()))
    counts = Counter(outcome(one, pair) for _, one in found)
    return f" Case by case: {', '.join(f'{words} in {n}' for words, n in counts.most_common())}."
