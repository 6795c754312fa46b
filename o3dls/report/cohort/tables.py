"""Tables of the cohort's page. Each can be put in order by any of its columns; numbers order as numbers."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ...evaluation.statistics import Difference
from ..drawing.pictures import THUMBNAIL
from ..grading.check import WORDS, Grade
from ..markup import Child, Html, join, signed, tag
from .cases import Block, CaseOfRuns, Pair, outcome, sign_of
from .entries import Entry
from .links import link_report
from .metrics import metrics_of

MOST_DRAWN = 200  # runs with a picture, the worst: each takes some 4 kB of the page
# by which rows are sorted
RANKS: dict[Grade, float] = {"good": 0.0, "even": 0.0, "none": math.nan, "amber": 1.0, "bad": 2.0}


class Cell(NamedTuple):
    """A cell has what it shows, and the number by which its row is put in order, NaN last; None: it is a
    text, and ordered as one.
    """

    shown: Child
    number: float | None = None


def sortable(
    name: str, caption: str, head: Sequence[str], rows: Sequence[Sequence[Cell]], ordered: int | None = None
) -> Html:
    """Make a table with the id `name`, whose headings the page's script turns into buttons that sort the
    rows.

    ordered: the column by which the rows stand from the largest to the smallest already.
    """
    words = [bool(rows) and rows[0][k].number is None for k in range(len(head))]
    top = [
        tag(
            "th",
            title,
            scope="col",
            aria_sort="descending" if k == ordered else None,
            class_="text" if words[k] else None,
        )
        for k, title in enumerate(head)
    ]
    body = [tag("tr", tag("th", row[0].shown, scope="row"), *map(_write_cell, row[1:])) for row in rows]
    said = f"{name}-caption"
    whole = tag(
        "table",
        tag("thead", tag("tr", *top)),
        tag("tbody", *body),
        class_="sortable",
        id=name,
        aria_labelledby=said,
    )
    return join(  # a caption would scroll with its table
        tag("p", caption, class_="soft", id=said),
        tag("div", whole, class_="scroll", tabindex="0", role="group", aria_labelledby=said),
    )


def _write_cell(cell: Cell) -> Html:
    if cell.number is None:
        return tag("td", cell.shown, class_="text")
    return tag("td", cell.shown, data_sort="" if math.isnan(cell.number) else f"{cell.number:.9g}")


def means_table(name: str, block: Block) -> Html:
    """Tabulate the mean distance of every estimate in every case, which are the marks of the strip plot."""
    rows = [
        [
            Cell(case.name),
            Cell(len(case.runs), len(case.runs)),
            *(_mean_cell(case, e) for e in block.estimates),
        ]
        for case in block.cases
    ]
    result = block.estimates.index(block.main[1]) + 2
    caption = (
        f"Mean distance by case, {block.unit}; of several runs the mean, and the smallest and the largest."
    )
    return sortable(name, caption, ["case, worst first", "runs", *block.estimates], rows, result)


def _mean_cell(case: CaseOfRuns, estimate: str) -> Cell:
    values = case.means(estimate)
    if not values:
        return Cell("–", math.nan)
    mean = case.mean(estimate)
    spread = f" ({min(values):.2f} to {max(values):.2f})" if len(values) > 1 else ""
    return Cell(f"{mean:.2f}{spread}", mean)


def differences_table(name: str, block: Block) -> Html:
    """Tabulate the mean difference of every pair of estimates over the cases that have both."""
    rows = []
    for pair, found in block.differences.items():
        by_case = [outcome(one, pair) for _, one in found]
        closer = [by_case.count(f"{estimate} closer") for estimate in pair]
        sure = f"{closer[1]} closer, {closer[0]} farther, {len(found) - sum(closer)} neither"
        rows.append([*_difference_cells(pair, block.over_cases(pair), len(found)), Cell(sure)])
    unit = block.unit
    head = ["difference of", "cases", f"mean, {unit}", f"95 % interval over cases, {unit}", "relative"]
    return sortable(
        name,
        "Paired differences over cases; below zero the first named is closer.",
        [*head, "outcome", "case by case"],
        rows,
    )


def cases_table(name: str, block: Block) -> Html:
    """Tabulate the difference of every pair of estimates in every case."""
    unit = block.unit
    rows = []
    for pair, found in block.differences.items():
        for case, one in found:
            shown, *rest = _difference_cells(pair, one, one.n)
            rows.append([Cell(case.name), shown, *rest])
    head = ["case, worst first", "difference of", "points", f"mean, {unit}", f"95 % interval, {unit}"]
    caption = "Paired differences within each case; intervals from spatial blocks of its points."
    return sortable(name, caption, [*head, "relative", "outcome"], rows)


def _difference_cells(pair: Pair, found: Difference, n: int) -> list[Cell]:
    said = outcome(found, pair)
    interval = "–" if math.isnan(found.low) else f"{signed(found.low)} to {signed(found.high)}"
    best = "best" if said.endswith("closer") else None
    return [
        Cell(f"{pair[1]} − {pair[0]}"),
        Cell(n, n),
        Cell(tag("span", signed(found.mean), class_=best), found.mean),
        Cell(interval, found.low),
        Cell(f"{signed(found.percent, 0)} %", found.percent),
        Cell(f"{sign_of(found, pair)} {said}"),
    ]


def runs_table(name: str, block: Block, out: Path) -> Html:
    """List every run by its name, with a link to its report as seen from the page `out`, the worst first."""
    ordered = sorted(
        ((_result_distance(run), case.name, run) for case in block.cases for run in case.runs),
        key=lambda one: -one[0],
    )
    rows = [
        [
            Cell(_show_run(run, out, drawn=k < MOST_DRAWN)),
            Cell(case),
            Cell(" → ".join(filter(None, (run.first, run.last)))),
            Cell(f"{distance:.2f}", distance),
            Cell(
                tag(
                    "strong",
                    WORDS[run.grade],
                    class_=f"grade {run.grade}",
                    title="; ".join(run.doubts) or None,
                ),
                RANKS[run.grade],
            ),
            Cell("yes" if run.valid else tag("strong", "no")),
            Cell(run.warnings or "–", run.warnings),
            Cell(f"{run.seconds:.1f}", run.seconds),
        ]
        for k, (distance, case, run) in enumerate(ordered)
    ]
    head = ["run, worst first", "case", "compared", f"mean distance of the result, {block.unit}"]
    return sortable(
        name,
        "Runs, by the names of their folders, with links to their reports.",
        [*head, "grade", "valid", "warnings", "seconds"],
        rows,
        3,
    )


def metrics_table(name: str, block: Block, out: Path) -> Html:
    """Tabulate the metrics of every run, which are the dots of the strips, the worst first."""
    metrics = metrics_of(block)
    rows = [
        [Cell(_show_run(run, out, drawn=False)), *(_value_cell(one.values[k]) for one in metrics)]
        for k, run in sorted(enumerate(block.runs), key=lambda one: -_result_distance(one[1]))
    ]
    head = ["run, worst first", *(one.title for one in metrics)]
    return sortable(name, "Metrics by run: the dots of the strips.", head, rows, 1)


def _value_cell(value: float) -> Cell:
    return Cell("–" if math.isnan(value) else f"{value:.2f}", value)


def _result_distance(run: Entry) -> float:
    return float(run.measured[run.last][1].mean())


def _show_run(run: Entry, out: Path, *, drawn: bool) -> Child:
    """Show the name of a run with its picture, both linked with its report where it has one."""
    picture = None
    if drawn and run.picture:
        source = "data:image/webp;base64," + base64.b64encode(run.picture).decode("ascii")
        width, height = THUMBNAIL
        picture = tag(
            "img",
            src=source,
            alt="",
            class_="thumbnail",
            loading="lazy",
            width=width // 2,
            height=height // 2,
        )
    shown = join(picture, run.name) if picture else run.name
    target = link_report(run, out)
    return tag("a", shown, href=target) if target else shown
