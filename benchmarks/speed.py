"""Time and memory of o3dls beside other methods, each with the error and the sentence it ended with: python
-m benchmarks.speed

The case is made afresh (data_synth's atrium, --seed); kernels are warm, files excluded, one thread of linear
algebra as on the command line. The part `points` has real surfaces too where O3DLS_DATA names their folder;
its error is the mean of both directions between surface and truth. Every time is the median of --repeat runs,
by the clock and, beside it, of the processor: on a machine that does other work the clock is an upper bound.
The part `cores` tells how much its cores do together.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import Any

from benchmarks import speed_cli, speed_points

Row = dict[str, Any]
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
HEAD = f"{'what':30}{'value':>9}    {'processor':>9}    {'asked':>10}  {'error':>8}  status"
FACES = 30_000
FLOATING = 0.8  # from the middle of the chamber to the wall: some 6 mm off it
LIMITS = {  # what is asked for
    "motion": (0.5, "s"),
    "everything": (1.5, "s"),
    "memory": (700.0, "MB"),
    "band 128^3": (0.2, "s"),
    "halving": (4.5, "x"),
    "halving, cross 1000": (4.5, "x"),
    "20 000 points": (6.0, "s"),
    "one more point": (0.03, "s"),
    "one more point, off": (0.05, "mm"),
    "the same floating inside, off": (0.05, "mm"),
    **speed_points.limits(),
    **speed_cli.LIMITS,
}


@dataclass(frozen=True)
class Time:
    """Median seconds of some calls, by the clock and of the processor: the second does not mind what else the
    machine does.
    """

    clock: float
    cpu: float

    def __add__(self, other: Time) -> Time:
        return Time(self.clock + other.clock, self.cpu + other.cpu)


def timed(action: Callable[[], Any], repeat: int) -> tuple[Time, Any]:
    """Median time of a call, after one that warms caches and compilers; and what it gave."""
    result = action()
    clock = []
    cpu = []
    for _ in range(repeat):
        begin, began = perf_counter(), process_time()
        result = action()
        clock.append(perf_counter() - begin)
        cpu.append(process_time() - began)
    return Time(median(clock), median(cpu)), result


def problem(seed: int, points: int = 250) -> tuple[Any, Any]:
    """A fresh atrium with `points` fitted points whose prior has about FACES faces, and its start."""
    from data_synth.atrium import atrium
    from o3dls.pipeline.start import start_estimate

    case = atrium(seed, points=points)
    case = replace(case, prior=refined(case.prior, FACES))
    return case, start_estimate(case.visible())


def refined(prior: Any, faces: int) -> Any:
    """The prior with about so many faces, by splitting every face in four and decimating."""
    import numpy as np
    import open3d as o3d

    from o3dls.geometry.surface import Surface

    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(prior.vertices), o3d.utility.Vector3iVector(prior.faces.astype(np.int32))
    )
    while len(mesh.triangles) < faces:
        mesh = mesh.subdivide_midpoint(1)
    mesh = mesh.simplify_quadric_decimation(faces)
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.triangles))


def error(case: Any, surface: Any) -> float:
    from o3dls.evaluation.distances import distances

    return float(distances(case.truth.held_out, surface).mean())


def engine(seed: int, repeat: int) -> list[Row]:
    """Alignment and motion; then with the level set; both with held-out error and status."""
    from o3dls.stages.deform import Deform
    from o3dls.stages.icp import ICP
    from o3dls.stages.level_set import LevelSet
    from o3dls.stages.topology import Topology

    case, start = problem(seed)
    shown = case.visible()
    rows = []
    total = Time(0.0, 0.0)
    at = start
    for stage in (ICP(), Deform(), Topology(), LevelSet()):
        seconds, at = timed(lambda stage=stage, at=at: stage(shown, at), repeat)  # type: ignore[misc]
        total = total + seconds
        rows.append(_row(f"stage {stage.name}", seconds, case, at.surface, at.status))
        if stage.name == "deform":
            rows.append(_row("motion", total, case, at.surface, "alignment, motion field and posterior"))
    rows.append(
        _row("everything", total, case, at.surface, "with level set at 1 mm, isosurface and clean-up")
    )
    return rows


def _row(what: str, seconds: Time, case: Any, surface: Any, status: str) -> Row:
    return {
        "what": what,
        "value": seconds.clock,
        "cpu": seconds.cpu,
        "unit": "s",
        "held_out_mm": error(case, surface),
        "status": status,
    }


def halving(seed: int, repeat: int) -> list[Row]:
    """The level set stage at 1 and at 0.5 mm, on the phantom and, where O3DLS_DATA is set, on a crossed pair
    whose wall is reconstructed from 1000 points; and the bare signed distance on 128^3 nodes.
    """
    from o3dls.levelset.grid.distance import signed_distance
    from o3dls.pipeline.start import start_estimate

    case, start = problem(seed)
    row, moved = _halved("halving", case, start, repeat)
    rows = [row]
    data = os.environ.get("O3DLS_DATA")
    if data:
        pair = speed_points.pair(1000, Path(data), speed_points.RECONSTRUCTED)
        rows.append(_halved("halving, cross 1000", pair, start_estimate(pair.visible()), repeat)[0])
    v, f = moved.surface.vertices, moved.surface.faces
    # with the pad about 128 nodes along the longest side
    spacing = float((v.max(axis=0) - v.min(axis=0)).max()) / 120.0
    seconds, field = timed(lambda: signed_distance(v, f, spacing, 3.0 * spacing), repeat)
    shape = "x".join(map(str, field.band.shape))
    status = f"{len(field.band)} band nodes of {shape}"
    return [
        *rows,
        {"what": "band 128^3", "value": seconds.clock, "cpu": seconds.cpu, "unit": "s", "status": status},
    ]


def _halved(what: str, case: Any, start: Any, repeat: int) -> tuple[Row, Any]:
    """By how much longer the level set stage takes at half the spacing; and what it starts from."""
    from benchmarks.peers import cost
    from o3dls.stages.deform import Deform
    from o3dls.stages.icp import ICP
    from o3dls.stages.landmarks import Landmarks
    from o3dls.stages.level_set import LevelSet
    from o3dls.stages.topology import Topology

    shown = case.visible()
    posed = Landmarks()(shown, start) if (shown.points.type == "landmark").any() else start
    moved = Topology()(shown, Deform()(shown, ICP()(shown, posed)))
    coarse, fine = (timed(lambda h=h: LevelSet(spacing=h)(shown, moved), repeat) for h in (1.0, 0.5))  # type: ignore[misc]
    row = {
        "what": what,
        "value": fine[0].clock / coarse[0].clock,
        "cpu": fine[0].cpu / coarse[0].cpu,
        "unit": "x",
        "error_mm": cost(case, fine[1].surface),
        "status": fine[1].status,
    }
    return row, moved


def many(seed: int, repeat: int) -> list[Row]:
    """Alignment, motion and level set with 20 000 points."""
    from o3dls.stages.deform import Deform
    from o3dls.stages.icp import ICP
    from o3dls.stages.level_set import LevelSet
    from o3dls.stages.topology import Topology

    case, start = problem(seed, points=20_000)
    shown = case.visible()
    seconds, found = timed(
        lambda: LevelSet()(shown, Topology()(shown, Deform()(shown, ICP()(shown, start)))),
        max(1, repeat // 3),
    )
    return [_row("20 000 points", seconds, case, found.surface, found.status)]


def one_more(seed: int, repeat: int) -> list[Row]:
    """A warm start with one more point against a fit from nothing with all of them."""
    import numpy as np

    from o3dls.motion.fit import fit_motion
    from o3dls.motion.result import sentence
    from o3dls.stages.deform import Deform
    from o3dls.stages.deform_data import observed
    from o3dls.stages.icp import ICP

    case, start = problem(seed)
    pose = ICP()(case.visible(), start).T_map_prior
    stage = Deform()
    data = observed(case.visible(), stage)
    first = data.at(slice(-1))
    v, f = case.prior.vertices, case.prior.faces
    before = fit_motion(v, f, pose, first, stage.settings())
    seconds, warm = timed(lambda: fit_motion(v, f, pose, data, stage.settings(), warm=before), repeat)
    rows = [
        _row("one more point", seconds, case, case.prior.with_vertices(warm.vertices), sentence(warm, "mm"))
    ]
    centre = warm.vertices.mean(axis=0)
    floating = data.points.copy()
    floating[-1] = centre + FLOATING * (floating[-1] - centre)
    said = {"unit": "mm", "status": "from a fit from nothing, mean over vertices"}
    for what, points in (("one more point, off", data.points), ("the same floating inside, off", floating)):
        shown = replace(data, points=points)
        two = [
            fit_motion(v, f, pose, shown, stage.settings(), warm=known).vertices for known in (before, None)
        ]
        rows.append({"what": what, "value": float(np.linalg.norm(two[0] - two[1], axis=1).mean()), **said})
    return rows


def memory(seed: int, repeat: int) -> list[Row]:
    """Peak resident memory of this process, which has run nothing but the whole pipeline once."""
    import resource

    from o3dls.stages.deform import Deform
    from o3dls.stages.icp import ICP
    from o3dls.stages.level_set import LevelSet
    from o3dls.stages.topology import Topology

    case, start = problem(seed)
    shown = case.visible()
    found = LevelSet()(shown, Topology()(shown, Deform()(shown, ICP()(shown, start))))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (
        1024.0**2 if sys.platform == "darwin" else 1024.0
    )
    return [
        {
            "what": "memory",
            "value": peak,
            "unit": "MB",
            "held_out_mm": error(case, found.surface),
            "status": "peak resident, imports included",
        }
    ]


def peers(seed: int, repeat: int) -> list[Row]:
    """The other methods as tuned for the group `la`, after the same alignment."""
    from benchmarks.peers import PEERS, pose_of, tuned

    case, _ = problem(seed)
    pose = pose_of(case)
    rows = []
    for name, setting in tuned().get("la", {}).items():
        seconds, surface = timed(
            lambda n=name, s=setting: PEERS[n](case.visible(), pose, **s["parameters"]), max(1, repeat // 3)
        )  # type: ignore[misc]
        rows.append(_row(f"peer {name}", seconds, case, surface, "without the alignment it starts from"))
    return rows


def points(seed: int, repeat: int) -> list[Row]:
    """All stages with 250 to 20 000 points, on the phantom and, where O3DLS_DATA is set, on real surfaces."""
    data = os.environ.get("O3DLS_DATA")
    return list(speed_points.rows(seed, max(1, repeat // 3), Path(data) if data else None, timed))


def cores(_: int, repeat: int) -> list[Row]:
    """How much more as many processes as cores do at one time than one alone: cores that are shared with
    other work, or with each other, do less than their number.
    """
    count = os.cpu_count() or 1
    loop = [sys.executable, "-c", "sum(k * k for k in range(10_000_000))"]

    def together(processes: int) -> None:
        for process in [subprocess.Popen(loop) for _ in range(processes)]:
            process.wait()

    one, every = (timed(lambda n=n: together(n), repeat)[0].clock for n in (1, count))  # type: ignore[misc]
    status = f"work of {count} processes at one time, over that of one; the limits are for two quiet cores"
    return [{"what": "cores", "value": count * one / every, "unit": "x", "status": status}]


PARTS: dict[str, Callable[[int, int], list[Row]]] = {
    "cores": cores,
    "engine": engine,
    "halving": halving,
    "many": many,
    "one_more": one_more,
    "memory": memory,
    "peers": peers,
    "points": points,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=2401, help="of the synthetic atrium")
    parser.add_argument("--repeat", type=int, default=5, help="runs of which the median counts")
    parser.add_argument("--part", choices=PARTS, action="append", help="only these; default: all")
    parser.add_argument("--json", action="store_true", help="one JSON line per measurement and nothing else")
    parser.add_argument("--cli", action="store_true", help="o3dls run on the demo case: first, later, parts")
    arguments = parser.parse_args()
    if arguments.cli:
        print(HEAD)
        for row in speed_cli.rows(arguments.repeat):
            print(_line(row))
        return
    if arguments.json and arguments.part and len(arguments.part) == 1:
        _say(PARTS[arguments.part[0]](arguments.seed, arguments.repeat))
        return
    print(HEAD)
    for part in arguments.part or PARTS:  # each in a process of its own: memory and caches do not mix
        for row in _apart(part, arguments.seed, arguments.repeat):
            print(_line(row), flush=True)


def _apart(part: str, seed: int, repeat: int) -> list[Row]:
    command = [
        sys.executable,
        "-m",
        "benchmarks.speed",
        "--json",
        "--part",
        part,
        "--seed",
        str(seed),
        "--repeat",
        str(repeat),
    ]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env=os.environ | dict.fromkeys(THREADS, "1")
    )
    if done.returncode:
        return [
            {
                "what": part,
                "value": float("nan"),
                "unit": "",
                "status": f"failed: {done.stderr.strip().splitlines()[-1]}",
            }
        ]
    # libraries say things there too
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def _say(rows: list[Row]) -> None:
    for row in rows:
        print(json.dumps(row))


def _line(row: Row) -> str:
    limit = LIMITS.get(row["what"])
    asked = f"<= {limit[0]:g} {limit[1]}" if limit else ""
    error = row.get("held_out_mm", row.get("error_mm"))
    held_out = "" if error is None else f"{error:.3f} mm"
    cpu = f"{row['cpu']:.3f}" if "cpu" in row else ""
    return (
        f"{row['what']:30}{row['value']:>9.3f} {row['unit']:2} {cpu:>9}    {asked:>10}  {held_out:>8} "
        f" {row['status']}"
    )


if __name__ == "__main__":
    main()
