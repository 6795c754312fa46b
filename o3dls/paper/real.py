"""The paper's table on data of others.

An MRI atrium against an EAM shell, a ventricle in two phases, an atrium moved by others.
"""

from __future__ import annotations

from pathlib import Path

from ..io.case_reader import read_case
from ..pipeline.pipeline import Pipeline
from ..stages.deform import Deform
from ..stages.icp import ICP
from ..stages.landmarks import Landmarks
from ..stages.level_set import LevelSet
from ..stages.topology import Topology
from .atrium import SHOWN
from .blocks import Block, Heading, Table, Text
from .drawing import NAMES
from .experiment import Outcome, Scope, Task, mean_sd, score
from .results import Results, column

CASES = {
    "real/kit_mri_to_eam": "MRI atrium to EAM shell",
    "real/lv_ed_to_es": "ventricle, end diastole to end systole",
    "sim/vampy_moving_la": "atrium moved by others",
}


def _find_cases(scope: Scope) -> list[str]:
    return [name for name in CASES if scope.data is not None and (scope.data / name).is_dir()]


def left_out(scope: Scope) -> dict[str, str]:
    return {name: f"no folder {name} in O3DLS_DATA" for name in CASES if name not in _find_cases(scope)}


def tasks(scope: Scope) -> list[Task]:
    return [
        Task("real", name, fit, (name, str(scope.data / name)))
        for name in _find_cases(scope)[: 1 if scope.quick else None]
        if scope.data
    ]


def fit(name: str, folder: str) -> Outcome:
    """Fit one case; without landmarks the ICPs start from its rough pose."""
    case = read_case(Path(folder))
    start = [Landmarks()] if Landmarks().obstacle(case) is None else []
    first = start[0].estimate_name if start else "start"
    plan = Pipeline(
        [
            *start,
            ICP(preset="standard"),
            ICP(as_="similarity", after=first),
            Deform(),
            Topology(),
            LevelSet(),
        ],
        folds=0,
    )
    estimates = plan.fit(case)
    return Outcome([{"case": name} | score(case, plan, estimates, method) for method in SHOWN])


def blocks(results: Results) -> list[Block]:
    rows = results.of("real")
    keys = {
        "fitted": "fitted, mm",
        "ablation": "ablation, not fitted",
        "truth_to_surface": "truth to surface",
        "truth_to_surface_p95": "its 95 %",
        "surface_to_truth": "surface to truth",
        "components": "pieces",
        "self_intersections": "self-cuts",
        "seconds": "s",
    }
    lines = []
    for name, words in CASES.items():
        for method in SHOWN:
            own = [row for row in rows if row["case"] == name and row["method"] == method]
            if own:
                lines.append([f"{words}, {NAMES[method]}", *(mean_sd(column(own, key)) for key in keys)])
    missing = [f"{name}: {why}" for name, why in results.left_out.items() if name in CASES]
    found: list[Block] = [Heading("The same table on data of others")]
    found += [Table("Mean distance", ["case, method", *keys.values()], lines)] if lines else []
    return [*found, Text("Left out: " + "; ".join(missing) + ".")] if missing else found
