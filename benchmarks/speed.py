"""Time and memory of o3dls beside other methods, each with the error and the sentence it ended with: python
-m benchmarks.speed

The case is made afresh (data_synth's atrium, --seed); kernels are warm, files excluded, one thread of linear
algebra as on the command line. The part `points` has real surfaces too where O3DLS_DATA names their folder;
its error is the mean of both directions between surface and truth. Every time is the median of --repeat runs,
by the clock and, beside it, of the processor: on a machine that does other work the clock is an upper bound.
The part `cores` tells how much its cores do together, and `files` alone writes and reads a surface of 200 000
vertices in every format.

With --cli it is where the time of `o3dls run` on the demo case goes: a first run, whose loops are compiled,
later ones, and the parts of one.

With --page it is size and start of a page. That of a run reports itself when it is ready, in ms since it was
asked for; without a run the demo is made afresh. Another page, such as the cohort.html of a thousand cases,
is ready when its scripts have run and it is laid out and drawn. On a machine that does other work that is an
upper bound, and the least of some visits comes nearest. WebGL is drawn by software, as on a machine without
a graphics card.

With --cohort it is a cohort on two workers of dask beside the same on one, begin and end included: the demo's
atrium with other seeds, the default pipeline, one thread a worker. What the engine takes is what one worker
needs from its first outcome to its last beyond a plain loop over the same cases.

With --readers it is what readers of surfaces make of damaged files: our own, Open3D and VTK, each file in a
process of its own. The files are whole ones of Open3D and VTK, of which a third is cut off, in a third one to
four bytes anywhere are others, in a third some of the first 400. A file counts as read wrong where what comes
back has another number of vertices or triangles, a corner that is not there or a place that is not finite;
other coordinates are not counted, as no reader can know them. Nothing back, or an error, counts as refused.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any

from o3dls.resources import demo_case, pipeline_file

Row = dict[str, Any]
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
HEAD = f"{'what':30}{'value':>9}    {'processor':>9}    {'asked':>10}  {'error':>8}  status"
FACES = 30_000
FLOATING = 0.8  # from the middle of the chamber to the wall: some 6 mm off it
COUNTS = (250, 1000, 4000, 20_000)
TIMED_PEERS = ("thin-plate", "poisson")
PAIR = "cross_{points}_1_even_101"  # of the development pairs
RECONSTRUCTED = "cross_{points}_1_even_102"  # one whose wall is reconstructed
POINT_LIMITS = {  # seconds of all stages, by number of points: on the phantom, on real surfaces
    250: (1.2, 3.0),
    1000: (2.0, 5.0),
    4000: (5.0, 10.0),
    20_000: (12.0, 20.0),
}
FILE_VERTICES = 200_000
WRITTEN_AS = {"carto_vtk": ".vtk", "opencarp": ".pts"}
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
    **{
        f"{where} {count}": (seconds, "s")
        for count, (phantom, real) in POINT_LIMITS.items()
        for where, seconds in (("phantom", phantom), ("cross", real), ("kit", real))
    },
    # on two cores that do nothing else
    "later run, no folds": (4.0, "s"),  # its report included
    "later run": (7.0, "s"),
    "first run / later run": (1.3, "x"),
    "  reading, scoring, writing": (1.0, "s"),
    "two workers / one": (0.55, "x"),
    "engine": (5.0, "%"),
}
COHORT_SEED = 61_001
RUN_PARTS = {  # of one process: what is said of it, by its function
    "reading the case": "o3dls.io.case_reader:read_case",
    "checking it": "o3dls.pipeline.pipeline:Pipeline.refusals",
    "fit": "o3dls.pipeline.pipeline:Pipeline.fit",
    "scoring": "o3dls.runs.scoring:scored",
    "writing estimates": "o3dls.runs.estimate_files:write_estimate",
    "report: page": "o3dls.report.page:report_page",
    "verdict": "o3dls.cli.summary:summary",
}
FILE_PARTS = ("reading the case", "scoring", "writing estimates")
TIMED_RUN = """
import builtins, functools, importlib, json, sys, time
parts = json.loads(sys.argv.pop(1))
seconds = dict.fromkeys(["imports", *parts], 0.0)

def timed(said, function):
    inside = False
    @functools.wraps(function)
    def call(*given, **named):
        nonlocal inside
        if inside:
            return function(*given, **named)
        inside, begin = True, time.perf_counter()
        try:
            return function(*given, **named)
        finally:
            inside = False
            seconds[said] += time.perf_counter() - begin
    return call

builtins.__import__ = timed("imports", builtins.__import__)
from o3dls.cli.main import main
for said, place in parts.items():
    module, name = place.split(":")
    owner = functools.reduce(getattr, name.split(".")[:-1], importlib.import_module(module))
    name = name.split(".")[-1]
    plain = getattr(owner, name)
    for one in [owner, *(found for key, found in list(sys.modules.items()) if key.startswith("o3dls"))]:
        if getattr(one, name, None) is plain:
            setattr(one, name, timed(said, plain))
try:
    main()
except SystemExit as end:
    assert not end.code, "the run failed"
print(json.dumps(seconds))
"""
PAGE_LIMITS = {"size, MB": 4.0, "ready, ms": 2000.0}  # what is asked for, on two quiet cores
OTHER_PAGE = 3.0  # MB, of a page of a thousand cases
READY = "Number(document.documentElement.dataset.ready)"
DRAWN = """() => new Promise((done) => requestAnimationFrame(
    () => requestAnimationFrame(() => done(performance.now()))))"""
DAMAGED = ("ended", "hung", "read wrong", "refused", "read")  # what became of a file
ENDED, HUNG, WRONG, REFUSED, READ = range(len(DAMAGED))
READERS = {  # the formats that each reads
    "o3dls": (".ply", ".stl", ".obj", ".vtk", ".vtp"),
    "Open3D": (".ply", ".stl", ".obj"),
    "VTK": (".ply", ".stl", ".obj", ".vtk", ".vtp"),
}
READER_SECONDS = 5  # a whole file takes milliseconds
READER_BYTES = 8 << 30  # of addresses: what a damaged header asks for beyond is not to be had
HEADER = 400  # bytes of a file in which its numbers of vertices and faces stand
DRAW_CALLS = "Math.max(...JSON.parse(document.documentElement.dataset.drawCalls))"


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
        rows.append(_score_held_out(f"stage {stage.name}", seconds, case, at.surface, at.status))
        if stage.name == "deform":
            rows.append(
                _score_held_out("motion", total, case, at.surface, "alignment, motion field and posterior")
            )
    rows.append(
        _score_held_out(
            "everything", total, case, at.surface, "with level set at 1 mm, isosurface and clean-up"
        )
    )
    return rows


def _score_held_out(what: str, seconds: Time, case: Any, surface: Any, status: str) -> Row:
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
    row, moved = _halve_spacing("halving", case, start, repeat)
    rows = [row]
    data = os.environ.get("O3DLS_DATA")
    if data:
        crossed = pair(1000, Path(data), RECONSTRUCTED)
        rows.append(
            _halve_spacing("halving, cross 1000", crossed, start_estimate(crossed.visible()), repeat)[0]
        )
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


def _halve_spacing(what: str, case: Any, start: Any, repeat: int) -> tuple[Row, Any]:
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
    return [_score_held_out("20 000 points", seconds, case, found.surface, found.status)]


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
        _score_held_out(
            "one more point", seconds, case, case.prior.with_vertices(warm.vertices), sentence(warm, "mm")
        )
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
        rows.append(
            _score_held_out(f"peer {name}", seconds, case, surface, "without the alignment it starts from")
        )
    return rows


def points(seed: int, repeat: int) -> list[Row]:
    """All stages with 250 to 20 000 points, on the phantom and, where O3DLS_DATA is set, on real surfaces;
    and two peers as tuned for so many points.
    """
    from benchmarks.peers import PEERS, pose_of, tuned
    from o3dls.pipeline.file import read_pipeline
    from o3dls.pipeline.pipeline import Pipeline

    data = os.environ.get("O3DLS_DATA")
    rows = []
    for name, case in cases(seed, Path(data) if data else None):
        shown = case.visible()
        stages = read_pipeline(pipeline_file("default")).allowed_by(shown).stages
        pipeline = Pipeline(list(stages), folds=0)
        seconds, found = timed(lambda p=pipeline, c=shown: p.fit(c), max(1, repeat // 3))  # type: ignore[misc]
        last = list(found.values())[-1]
        rows.append(_score_row(name, seconds, case, last.surface, last.status))
        settings = tuned().get(f"cross_{name.split()[1]}", {})
        pose = pose_of(case)
        for peer in TIMED_PEERS:
            if peer in settings:
                how = settings[peer]["parameters"]
                seconds, surface = timed(lambda q=peer, c=shown, o=pose, h=how: PEERS[q](c, o, **h), 1)  # type: ignore[misc]
                said = "without the alignment it starts from"
                rows.append(_score_row(f"  {peer}", seconds, case, surface, said))
    return rows


def cases(seed: int, data: Path | None) -> Iterator[tuple[str, Any]]:
    """Cases with every number of points: name of the row, case. Those of real surfaces need the folder."""
    from data_synth.atrium import atrium

    for count in COUNTS:
        yield f"phantom {count}", atrium(seed, points=count)
    if data is None:
        return
    for count in COUNTS:
        yield f"cross {count}", pair(count, data)
        yield f"kit {count}", _map_kit(data, count, seed)


def pair(count: int, data: Path, name: str = PAIR) -> Any:
    """One atrium as prior of another, with so many points; `name` of a development pair."""
    from benchmarks.cases import crossed, made

    wanted = {one.name: one for one in crossed(judging=False)}
    return made(wanted[name.format(points=count)], data)


def _map_kit(data: Path, count: int, seed: int) -> Any:
    """The real map with as many points, even over its wall, with 1 mm of noise."""
    import numpy as np

    from o3dls.evaluation.distances import sample
    from o3dls.io.case_reader import read_case

    case = read_case(data / "real" / "kit_mri_to_eam")
    assert case.truth is not None
    assert case.truth.surface is not None
    rng = np.random.default_rng(seed)
    every = sample(case.truth.surface, 20_000)
    at = every[rng.permutation(len(every))[:count]]
    marks = case.points.of("landmark")
    fresh = replace(
        case.points, xyz=at + rng.normal(size=at.shape), type=np.full(count, "eam"), columns={}, order=None
    )
    return replace(case, points=_add_landmarks(fresh, marks))


def _add_landmarks(points: Any, marks: Any) -> Any:
    import numpy as np

    names = marks.columns.get("name", np.full(len(marks.xyz), ""))
    columns = {"name": np.concatenate([np.full(len(points.xyz), ""), names])}
    return replace(
        points,
        xyz=np.vstack([points.xyz, marks.xyz]),
        type=np.concatenate([points.type, marks.type]),
        columns=columns,
    )


def _score_row(what: str, seconds: Any, case: Any, surface: Any, status: str) -> Row:
    from benchmarks.peers import cost

    return {
        "what": what,
        "value": seconds.clock,
        "cpu": seconds.cpu,
        "unit": "s",
        "error_mm": cost(case, surface),
        "status": status,
    }


def files(seed: int, repeat: int) -> list[Row]:
    """Writing and reading a surface of many vertices once in every format, time and check together."""
    import numpy as np

    from o3dls.io.surfaces import FORMATS, read_surface, write_surface

    surface = _make_sphere(FILE_VERTICES)
    rows = []
    for known in FORMATS:
        if known.write is None and known.name != "opencarp":
            continue
        suffix = WRITTEN_AS.get(known.name, known.suffixes[0] if known.suffixes else "")
        with TemporaryDirectory() as folder:
            path = Path(folder) / f"a{suffix}"
            begin = perf_counter()
            write_surface(path, surface, format=known.name)
            middle = perf_counter()
            back = read_surface(path)
            end = perf_counter()
            off = float(np.abs(np.sort(back.vertices, axis=0) - np.sort(surface.vertices, axis=0)).max())
        kept = "as many faces" if len(back.faces) == len(surface.faces) else "other faces"
        checked = f"largest error {off:.2g} mm, {kept}"
        for what, value, status in (("write", middle - begin, ""), ("read", end - middle, checked)):
            rows.append({"what": f"{what} {known.name}", "value": value, "unit": "s", "status": status})
    return rows


def _make_sphere(n: int) -> Any:
    """A grid of the sphere with about n vertices and two fields."""
    import numpy as np

    from o3dls.geometry.surface import Surface

    rows = int(np.sqrt(n / 2))
    columns = 2 * rows
    theta, phi = np.meshgrid(
        (np.arange(rows) + 0.5) * np.pi / rows, np.arange(columns) * 2 * np.pi / columns, indexing="ij"
    )
    xyz = 40 * np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1
    ).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    a = index[:-1].ravel()
    b = index[1:].ravel()
    c = np.roll(index, -1, axis=1)[1:].ravel()
    d = np.roll(index, -1, axis=1)[:-1].ravel()
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return Surface(xyz, faces, {"bipolar": xyz[:, 0] / 10, "lat": xyz[:, 1]})


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


def cholesky(seed: int, repeat: int) -> list[Row]:
    """The stage `topology` where it adds a vein, by trials that are fitted side by side: with LAPACK as
    o3dls calls it, and through SciPy's wrappers, which keep the interpreter's lock.
    """
    from data_synth.atrium import atrium
    from o3dls import ICP, Deform, Landmarks, Pipeline, Topology

    gaussian_process: Any = import_module("o3dls.motion.field.gaussian_process")
    case = atrium(seed, points=1000, lacks="prior")
    start = Pipeline([Landmarks(), ICP(), Deform()], folds=0).fit(case)["deform"]
    own, rows = gaussian_process.factor_and_inverse, list[Row]()
    try:
        for what, routine in (("by o3dls", own), ("by SciPy", _factor_and_inverse)):
            gaussian_process.factor_and_inverse = routine
            seconds, found = timed(lambda: Topology()(case.visible(), start), repeat)
            rows.append(_score_row(f"topology, LAPACK {what}", seconds, case, found.surface, found.status))
    finally:
        gaussian_process.factor_and_inverse = own
    gain = rows[1]["value"] / rows[0]["value"]
    return [*rows, {"what": "by SciPy / by o3dls", "value": gain, "unit": "x", "status": ""}]


def _factor_and_inverse(matrix: Any) -> tuple[Any, Any, int]:
    """Return what `o3dls.cholesky.factor_and_inverse` does, by SciPy's wrappers of LAPACK."""
    import numpy as np
    from scipy.linalg.lapack import dpotrf, dpotri

    factor, fault = dpotrf(matrix, lower=1, clean=1)
    lower = np.tril(dpotri(factor, lower=1)[0])
    return factor, lower + np.tril(lower, -1).T, fault


PARTS: dict[str, Callable[[int, int], list[Row]]] = {
    "cores": cores,
    "engine": engine,
    "halving": halving,
    "cholesky": cholesky,
    "many": many,
    "one_more": one_more,
    "memory": memory,
    "peers": peers,
    "points": points,
    "files": files,
}


def command_line(repeat: int) -> list[Row]:
    """Where the time of `o3dls run` on the demo case goes, each run in a process of its own, as from the
    shell: first and later runs with and without cross-validation, by the clock and, of all their processes,
    of the processor; and the parts of one by the clock alone.
    """
    with TemporaryDirectory(prefix="o3dls-speed-") as name:
        folder = Path(name)
        alone = folder / "no_folds.toml"
        alone.write_text(f"folds = 0\n{pipeline_file('default').read_text(encoding='utf-8')}")
        # as after an installation: modules are compiled once, whatever this shell says
        kept = {"NUMBA_CACHE_DIR": str(folder / "compiled"), "PYTHONDONTWRITEBYTECODE": ""}
        o3dls = [sys.executable, "-m", "o3dls"]
        found = [
            _time_command("nothing but the start", [*o3dls, "--version"], kept, repeat),
            _time_command("compiling (doctor --compile)", [*o3dls, "doctor", "--compile", "-q"], kept, 1),
            _time_command("first run after it", _compose_run(folder, o3dls), kept, 1),
            _time_command("later run", _compose_run(folder, o3dls), kept, repeat),
            _time_command("later run, no folds", _compose_run(folder, o3dls, str(alone)), kept, repeat),
        ]
        ratio = {"value": found[2]["value"] / found[3]["value"], "unit": "x", "status": ""}
        return [*found, {"what": "first run / later run", **ratio}, *_time_parts(folder, str(alone), kept)]


def _compose_run(folder: Path, o3dls: list[str], *pipeline: str) -> list[str]:
    out = str(folder / "run")
    return [*o3dls, "run", *pipeline, "--case", str(demo_case()), "--out", out, "--force", "-q"]


def _time_command(what: str, command: list[str], variables: Mapping[str, str], repeat: int) -> Row:
    clock, cpu = [], []
    for _ in range(repeat):
        begin, before = perf_counter(), _count_children()
        subprocess.run(command, env=os.environ | variables, check=True, capture_output=True)
        clock.append(perf_counter() - begin)
        cpu.append(_count_children() - before)
    return {"what": what, "value": median(clock), "cpu": median(cpu), "unit": "s", "status": ""}


def _count_children() -> float:
    """Seconds of the processor of the processes that this one has begun and that have ended."""
    spent = os.times()
    return spent.children_user + spent.children_system


def _count_processor() -> float:
    """Seconds of the processor of this process, and of those that it has begun and that have ended."""
    return process_time() + _count_children()


def _time_parts(folder: Path, alone: str, variables: Mapping[str, str]) -> list[Row]:
    """Of a later run without folds, by the clock; imports happen in other parts too, and count in both."""
    command = [sys.executable, "-c", TIMED_RUN, json.dumps(RUN_PARTS), *_compose_run(folder, [], alone)]
    done = subprocess.run(command, env=os.environ | variables, check=True, capture_output=True, text=True)
    seconds = json.loads(done.stdout.splitlines()[-1])
    seconds["reading, scoring, writing"] = sum(seconds[part] for part in FILE_PARTS)
    return [
        {"what": f"  {said}", "value": value, "unit": "s", "status": ""} for said, value in seconds.items()
    ]


def cohort(count: int) -> Iterator[Row]:
    """Rows on so many cases, at least two, that are run on one worker and on two."""
    from data_synth.atrium import atrium
    from o3dls.io.case_writer import write_case

    os.environ["NUMBA_NUM_THREADS"] = "1"
    with TemporaryDirectory() as name:
        folder = Path(name)
        folders = [folder / "cases" / f"atrium_{k:02d}" for k in range(count)]
        for k, case in enumerate(folders):
            write_case(case, replace(atrium(seed=COHORT_SEED + k), name=case.name))
        _run_batch(folders[:2], folder / "warm", 1)  # compiles the loops
        with ProcessPoolExecutor(1, get_context("spawn")) as process:
            loop = process.submit(loop_over, folders, folder / "loop").result()
        (one, between), (two, _) = (_run_batch(folders, folder / f"by_{n}", n) for n in (1, 2))
    about = {"unit": "s", "status": f"{count} cases"}
    yield {"what": "one worker", "value": one.clock, "cpu": one.cpu, **about}
    yield {"what": "two workers", "value": two.clock, "cpu": two.cpu, **about}
    yield {"what": "two workers / one", "value": two.clock / one.clock, "unit": "x", "status": ""}
    share = {"value": 100.0 * (between - loop) / between, "unit": "%"}
    said = f"first outcome to last {between:.1f} s, of a plain loop {loop:.1f} s"
    yield {"what": "engine", **share, "status": said}


def _run_batch(folders: list[Path], out: Path, workers: int) -> tuple[Time, float]:
    """Run the cases on so many workers: the time of the batch, and the seconds from first to last outcome."""
    from o3dls.pipeline.batch import Workers, run_cohort
    from o3dls.pipeline.file import default_pipeline
    from o3dls.pipeline.study import planned

    ends: list[float] = []
    begin, before = perf_counter(), _count_processor()
    outcomes = run_cohort(
        planned(folders, default_pipeline(), trim=True),
        out,
        Workers(workers, "local"),
        told=lambda _: ends.append(perf_counter()),
    )
    took = Time(perf_counter() - begin, _count_processor() - before)
    if failed := [str(one) for one in outcomes if one.error]:
        raise SystemExit("\n".join(failed))
    return took, ends[-1] - ends[0]


def loop_over(folders: list[Path], out: Path) -> float:
    """Seconds from the first outcome to the last of a plain loop over the cases."""
    from o3dls.io.case_reader import read_case
    from o3dls.pipeline.batch import run_into
    from o3dls.pipeline.file import default_pipeline

    ends = []
    for folder in folders:
        case = read_case(folder)
        run_into(default_pipeline().allowed_by(case), case, out / folder.name)
        ends.append(perf_counter())
    return ends[-1] - ends[0]


def visit_page(browser: Any, page: Path, *, report: bool) -> dict[str, float]:
    """What one visit of a page took."""
    from tests.browser import Visit

    visit = Visit(browser, page, wait=report)
    found = {"ready, ms": visit.page.evaluate(READY if report else DRAWN)}
    if report:
        found["draw calls of a picture"] = visit.page.evaluate(DRAW_CALLS)
    visit.page.close()
    return found


def print_page(shown: Path | None, repeat: int) -> None:
    """Size and start of a page, by so many visits, each in a new tab."""
    from o3dls.report.writer import write_report
    from tests.browser import chromium

    with TemporaryDirectory() as folder, chromium() as launch:
        run = shown or Path(folder) / "demo"
        if shown is None:
            subprocess.run([sys.executable, "-m", "o3dls", "demo", "--out", run], check=True)
        report = not run.is_file()
        path = write_report([run], Path(folder) / "page.html") if report else run
        browser = launch()
        visits = [visit_page(browser, path, report=report) for _ in range(repeat)]
        most = PAGE_LIMITS["size, MB"] if report else OTHER_PAGE
        print(f"{'size, MB':24}{path.stat().st_size / 1e6:10.2f}   limit {most:g}")
        for key in visits[0]:
            values = [one[key] for one in visits]
            limit = f"   limit {PAGE_LIMITS[key]:g}" if key in PAGE_LIMITS else ""
            print(f"{key:24}{min(values):10.0f} at least, {median(values):.0f} in the middle{limit}")


def whole_files(folder: Path) -> dict[str, Path]:
    """A ball in every format and layout, as Open3D and VTK write it, by the name of its row."""
    import open3d as o3d
    from vtkmodules.vtkIOGeometry import vtkOBJWriter, vtkSTLWriter
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter
    from vtkmodules.vtkIOPLY import vtkPLYReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    mesh = o3d.geometry.TriangleMesh.create_sphere(20.0, 8)
    found = {}
    for said, text in (("PLY, binary", False), ("PLY, text", True)):
        found[said] = folder / f"{'text' if text else 'binary'}.ply"
        o3d.io.write_triangle_mesh(str(found[said]), mesh, write_ascii=text)
    reader = vtkPLYReader()
    reader.SetFileName(str(found["PLY, binary"]))
    reader.Update()
    for said, name, writer, mode in (
        ("STL, binary", "binary.stl", vtkSTLWriter(), "Binary"),
        ("STL, text", "text.stl", vtkSTLWriter(), "ASCII"),
        ("OBJ", "text.obj", vtkOBJWriter(), ""),
        ("VTK, binary", "binary.vtk", vtkPolyDataWriter(), "Binary"),
        ("VTK, text", "text.vtk", vtkPolyDataWriter(), "ASCII"),
        ("VTP, packed", "packed.vtp", vtkXMLPolyDataWriter(), "Appended"),
        ("VTP, text", "text.vtp", vtkXMLPolyDataWriter(), "Ascii"),
    ):
        writer.SetFileName(str(folder / name))
        writer.SetInputData(reader.GetOutput())
        if mode:
            getattr(writer, f"Set{'DataModeTo' if name.endswith('.vtp') else 'FileTypeTo'}{mode}")()
        writer.Write()
        found[said] = folder / name
    return found


def damage(data: bytes, k: int, seed: int) -> bytes:
    """The k-th damaged copy of a file; a digit becomes another digit, so that texts remain numbers."""
    import numpy as np

    rng = np.random.default_rng([seed, k])
    if k % 3 == 0:
        return data[: rng.integers(1, len(data))]
    changed = bytearray(data)
    while bytes(changed) == data:
        for at in rng.integers(len(data) if k % 3 == 1 else min(len(data), HEADER), size=rng.integers(1, 5)):
            digit = chr(changed[at]).isdigit() and changed[at] < 128
            changed[at] = int(rng.integers(48, 58) if digit else rng.integers(256))
    return bytes(changed)


def read_mesh(reader: str, path: Path) -> tuple[Any, Any]:
    """The vertices (n, 3) and faces (m, 3) that one of READERS gives of a file, empty where it has none."""
    import numpy as np

    if reader == "o3dls":
        from o3dls.io.surfaces import read_surface_file

        surface = read_surface_file(path).surface
        return surface.vertices, surface.faces
    if reader == "Open3D":
        import open3d as o3d

        mesh = o3d.io.read_triangle_mesh(str(path))
        return np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    from vtkmodules import vtkIOGeometry, vtkIOLegacy, vtkIOPLY, vtkIOXML
    from vtkmodules.util.numpy_support import vtk_to_numpy

    found = {
        ".ply": vtkIOPLY.vtkPLYReader,
        ".stl": vtkIOGeometry.vtkSTLReader,
        ".obj": vtkIOGeometry.vtkOBJReader,
        ".vtk": vtkIOLegacy.vtkPolyDataReader,
        ".vtp": vtkIOXML.vtkXMLPolyDataReader,
    }[path.suffix]()
    found.SetFileName(str(path))
    found.Update()
    data = found.GetOutput()
    if data is None or data.GetNumberOfPolys() == 0:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=int)
    corners = vtk_to_numpy(data.GetPolys().GetConnectivityArray())
    sizes = np.diff(vtk_to_numpy(data.GetPolys().GetOffsetsArray()))
    vertices = vtk_to_numpy(data.GetPoints().GetData()) if data.GetPoints() else np.zeros((0, 3))
    # a polygon of another size is no triangle of the file
    return vertices, corners.reshape(-1, 3) if (sizes == 3).all() else np.full((1, 3), -1)


def count_mesh(path: Path, vertices: Any, faces: Any) -> tuple[int, int]:
    """How many vertices and faces a file has; an STL has no vertices of its own, which readers make."""
    return 0 if path.suffix == ".stl" else len(vertices), len(faces)


def judge_mesh(reader: str, path: Path, counts: tuple[int, int]) -> int:
    """What a reader makes of a file whose whole has so many vertices and faces: one of DAMAGED."""
    import numpy as np

    from o3dls.errors import O3dlsError

    try:
        vertices, faces = read_mesh(reader, path)
    except (O3dlsError, OSError, RuntimeError, ValueError, MemoryError):
        return REFUSED
    if len(vertices) == 0 or len(faces) == 0:
        return REFUSED
    wrong = count_mesh(path, vertices, faces) != counts or not np.isfinite(vertices).all()
    return WRONG if wrong or faces.min() < 0 or faces.max() >= len(vertices) else READ


def judge_files(reader: str, whole: Path, count: int, seed: int) -> list[int]:
    """How many of so many damaged copies of a file became each of DAMAGED, in its order."""
    counts = count_mesh(whole, *read_mesh(reader, whole))  # imports what is needed, once for all children
    if (made := _judge_apart(reader, whole, counts)) != READ or counts[1] == 0:
        raise SystemExit(f"{reader} cannot read the whole {whole.name}: {DAMAGED[made]}")
    data, path = whole.read_bytes(), whole.with_stem(f"{reader}_{whole.stem}")
    found = [0] * len(DAMAGED)
    for k in range(count):
        path.write_bytes(damage(data, k, seed))
        found[_judge_apart(reader, path, counts)] += 1
    return found


def _judge_apart(reader: str, path: Path, counts: tuple[int, int]) -> int:
    """Judge a file in a process of its own, which the file may end, or keep from ending."""
    import resource

    child = os.fork()
    if child == 0:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        resource.setrlimit(resource.RLIMIT_AS, (READER_BYTES, READER_BYTES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.signal(signal.SIGALRM, signal.SIG_DFL)  # ends a loop outside of Python too
        signal.alarm(READER_SECONDS)
        code = ENDED
        try:
            code = judge_mesh(reader, path, counts)
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return HUNG if os.WTERMSIG(status) == signal.SIGALRM else ENDED
    return os.WEXITSTATUS(status)


def print_readers(count: int, seed: int) -> None:
    """A row for each format and reader: what became of so many damaged files."""
    print(f"| {count} files | reader | {' | '.join(DAMAGED)} |")
    print("|---" * (2 + len(DAMAGED)) + "|")
    with TemporaryDirectory() as folder:
        for said, path in whole_files(Path(folder)).items():
            for reader, suffixes in READERS.items():
                if path.suffix in suffixes:
                    with ProcessPoolExecutor(1, get_context("spawn")) as process:
                        found = process.submit(judge_files, reader, path, count, seed).result()
                    print(f"| {said} | {reader} | {' | '.join(map(str, found))} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=2401, help="of the synthetic atrium")
    parser.add_argument("--repeat", type=int, default=5, help="runs of which the median counts")
    parser.add_argument("--part", choices=PARTS, action="append", help="only these; default: all")
    parser.add_argument("--json", action="store_true", help="one JSON line per measurement and nothing else")
    parser.add_argument("--cli", action="store_true", help="o3dls run on the demo case: first, later, parts")
    parser.add_argument(
        "--page",
        nargs="?",
        const="",
        metavar="RUN|PAGE",
        help="size and start of the page of a finished run, or of another page; default: of the demo",
    )
    parser.add_argument(
        "--cohort",
        type=int,
        nargs="?",
        const=16,
        metavar="CASES",
        help="a cohort of so many cases, default 16, on two workers and on one",
    )
    parser.add_argument(
        "--readers",
        type=int,
        nargs="?",
        const=300,
        metavar="FILES",
        help="what readers of surfaces make of so many damaged files of each format, default 300",
    )
    arguments = parser.parse_args()
    if arguments.readers:
        print_readers(arguments.readers, arguments.seed)
        return
    if arguments.page is not None:
        print_page(Path(arguments.page) if arguments.page else None, arguments.repeat)
        return
    if arguments.cli or arguments.cohort:
        print(HEAD)
        for row in cohort(arguments.cohort) if arguments.cohort else command_line(arguments.repeat):
            print(_lay_out_row(row))
        return
    if arguments.json and arguments.part and len(arguments.part) == 1:
        _print_json(PARTS[arguments.part[0]](arguments.seed, arguments.repeat))
        return
    print(HEAD)
    for part in arguments.part or PARTS:  # each in a process of its own: memory and caches do not mix
        for row in _run_apart(part, arguments.seed, arguments.repeat):
            print(_lay_out_row(row), flush=True)


def _run_apart(part: str, seed: int, repeat: int) -> list[Row]:
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


def _print_json(rows: list[Row]) -> None:
    for row in rows:
        print(json.dumps(row))


def _lay_out_row(row: Row) -> str:
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
