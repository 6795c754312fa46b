"""Many runs in one table: what each gained over its baseline on data it had not seen, the worst first."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from urllib.parse import quote

import numpy as np

from ..arrays import Array
from ..errors import InputError
from .markup import Child, Html, join, signed, table, tag
from .page import page
from .statistics import ROUNDS, SEED, Difference
from .subject import SETS, Subject
from .verdict import headline_difference, warnings

ROW, LEFT, WIDTH = 36, 12, 760  # pixels of the chart of all runs
LONGEST = 40  # letters of a name, which stands above its line


@dataclass(frozen=True)
class Entry:
    """One run of the cohort: where it is, what it is called, and the numbers that the table shows."""

    folder: Path
    name: str
    estimates: tuple[str, str]
    group: str
    mean: float
    unit: str
    gain: Difference | None
    valid: bool
    seconds: float
    warnings: int


def entry(subject: Subject) -> Entry | None:
    """The line of a run; None where it has no points to be judged by."""
    if subject.headline is None:
        return None
    first = subject.first.name if subject.first else ""
    mean = subject.last.measured(subject.headline)[1].mean()
    return Entry(
        folder=subject.folders[0],
        name=subject.case.name,
        estimates=(first, subject.last.name),
        group=subject.headline,
        mean=float(mean),
        unit=subject.unit,
        gain=headline_difference(subject),
        valid=not subject.last.run.faults_of(subject.last.key),
        seconds=float(subject.records[0]["seconds"]),
        warnings=len(warnings(subject)),
    )


def cohort_page(subjects: Sequence[Subject], out: Path) -> str:
    """The page of a cohort; links go to the report.html of each run, as seen from `out`. Raises InputError
    where it is empty.
    """
    if not subjects:
        raise InputError("no run folder is given to compare: name at least one")
    entries = sorted(
        (found for one in subjects if (found := entry(one))),
        key=lambda e: (list(SETS).index(e.group), e.unit, -e.mean),
    )
    mute = [one.case.name for one in subjects if one.headline is None]
    parts = [
        tag("h1", f"{len(subjects)} runs compared"),
        tag("p", "Research use only. Not for clinical use.", class_="notice"),
    ]
    for (group, unit), alike in groupby(entries, key=lambda e: (e.group, e.unit)):
        parts.append(_block(group, unit, list(alike), out))
    if mute:
        parts.append(tag("p", f"Without points to judge by: {', '.join(mute)}."))
    return page(f"{len(subjects)} runs compared", join(*parts))


def _block(group: str, unit: str, entries: list[Entry], out: Path) -> Html:
    """Runs that are judged by the same set of points: only like is averaged with like."""
    numbers = [f"{name}, {unit}" for name in ("mean before", "mean after", "difference", "95 % interval")]
    head = [
        "run, worst first",
        "difference of",
        *numbers,
        "relative",
        "valid",
        "warnings",
        "seconds",
        "folder",
    ]
    return tag(
        "section",
        tag("h2", f"Judged by: {SETS[group]}"),
        tag("p", summary(entries), class_="verdict"),
        _chart(entries),
        table(head, [_row(one, out) for one in entries]),
    )


def summary(entries: Sequence[Entry]) -> str:
    """How many runs gained, and the mean gain over runs with an interval from resampling the runs."""
    gains = np.array([one.gain.mean for one in entries if one.gain])
    unit = entries[0].unit
    invalid = sum(not one.valid for one in entries)
    bad = f" {invalid} of {len(entries)} results are not valid." if invalid else ""
    if len(gains) == 0:
        return f"{len(entries)} runs, mean distance {np.mean([one.mean for one in entries]):.2f} {unit}.{bad}"
    spread = ""
    if len(gains) > 2:
        low, high = _interval(gains)
        spread = f" (95 % interval over runs {signed(low)} to {signed(high)})"
    better = int((gains < 0).sum())
    return (
        f"Closer than the baseline in {better} of {len(gains)} runs; mean difference "
        f"{signed(gains.mean())} {unit}{spread}.{bad}"
    )


def _interval(values: Array) -> tuple[float, float]:
    drawn = np.random.default_rng(SEED).choice(values, (ROUNDS, len(values))).mean(axis=1)
    low, high = np.percentile(drawn, [2.5, 97.5])
    return float(low), float(high)


def _row(one: Entry, out: Path) -> list[Child]:
    report = one.folder / "report.html"
    name: Child = one.name
    if report.is_file():
        path = Path(os.path.relpath(report.resolve(), out.resolve().parent)).as_posix()
        name = tag("a", one.name, href=quote(os.fsencode(path)))  # a folder may be named `javascript:`
    verdict = tag("strong", "no") if not one.valid else "yes"
    tail: list[Child] = [verdict, one.warnings or "–", f"{one.seconds:.1f}", one.folder.name]
    if one.gain is None:
        return [name, one.estimates[1], "–", f"{one.mean:.2f}", "–", "–", "–", *tail]
    gain = one.gain
    interval = "too few" if np.isnan(gain.low) else f"{signed(gain.low)} to {signed(gain.high)}"
    shown = tag("span", signed(gain.mean), class_="best" if gain.clear else None)
    between = f"{one.estimates[1]} − {one.estimates[0]}"
    return [
        name,
        between,
        f"{gain.first:.2f}",
        f"{gain.second:.2f}",
        shown,
        interval,
        f"{signed(gain.percent, 0)} %",
        *tail,
    ]


def _chart(entries: Sequence[Entry]) -> Html | None:
    """One line per run from the baseline's mean distance (ring) to the result's (disc)."""
    paired = [one for one in entries if one.gain]
    if not paired:
        return None
    reach = max(max(one.gain.first, one.gain.second) for one in paired if one.gain) or 1.0
    right = WIDTH - 40

    def at(value: float) -> float:
        return LEFT + (right - LEFT) * value / reach

    rows = []
    for k, one in enumerate(paired):
        y = 30 + k * ROW
        gain = one.gain
        if gain is None:
            continue
        worse = gain.mean > 0
        rows += [
            tag(
                "text",
                one.name if len(one.name) <= LONGEST else one.name[: LONGEST - 1] + "…",
                x=LEFT + 6,
                y=y - 10,
            ),
            tag(
                "path",
                d=f"M{at(gain.first):.1f} {y}H{at(gain.second):.1f}",
                class_="series s1 d1" if worse else "series s0",
            ),
            tag("circle", cx=f"{at(gain.first):.1f}", cy=y, r="4.5", class_="ring"),
            tag("circle", cx=f"{at(gain.second):.1f}", cy=y, r="4.5", class_="f1" if worse else "f0"),
        ]
    height = 12 + len(paired) * ROW + 26
    axis = tag("path", d=f"M{LEFT} 4V{height - 26}H{right}", class_="axis")
    ends = [
        tag("text", "0", x=LEFT, y=height - 8),
        tag("text", f"{reach:.2f} {paired[0].unit}", x=right, y=height - 8, text_anchor="end"),
    ]
    said = "Ring: baseline; disc: result; dashed where the result is farther away."
    drawing = tag(
        "svg",
        axis,
        *rows,
        *ends,
        viewBox=f"0 0 {WIDTH} {height}",
        class_="chart wide",
        role="img",
        aria_label=said,
    )
    return tag("figure", drawing, tag("p", said, class_="soft"), class_="plot")
