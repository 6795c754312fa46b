"""How the solvers went: what fell at each iteration, and where the time went."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...arrays import Array
from ..drawing.charts import STYLES, Axis, Series, axis_over, grouped, line_chart
from ..markup import Child, Html, join, table, tag
from ..section import Section
from ..subject import Result, Subject

INDICES = ("iteration", "level")  # columns of a trace that count and measure nothing
ENERGIES = ("energy", "misfit", "complexity", "labels", "data", "prior", "area", "shape")
LENGTHS = ("rms", "median", "step", "sigma", "length")  # in the unit of the case
WORDS = {"loosening": "coarse-to-fine factor", "outlier_fraction": "share of outliers", "pairs": "pairs kept"}
LOG_FROM = 30.0  # ratio of largest to smallest value above which a logarithmic axis shows more


def course_section(subject: Subject) -> Section | None:
    """Chart the trace of every estimate that has one, and list the seconds of each stage."""
    charts = [
        chart
        for result in subject.results.values()
        if len(result.estimate.trace) > 1
        for chart in _chart_traces(result, subject.unit)
    ]
    body = join(_seconds_table(subject), grouped(*charts) if charts else None)
    return Section("course", "Convergence and time", body)


def _chart_traces(result: Result, unit: str) -> list[Html]:
    """Draw a chart for each unit of the trace: the energy with its terms, lengths, the others alone."""
    charts: dict[tuple[str, str], dict[str, Array]] = {}
    for name, values in _changing_columns(result.estimate.trace).items():
        charts.setdefault(_name_quantity(name, unit), {})[name] = values
    return [
        _chart_trace(result, f"{result.name}, {what}: {_describe_end(result)}", label, columns)
        for (what, label), columns in charts.items()
    ]


def _name_quantity(name: str, unit: str) -> tuple[str, str]:
    """Name what a column of a trace is, and the label of its axis."""
    if name in ENERGIES:
        return "energy", "energy, without unit"
    if name in LENGTHS:
        return "lengths", f"length, {unit}"
    return WORDS.get(name, name), WORDS.get(name, name)


def _chart_trace(result: Result, title: str, label: str, columns: Mapping[str, Array]) -> Html:
    steps = np.arange(1.0, len(result.estimate.trace) + 1)
    series = [
        Series(WORDS.get(name, name), k % STYLES, steps, values)
        for k, (name, values) in enumerate(columns.items())
    ]
    values = np.concatenate(list(columns.values()))
    known = values[np.isfinite(values)]
    log = bool((known > 0).all() and known.max() > LOG_FROM * known.min())
    y = axis_over(label, list(columns.values()), log=log)
    return line_chart(title, series, Axis("iteration", 1.0, float(max(len(steps), 2))), y)


def _describe_end(result: Result) -> str:
    return "converged" if result.estimate.converged else "not converged"


def _changing_columns(trace: Sequence[Mapping[str, float]]) -> dict[str, Array]:
    """Return columns of a trace that change, gaps as NaN."""
    names = dict.fromkeys(key for row in trace for key in row if key not in INDICES)
    columns = {name: np.array([row.get(name, np.nan) for row in trace], dtype=np.float64) for name in names}
    changing = {name: values for name, values in columns.items() if np.nanmax(values) > np.nanmin(values)}
    return changing or columns


def _seconds_table(subject: Subject) -> Html:
    """Tabulate the seconds per stage, and of the whole run, cross-validation and scoring included."""
    results = [result for result in subject.results.values() if result.estimate.seconds > 0]
    rows: list[list[Child]] = [
        [r.name, f"{r.estimate.seconds:.2f}", r.estimate.iterations, _share_bar(r, results)] for r in results
    ]
    for folder, run in zip(subject.folders, subject.runs, strict=True):
        label = f"{folder.name}, whole run" if len(subject.runs) > 1 else "whole run, with scoring"
        rows.append([label, f"{run.provenance.seconds:.2f}", None, None])
    return table(["estimate", "seconds", "iterations", "share"], rows)


def _share_bar(result: Result, results: Sequence[Result]) -> Html:
    share = result.estimate.seconds / sum(r.estimate.seconds for r in results)
    return tag("meter", value=f"{share:.3f}", min="0", max="1", aria_label=f"{share:.0%}")
