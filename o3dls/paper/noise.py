"""Star and jar under growing noise (the paper's figures 1 to 4)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import data_synth

from ..arrays import Array
from ..evaluation.distances import distances
from ..geometry.surface import Surface
from ..pipeline.pipeline import Pipeline
from ..report.drawing.fields import Field
from ..stages.deform import Deform
from ..stages.icp import ICP
from ..stages.level_set import LevelSet
from ..stages.topology import Topology
from .blocks import Block, Figure, Heading, Table, Text
from .drawing import NAMES, curves, outlines, rendered
from .experiment import Outcome, Row, Scope, Task, mean_sd, score, truth_of, with_truth_distance
from .results import Results, column

GENERATORS = {"star": data_synth.star, "jar": data_synth.jar}
LEVELS = {"star": (2.0, 6.0, 10.0), "jar": (3.0, 6.0, 9.0, 12.0)}  # percent of the points' standard deviation
SHOWN = ("icp", "similarity", "level_set")
MADE = {
    "star": (
        "200 x 200 px, 33 points; the template is bent by 8 px over 80 px, and shaken by 2 px over 12 px; "
        "in the plane nothing is reconstructed: φ is the signed distance of the moved template"
    ),
    "jar": (
        "60 x 60 x 80 mm, 282 points; the template is bent by 2 mm over 60 mm, and shaken by 0.3 mm over 8 mm"
    ),
}
# The star's template is bent, which is known beforehand, over most of its size: 33 points can tell that from
# noise, and nothing finer. The jar needs no such help.
ASKED: Mapping[str, dict[str, Any]] = {"star": {"vector": (1.6,), "normal": ()}, "jar": {}}


def pipeline(shape: str) -> Pipeline:
    """Make the pipeline of the baseline, the best similarity, and ours; none profits from another."""
    return Pipeline(
        [
            ICP(preset="standard"),
            ICP(as_="similarity", after="start"),
            Deform(**ASKED[shape]),
            Topology(),
            LevelSet(),
        ],
        folds=0,
    )


def tasks(scope: Scope) -> list[Task]:
    found = []
    for shape, levels in LEVELS.items():
        for percent in levels if not scope.quick or shape == "star" else levels[1:2]:
            found += [
                Task(
                    shape,
                    f"{shape}, {percent:g} %, seed {seed}",
                    fit,
                    (shape, percent, seed, seed == scope.seeds(1)[0]),
                )
                for seed in scope.seeds(20, 2 if shape == "star" else 1)
            ]
    return found


def fit(shape: str, percent: float, seed: int, drawn: bool) -> Outcome:
    """Fit one seed at one level; `drawn` keeps the shapes for the figure."""
    case = GENERATORS[shape](seed, percent=percent)
    truth, plan = truth_of(case), pipeline(shape)
    estimates = plan.fit(case)
    floor = float(distances(case.points.xyz, truth).mean())
    known = {
        "percent": percent,
        "seed": seed,
        "noise": _noise_per_axis(case.points.xyz, percent),
        "floor": floor,
    }
    rows = [known | score(case, plan, estimates, name) for name in SHOWN]
    if not drawn:
        return Outcome(rows)
    shapes = {name: with_truth_distance(estimates[name].surface, truth) for name in ("start", *SHOWN)}
    every: dict[str, Surface | Array] = {**shapes, "truth": truth, "points": case.points.xyz}
    return Outcome(rows, {f"{percent:g}/{name}": found for name, found in every.items()})


def _noise_per_axis(points: Array, percent: float) -> float:
    """Return the noise per axis, from the spread of the noisy points."""
    share = percent / 100.0
    return share * float(np.sqrt(points.var(axis=0).mean() / (1.0 + share**2)))


def left_out(scope: Scope) -> dict[str, str]:
    return {}


def blocks(results: Results) -> list[Block]:
    found: list[Block] = []
    for shape, title in (
        ("star", "Star in the plane (figures 1 and 2 of the paper)"),
        ("jar", "Jar (figures 3 and 4)"),
    ):
        rows = results.of(shape)
        found += [
            Heading(title),
            Text(_describe_shape(shape, rows)),
            _draw_pictures(results, shape),
            _draw_curves(shape, rows),
            _make_table(shape, rows),
        ]
    return found


def _describe_shape(shape: str, rows: list[Row]) -> str:
    return (
        f"{MADE[shape]}; {len({row['seed'] for row in rows})} seeds, on which nothing was chosen. "
        f"Ours: `icp`, `deform`{_list_settings(shape)}, `topology`, `level_set`. "
        "Fitted: distance of the points used in the fit. "
        "Held out: distance of points of the truth that were not used."
    )


def _list_settings(shape: str) -> str:
    words = ", ".join(
        f"{name} = {list(value) if isinstance(value, tuple) else value}"
        for name, value in ASKED[shape].items()
    )
    return f" ({words})" if words else " (defaults)"


def _by_level(rows: list[Row], key: str) -> dict[float, Array]:
    return {
        level: column([row for row in rows if row["percent"] == level], key)
        for level in sorted({row["percent"] for row in rows})
    }


def _draw_curves(shape: str, rows: list[Row]) -> Figure:
    methods = {method: [row for row in rows if row["method"] == method] for method in SHOWN}
    sets = {"fitted": "fitted points", "held_out": "held out"}
    panels = {title: {m: _by_level(own, key) for m, own in methods.items()} for key, title in sets.items()}
    unit = rows[0]["unit"]
    floor = {"truth on fitted points": _by_level(rows, "floor")}
    drawn = curves(panels, "noise, % of the points' standard deviation", f"mean distance, {unit}", floor)
    return Figure(
        f"{shape}_distance",
        f"{shape.capitalize()}: mean distance and its standard deviation over seeds against noise. The "
        "dashed line is what the truth itself would score on the fitted points: a method below it fits "
        "noise.",
        drawn,
    )


def _make_table(shape: str, rows: list[Row]) -> Table:
    unit = rows[0]["unit"]
    head = [
        "noise, method",
        f"fitted, {unit}",
        f"held out, {unit}",
        "worst held out / ICP",
        "fitted / truth's own, least",
    ]
    head += ["pieces, most", "self-cuts, most", "s"]
    lines = []
    for level in sorted({row["percent"] for row in rows}):
        base = column([r for r in rows if r["percent"] == level and r["method"] == "icp"], "held_out")
        for method in SHOWN:
            own = [row for row in rows if row["percent"] == level and row["method"] == method]
            held = column(own, "held_out")
            lines.append(
                [
                    f"{level:g} %, {NAMES[method]}",
                    mean_sd(column(own, "fitted")),
                    mean_sd(held),
                    f"{(held / base).max():.2f}",
                    f"{(column(own, 'fitted') / column(own, 'floor')).min():.2f}",
                    f"{column(own, 'components').max():.0f}",
                    f"{column(own, 'self_intersections').max():.0f}",
                    f"{column(own, 'seconds').mean():.1f}",
                ]
            )
    return Table(f"{shape.capitalize()}: mean ± standard deviation over seeds", head, lines)


def _draw_pictures(results: Results, shape: str) -> Figure:
    levels = sorted({row["percent"] for row in results.of(shape)})
    if shape == "star":
        return Figure(
            "star",
            "Star: truth (grey), template and results in colour, points in black.",
            _draw_stars(results, levels),
        )
    return Figure(
        "jar",
        "Jar: distance to the true surface, one colour scale for all; points in black.",
        _draw_jars(results, levels),
    )


def _draw_stars(results: Results, levels: list[float]) -> bytes:
    def panel(method: str, level: float) -> tuple[str, dict[str, Surface], Array]:
        shapes = {name: results.shape(f"star/{level:g}/{name}") for name in ("truth", method)}
        return f"{level:g} %, {NAMES[method]}", shapes, results.array(f"star/{level:g}/points")

    return outlines(
        [panel(method, level) for method in ("start", "icp", "level_set") for level in levels], len(levels)
    )


def _draw_jars(results: Results, levels: list[float]) -> bytes:
    scale = Field("distance_to_truth", "distance to the true surface", "mm", "sequential", 0.0, 5.0)

    def panel(method: str, level: float) -> tuple[str, Surface, Array]:
        return (
            f"{level:g} %, {NAMES[method]}",
            results.shape(f"jar/{level:g}/{method}"),
            results.array(f"jar/{level:g}/points"),
        )

    panels = [[panel(method, level) for level in levels] for method in ("start", "icp", "level_set")]
    return rendered(panels, np.array([[0.8, -0.6, 0.0], [0.2, 0.27, 0.94], [-0.56, -0.75, 0.34]]), scale)
