"""The paper's future work, first step: a template of several phases against one static template, on phases
that were left out.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..case import Case, Points, Truth
from ..evaluation.distances import sample
from ..geometry.surface import Surface
from ..io.surfaces import read_surface
from ..io.table import read_table
from ..pipeline.pipeline import Pipeline
from ..report.drawing.fields import Field
from ..stages.deform import Deform
from ..stages.level_set import LevelSet
from ..stages.phases import Phases
from ..stages.topology import Topology
from .blocks import Block, Figure, Heading, Table, Text
from .drawing import NAMES, curves, rendered
from .experiment import Outcome, Row, Scope, Task, mean_sd, score, with_truth_distance
from .results import Results, column

FOLDER = "real/lv_phases"
COUNT = 20
NOISE = 1.5
POSE_SD = 0.5  # mm: all phases and points are in one scanner frame
MAPS = {"dense": (250, 0.0), "sparse": (100, 25.0)}  # points, and radius (mm) of an area without any
SHOWN = ("static", "phases")
NEAR = 3.5  # mm from a contour point: the flat end caps carry none and are left out


def left_out(scope: Scope) -> dict[str, str]:
    return {} if _has_data(scope) else {"temporal": f"no folder {FOLDER} in O3DLS_DATA"}


def _has_data(scope: Scope) -> bool:
    return scope.data is not None and (scope.data / FOLDER).is_dir()


def tasks(scope: Scope) -> list[Task]:
    if scope.data is None or not _has_data(scope):
        return []
    folder = str(scope.data / FOLDER)
    phases = range(1, COUNT, 2) if not scope.quick else (9,)
    return [
        Task(
            "temporal",
            (f"temporal template, {kind} map of phase {phase}"),
            fit,
            (folder, phase, kind, phase == 9),
        )
        for kind in MAPS
        for phase in phases
    ]


def fit(folder: str, phase: int, kind: str, drawn: bool) -> Outcome:
    """Fit with one phase left out: even phases are known, the odd one is measured."""
    known = [read_surface(f"{folder}/phase_{k:02d}.ply") for k in range(0, COUNT, 2)]
    wanted = read_surface(f"{folder}/phase_{phase:02d}.ply")
    measured, held_out = _sample_points(wanted, _read_contour(folder, phase), phase, *MAPS[kind])
    points = Points(measured, np.repeat(["eam"], len(measured)))
    case = Case(
        f"lv_{phase:02d}",
        known[0],
        points,
        init=np.eye(4),
        truth=Truth(held_out=held_out),
        phases=tuple(known[1:]),
    )
    stages = [
        Deform(as_="moved"),
        Topology(as_="topology_static"),
        LevelSet(as_="static"),
        Phases(as_="placed", after="start", pose_sd=POSE_SD),
        Topology(as_="topology_phases"),
        LevelSet(as_="phases"),
    ]
    plan = Pipeline(stages, folds=0)
    estimates = plan.fit(case)
    place = 2.0 * float(estimates["placed"].facts["phase"])
    rows = [
        {"map": kind, "phase": phase, "found_phase": place} | score(case, plan, estimates, name)
        for name in SHOWN
    ]
    if not drawn:
        return Outcome(rows)
    shapes = {f"{kind}/{name}": with_truth_distance(estimates[name].surface, wanted) for name in SHOWN}
    return Outcome(rows, {**shapes, f"{kind}/points": measured})


def _read_contour(folder: str, phase: int) -> Array:
    table = read_table(f"{folder}/contour_{phase:02d}.csv", ("x", "y", "z"))
    return np.column_stack([table.numbers(axis) for axis in "xyz"])


def _sample_points(
    surface: Surface, contour: Array, seed: int, count: int, blind: float
) -> tuple[Array, Array]:
    """Sample noisy points away from a blind area about one of them, and held-out points everywhere but on the
    caps.
    """
    from scipy.spatial import cKDTree

    wall = sample(surface)
    wall = wall[cKDTree(contour).query(wall)[0] < NEAR]
    rng = np.random.default_rng((seed, 4409))
    wall = wall[rng.permutation(len(wall))]
    held_out = wall[:4000]
    rest = wall[4000:]
    seen = rest[np.linalg.norm(rest - rest[0], axis=1) > blind][:count] if blind else rest[:count]
    return seen + NOISE * rng.normal(size=seen.shape), held_out


def gain(rows: list[Row]) -> float:
    """Return the share by which the temporal template lowers the mean held-out error."""
    static, ours = (column([row for row in rows if row["method"] == m], "held_out").mean() for m in SHOWN)
    return float(1.0 - ours / static)


def blocks(results: Results) -> list[Block]:
    rows = results.of("temporal")
    found: list[Block] = [Heading("Temporal template (the paper's future work)")]
    if not rows:
        return [*found, Text(f"Left out: {results.left_out.get('temporal', 'not computed')}.")]
    words = (
        "A ventricle in 20 phases of cine MRI. Even phases are known; each odd phase is mapped (noise "
        "1.5 mm) and reconstructed from the "
        "static template (phase 0) and from the temporal one (stage `phases`), both from the same pose. "
        "Dense maps have 250 points; sparse "
        "ones 100, with a blind area of 25 mm. Held-out error falls by "
        f"{100 * gain(results.of('temporal', map='dense')):.0f} % on dense "
        f"and {100 * gain(results.of('temporal', map='sparse')):.0f} % on sparse maps."
    )
    lines = []
    for kind in MAPS:
        for method in SHOWN:
            own = [row for row in rows if row["map"] == kind and row["method"] == method]
            off = np.abs((column(own, "found_phase") - column(own, "phase") + COUNT / 2) % COUNT - COUNT / 2)
            where = f"{off.mean():.1f}" if method == "phases" else "–"
            values = [mean_sd(column(own, key)) for key in ("fitted", "held_out", "held_out_p95")]
            lines.append([f"{kind}, {NAMES[method]}", *values, where, mean_sd(column(own, "seconds"), 1)])
    head = ["map, template", "fitted, mm", "held out, mm", "its 95 %", "phase missed by", "s"]
    panels = {
        f"{kind} map": {
            m: {
                row["phase"]: np.array([row["held_out"]])
                for row in results.of("temporal", map=kind, method=m)
            }
            for m in SHOWN
        }
        for kind in MAPS
    }
    chart = curves(panels, "phase that was left out", "held-out distance, mm")
    return [
        *found,
        Text(words),
        Table("Left-out phases: mean ± standard deviation", head, lines),
        Figure("temporal_distance", "Temporal template: held-out error by phase.", chart),
        Figure(
            "temporal",
            "Phase 9 from a sparse map: distance to the phase as imaged, one colour scale.",
            _draw_pictures(results),
        ),
    ]


def _draw_pictures(results: Results) -> bytes:
    scale = Field("distance_to_truth", "distance to the left-out phase", "mm", "sequential", 0.0, 4.0)
    points = results.array("temporal/sparse/points")
    panel = [(NAMES[m], results.shape(f"temporal/sparse/{m}"), points) for m in SHOWN]
    return rendered([panel], np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]), scale)
