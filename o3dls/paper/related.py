"""Systems that the paper relates to: surfaces from points alone, with few points and with enough of them."""

from __future__ import annotations

import time
from collections.abc import Callable

from data_synth import atrium as synthetic_atrium

from ..errors import InputError
from ..evaluation.distances import distances, sample
from ..geometry.surface import Surface
from ..pipeline.pipeline import Pipeline
from ..report.drawing.figures import plain_figure, png
from ..report.palette import LIGHT, places
from ..stages.deform import Deform
from ..stages.icp import ICP
from ..stages.landmarks import Landmarks
from ..stages.level_set import LevelSet
from ..stages.topology import Topology
from .blocks import Block, Figure, Heading, Table, Text
from .experiment import Outcome, Row, Scope, Task, judged, mean_sd, truth_of
from .reconstruction import alpha_shape, minimal_surface, poisson, tangent_planes
from .results import Results, column

COUNTS = (250, 1000, 4000, 16000)
NOISE = 0.5
LENGTHS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # ticks, mm
METHODS = {
    "hoppe": ("tangent planes (Hoppe)"),
    "zhao": ("weighted minimal surface (Zhao)"),
    "poisson": "Poisson",
    "alpha_shape": "alpha shape",
    "similarity": "prior by similarity ICP alone",
    "level_set": "level set with prior (ours)",
}
MARKERS = {"level_set": "o", "similarity": "x", "hoppe": "^", "zhao": "v", "poisson": "s", "alpha_shape": "D"}
COLOURS = dict(zip(MARKERS, (LIGHT[k] for k in places(list(MARKERS))), strict=True))


def tasks(scope: Scope) -> list[Task]:
    counts = COUNTS if not scope.quick else COUNTS[:1]
    return [
        Task("related", f"related systems, {n} points, seed {seed}", fit, (seed, n))
        for n in counts
        for seed in scope.seeds(2)
    ]


def left_out(scope: Scope) -> dict[str, str]:
    return {}


def fit(seed: int, count: int) -> Outcome:
    """Fit all systems to one atrium, seen everywhere, without outliers: as kind to them as can be."""
    case = synthetic_atrium(seed, points=count, noise=NOISE, outliers=0.0, unseen=0.0)
    points = case.points.of("eam").xyz
    truth = truth_of(case)
    start = Pipeline([Landmarks(), ICP()], folds=0)
    plan = Pipeline([*start.stages, Deform(), Topology(), LevelSet()], folds=0)
    makers: dict[str, Callable[[], Surface]] = {
        "hoppe": lambda: tangent_planes(points),
        "zhao": lambda: minimal_surface(points),
        "poisson": lambda: poisson(points),
        "alpha_shape": lambda: alpha_shape(points),
        "similarity": lambda: start.fit(case)["icp"].surface,
        "level_set": lambda: plan.fit(case)["level_set"].surface,
    }
    rows = [
        {"seed": seed, "points": count, "method": name} | _score_method(make, truth)
        for name, make in makers.items()
    ]
    return Outcome(rows)


def _score_method(make: Callable[[], Surface], truth: Surface) -> Row:
    """Measure the errors both ways; a system that finds no surface says so."""
    began = time.perf_counter()
    try:
        surface = make()
    except InputError as error:
        return {"failed": str(error)}
    seconds = time.perf_counter() - began
    there, back = distances(sample(truth), surface).mean(), distances(sample(surface), truth).mean()
    return {"truth_to_surface": float(there), "assd": float(there + back) / 2.0, "seconds": seconds} | judged(
        surface
    )


def blocks(results: Results) -> list[Block]:
    rows = results.of("related")
    counts = sorted({row["points"] for row in rows})
    lines = []
    for name, words in METHODS.items():
        for n in counts:
            own = [row for row in rows if row["method"] == name and row["points"] == n]
            lines.append(
                [
                    f"{words}, {n}",
                    *(
                        mean_sd(column(own, key))
                        for key in ("truth_to_surface", "assd", "components", "seconds")
                    ),
                ]
            )
    return [
        Heading("Related systems: surfaces from points alone"),
        Text(
            f"The same atria with {', '.join(map(str, counts))} points seen everywhere, noise {NOISE:g} "
            "mm, no outliers: as kind "
            "to systems without a prior as can be. With an EAM's 250 points they lose or invent veins "
            "and are no better than "
            "the prior in its best pose; with enough points they work, and pass it."
        ),
        Figure(
            "related",
            "Surfaces from points alone: error both ways against the number of points.",
            _draw_curves(rows, counts),
        ),
        Table(
            "Mean ± standard deviation over seeds, mm",
            ["system, points", "truth to surface", "both ways", "pieces", "s"],
            lines,
        ),
    ]


def _draw_curves(rows: list[Row], counts: list[int]) -> bytes:
    with plain_figure(7.2, 3.4) as figure:
        ax = figure.subplots()
        for name, words in METHODS.items():
            values = [
                column([row for row in rows if row["method"] == name and row["points"] == n], "assd")
                for n in counts
            ]
            drawn = [(n, v.mean(), v.std()) for n, v in zip(counts, values, strict=True) if len(v)]
            if drawn:
                at, mean, sd = zip(*drawn, strict=True)
                look, mark = COLOURS[name], MARKERS[name]
                ax.errorbar(at, mean, sd, color=look, marker=mark, capsize=3, label=words)
        ax.set(xscale="log", yscale="log", xlabel="points", ylabel="mean distance both ways, mm")
        ax.set_xticks(counts, [str(n) for n in counts])
        ax.set_yticks(LENGTHS, [f"{length:g}" for length in LENGTHS])
        ax.minorticks_off()
        ax.grid(alpha=0.25)
        ax.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0))
        figure.tight_layout()
        return png(figure)
