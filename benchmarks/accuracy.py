"""Accuracy over folders of cases, o3dls beside its own parts and other methods: python -m benchmarks.accuracy
FOLDER...

Fresh seeds are made by the phantom generator, once per group (development seeds below 1000, judging above):

    for s in $(seq 2001 2030); do
        python phantom.py atrium $s cases/la_$s; python phantom.py atrium $s cases/lah_$s --motion 2
        for p in 3 6 9 12; do python phantom.py jar $s cases/jar_$(printf %02d $p)_$s --percent $p; done
        for p in 2 6 10; do python phantom.py star $s cases/star_$(printf %02d $p)_$s --percent $p; done
    done

atria with few points by the same, grouped by their number:

    for n in 30 60 120; do for s in $(seq 2001 2030); do
        python phantom.py atrium $s cases/sparse_${n}_$s --points $n
    done; done

and, by our own generator, atria of which the prior has a vein too many or too few, by the number of points:

    for n in 250 1000; do for s in $(seq 2001 2030); do
        python -m data_synth atrium cases/extra_${n}_$s --seed $s --points $n --lacks truth
        python -m data_synth atrium cases/missing_${n}_$s --seed $s --points $n --lacks prior
    done; done

and, by the same, atria in whose map there are points of the other atrium, by the number of points:

    for s in $(seq 2001 2030); do
        python -m data_synth atrium cases/beside_250_$s --seed $s --points 250 --beside 40
        python -m data_synth atrium cases/beside_1000_$s --seed $s --points 1000 --beside 160
    done

and, by the same from real atria, one person's as the prior of another's and such as moved by motions unlike
any that the program expects:

    python -m benchmarks.cases cross cases --data ../shared/data --judging
    python -m benchmarks.cases families cases --data ../shared/data --judging

patients' own atria whose map leaves wall out, as priors of their own and once more as if they were templates,
and priors that are badly segmented:

    python -m benchmarks.cases unvisited cases --data ../shared/data --judging
    python -m benchmarks.accuracy cases --ours
    python -m benchmarks.accuracy cases --ours --prior-of template
    python -m benchmarks.cases badly_segmented cases --data ../shared/data --judging

Rows: start (landmarks), icp (our robust similarity), deform (T only),
topology (its T, of a changed prior),
level_set (T and phi), each peer as tuned by benchmarks.peers, and with --phantom phantom.py the generator's
bound. Columns: mean +- standard error (worst); ssd_seen and ssd_unseen: between surface and truth, both ways,
in mapped areas and in others; in 95 %: of the wall within its 95 % band; prior only: the same of wall that is
farther than 10 mm from every point. Under the tables of `unvisited` groups there is one of vein wall lost
(benchmarks.scores), and how often a shift of a part of the map was named.

Under the tables of `cross_...` groups there is one of the cases whose prior has another topology than the
truth: does the result have the truth's? A handle of the truth counts as shown where the rule of `level_set`
keeps it on the truth's own level set (1 mm): where the points are likelier by `evidence` than with the handle
cut or its tunnel filled. That the truth lacks a handle of the prior always counts as shown.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import re
import sys
from collections.abc import Collection, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import Any

import numpy as np

from benchmarks.cases import Listed, find, tuned_as
from benchmarks.peers import FAILURES, PEERS, applicable, tuned
from benchmarks.scores import (
    Record,
    lay_out,
    on_wall,
    scores,
    shifts_named,
    tables,
    vein_scores,
    vein_table,
)
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import distances
from o3dls.geometry.closest_point import ClosestPoint
from o3dls.geometry.components import components_and_euler
from o3dls.geometry.similarity import apply, fit_similarity, rms_radius
from o3dls.geometry.surface import Surface
from o3dls.pipeline.workers import workers

MOTION = {"la": 1.0, "lah": 2.0}  # phantom.py's --motion
DRAWS = 1500
EVERY = 4  # of the held-out points
PRIOR_NOISE, PRIOR_NOISE_LENGTH = 0.3, 4.0  # mm, of the phantom's segmentation
BOUND_SEED = 553_091_827
POSE_SD = np.array([5.0, 5.0, 5.0, 0.1, 0.1, 0.1, 0.1])  # a nearly flat prior of the similarity: mm, rad, 1
CROSSED_GROUP = re.compile(r"cross_(\d+)_([\d.]+)_(\S+)$")  # points, noise in mm, spread
SPACING, WIDTH = 1.0, 4.0  # mm, of the level set of a truth whose handles are looked at
HANDLES = ("handles_prior", "handles_truth", "handles_shown", "handles")


def ours(case: Any, plan: Path | None) -> Iterator[tuple[str, Any, float]]:
    """Estimates of a pipeline (the packaged default): name, estimate, seconds from the start."""
    from o3dls.pipeline.file import read_pipeline
    from o3dls.pipeline.pipeline import Pipeline
    from o3dls.resources import pipeline_file

    asked = read_pipeline(plan or pipeline_file("default")).allowed_by(case)
    pipeline = Pipeline(asked.stages, folds=0)
    estimates = pipeline.fit(case)
    for name, estimate in estimates.items():
        if name != "landmarks":
            yield name, estimate, sum(estimates[one].seconds for one in pipeline.chain(name))


def peers(
    case: Any, group: str, names: Collection[str], icp: Any, icp_seconds: float
) -> Iterator[tuple[str, Any, float]]:
    """Results of these other methods, as tuned for the group; where it was not tuned they are left out."""
    settings = tuned().get(tuned_as(group), {})
    for name in (one for one in applicable(case) if one in names):
        if name not in settings:
            print(
                f"{tuned_as(group)}: {name} is not tuned (python -m benchmarks.peers tune), left out",
                file=sys.stderr,
            )
            continue
        begin = perf_counter()
        try:
            surface = PEERS[name](case.visible(), icp.T_map_prior, **settings[name]["parameters"])
        except FAILURES as error:
            print(f"{case.name}: {name} failed: {error}", file=sys.stderr)
            continue
        yield name, Estimate(surface, icp.T_map_prior, name), icp_seconds + perf_counter() - begin


def run(
    listed: Listed,
    phantom: Path | None,
    plan: Path | None,
    *,
    others: Collection[str],
    prior_of: str | None = None,
) -> list[Record]:
    """Records of our methods and these others on one case, which says whose anatomy its prior is unless
    `prior_of` does.
    """
    case = listed.read()
    case = replace(case, **{"prior_of": prior_of}) if prior_of else case
    results = list(ours(case, plan))
    icp, seconds = next((estimate, seconds) for name, estimate, seconds in results if name == "icp")
    if others:
        results += list(peers(case, listed.group, others, icp, seconds))
    records = [{"method": name, "seconds": took, **record(case, found)} for name, found, took in results]
    for one, (name, found, _) in zip(records, results, strict=True):
        one |= topology_scores(listed.group, case, found.surface) if name == "level_set" else {}
    if phantom is not None and listed.group in MOTION:
        records.append({"method": "bound", **least_errors(listed, case, _load_phantom(phantom))})
    return [{"group": listed.group, "case": listed.name, **record} for record in records]


def record(case: Any, estimate: Any) -> Record:
    """Scores of an estimate, and the codes of what it warns of."""
    warned = sorted({warning.code for warning in estimate.warnings})
    return {**scores(case, estimate), **vein_scores(case, estimate.surface), "warnings": warned}


def count_handles(surface: Surface) -> int:
    """Number of handles of a closed surface."""
    pieces, euler = components_and_euler(surface.vertices, surface.faces)
    return pieces - euler // 2


def count_shown(case: Case, noise: float) -> int:
    """How many handles of the truth its points show, of which `noise` (mm) is known."""
    from o3dls.levelset.grid.band import Band
    from o3dls.levelset.grid.distance import signed_distance
    from o3dls.levelset.grid.isosurface import zero_set
    from o3dls.levelset.settings import LatticeSettings
    from o3dls.reconstruction.points.point_density import PointDensity
    from o3dls.reconstruction.settings import ReconstructionSettings
    from o3dls.reconstruction.shape.handles import without_handles

    assert case.truth is not None
    assert case.truth.surface is not None
    settings = ReconstructionSettings()
    near = signed_distance(case.truth.surface.vertices, case.truth.surface.faces, SPACING, WIDTH)
    box = near.band.dense(near.phi)
    phi = np.where(np.isnan(box), WIDTH, box).astype(np.float64)
    points = case.points.of("eam").xyz
    density = PointDensity(points, noise, near.band.low, SPACING, settings.handles)
    least = LatticeSettings().least_outside * SPACING
    asked = settings.handles.least_cut * (rms_radius(case.truth.surface.vertices) / SPACING) ** 2
    kept = without_handles(phi, density.log_likelihoods, settings.handles, least, asked)
    nodes = np.argwhere(np.ones(phi.shape, dtype=bool)).astype(np.int32)
    band = Band(SPACING, WIDTH, near.band.low, phi.shape, nodes)
    return count_handles(Surface(*zero_set(band, kept.ravel())))


def topology_scores(group: str, case: Case, surface: Surface) -> dict[str, int]:
    """Numbers of handles of prior, truth and result, and of those that points show; empty where prior and
    truth have as many, and where the group does not say what the noise is.
    """
    crossed_group = CROSSED_GROUP.match(group)
    if not crossed_group or case.truth is None or case.truth.surface is None:
        return {}
    before, after = count_handles(case.prior), count_handles(case.truth.surface)
    if before == after:
        return {}
    shown = count_shown(case, float(crossed_group[2]))
    return dict(zip(HANDLES, (before, after, shown, count_handles(surface)), strict=True))


def judge_topology(record: Record) -> str:
    """Whether the result has the truth's topology, where the points show it."""
    _, truth, shown, result = (record[name] for name in HANDLES)
    if truth != shown:
        return "points do not show it"
    return "right" if result == truth else "wrong"


def topology_table(records: list[Record]) -> str:
    """A row for each case whose prior has another topology than the truth; empty where there is none."""
    records = [record for record in records if HANDLES[0] in record]
    if not records:
        return ""
    rows = [["topology", "handles of prior", "of truth", "shown by points", "of result", ""]]
    rows += [[r["case"], *(str(r[name]) for name in HANDLES), judge_topology(r)] for r in records]
    judged = [row[-1] for row in rows[1:] if row[-1] in ("right", "wrong")]
    said = f"{judged.count('right')} of {len(judged)} right where points show that the topology differs"
    return f"{lay_out(rows)}\n{said}"


def _load_phantom(path: Path) -> ModuleType:
    """The phantom generator as a module."""
    spec = importlib.util.spec_from_file_location("phantom", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def least_errors(listed: Listed, case: Case, phantom: ModuleType) -> dict[str, float]:
    """The least error that the atrium phantom allows, as expected along the normal at held-out points:
    `held_out`, `seen`, `unseen`. It is that of a linear MMSE that knows the generator's covariance.

    Known as well: which points are outliers, the noise level, every point's true foot; observed is the
    distance along the normal. So no method that sees the points alone can be better in the mean, and none
    comes quite there.
    """
    truth = case.truth
    assert truth is not None
    assert truth.surface is not None
    assert truth.held_out is not None
    assert truth.unseen is not None
    anatomy = phantom._anatomy(np.random.default_rng(3000 + (listed.seed or 0)))
    ostia = np.stack([anatomy["pv"][name]["ost"] for name in phantom.PV])
    marks = np.stack([case.prior_landmarks[name] for name in phantom.PV])
    rest = Surface(apply(np.linalg.inv(fit_similarity(ostia, marks)), case.prior.vertices), case.prior.faces)
    points = case.points.xyz[on_wall(case)]
    noise = np.sqrt((distances(points, truth.surface) ** 2).mean())
    unseen = truth.unseen[::EVERY]
    at, normals = _carry_feet_back(np.vstack([points, truth.held_out[::EVERY]]), truth.surface, rest)
    covariance = _draw_covariance(at, normals, rest.vertices, anatomy, phantom, MOTION[listed.group])
    n = len(points)
    seen_by = covariance[:n, :n] + noise**2 * np.eye(n)
    crossed = covariance[n:, :n]
    variance = np.diag(covariance)[n:] - (crossed * np.linalg.solve(seen_by, crossed.T).T).sum(axis=1)
    error = np.sqrt(2.0 / np.pi * np.maximum(variance, 0.0))
    return {
        "held_out": float(error.mean()),
        "seen": float(error[~unseen].mean()),
        "unseen": float(error[unseen].mean()),
    }


def _carry_feet_back(points: Array, truth: Surface, rest: Surface) -> tuple[Array, Array]:
    """True feet of points, carried back to the anatomy at rest, with its normals there: truth and prior share
    their faces.
    """
    _, face, _, bary = ClosestPoint(truth.vertices, truth.faces).query(points)
    corners = rest.faces[face]
    normals = np.einsum("nc,ncd->nd", bary, rest.vertex_normals[corners])
    return np.einsum("nc,ncd->nd", bary, rest.vertices[corners]), normals / np.linalg.norm(normals, axis=1)[
        :, None
    ]


def _draw_covariance(
    at: Array, normals: Array, vertices: Array, anatomy: Any, phantom: ModuleType, motion: float
) -> Array:
    """Covariance of the normal displacements: of the deformation by draws, of the segmentation noise and the
    pose in closed form.
    """
    from scipy.spatial.distance import cdist

    rng = np.random.default_rng(BOUND_SEED)
    draws = np.stack(
        [
            ((_draw_warp(at, vertices, anatomy, phantom, motion, rng) - at) * normals).sum(axis=1)
            for _ in range(DRAWS)
        ]
    )
    draws -= draws.mean(axis=0)
    pose = np.column_stack([normals, np.cross(at, normals), (at * normals).sum(axis=1)]) * POSE_SD
    noise = PRIOR_NOISE**2 * np.exp(-0.5 * cdist(at, at, "sqeuclidean") / PRIOR_NOISE_LENGTH**2)
    return np.asarray(draws.T @ draws / DRAWS + pose @ pose.T + noise)


def _draw_warp(
    x: Array, vertices: Array, anatomy: Any, phantom: ModuleType, motion: float, rng: np.random.Generator
) -> Array:
    """One draw of the deformation, as phantom.py draws it."""
    change = rng.uniform(0.10, 0.25) * rng.choice([-1, 1])
    split = rng.dirichlet([2, 2, 2])
    stretch = (1 + change) ** split
    mean = stretch.prod() ** (1 / 3)
    y = x * mean * (stretch / mean) ** motion
    axis = rng.normal(size=3) * [1, 0.3, 0.3]
    k = np.cross(np.eye(3), axis / np.linalg.norm(axis))
    angle = np.deg2rad(rng.uniform(3, 7)) * motion * rng.choice([-1, 1]) * np.tanh(x[:, 2] / 20.0)
    y = y + np.sin(angle)[:, None] * (y @ k.T) + (1 - np.cos(angle))[:, None] * (y @ (k @ k).T)
    centre = vertices[rng.integers(len(vertices))]
    height = motion * rng.uniform(2.5, 4.5) * rng.choice([-1, 1])
    width = rng.uniform(8, 11)
    y = y + (height * np.exp(-((x - centre) ** 2).sum(axis=1) / (2 * width**2)))[
        :, None
    ] * centre / np.linalg.norm(centre)
    for name in phantom.PV:
        y = y + np.exp(-((x - anatomy["pv"][name]["ost"]) ** 2).sum(axis=1) / 200.0)[:, None] * (
            rng.normal(size=3) * 2.0 * motion
        )
    return np.asarray(y)


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="*", type=Path, help="case folders, or folders of them")
    parser.add_argument("--phantom", type=Path, help="the generator's file, for its bound")
    parser.add_argument("--pipeline", type=Path, help="a pipeline file in place of the default pipeline")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--ours", action="store_true", help="leave the other methods out")
    which.add_argument("--peers", nargs="+", choices=PEERS, default=list(PEERS), help="only these of them")
    parser.add_argument("--prior-of", choices=("patient", "template"), help="in place of what the cases say")
    parser.add_argument(
        "--records",
        type=Path,
        help="one JSON line per case and method; cases that are in it already are not run again, and without "
        "a FOLDER the tables are of what is in it",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=1,
        help="processes side by side (times are then those of a shared machine)",
    )
    arguments = parser.parse_args()
    if not arguments.folders and not arguments.records:
        parser.error("a FOLDER or --records is needed")
    return arguments


def main() -> None:
    arguments = _parse_arguments()
    # for the processes below
    os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    records = _read_records(arguments.records)
    if arguments.folders:
        records += _run_cases(arguments, {record["case"] for record in records})
    shown = (tables(records), topology_table(records), vein_table(records), shifts_named(records))
    print("\n\n".join(part for part in shown if part))


def _run_cases(arguments: argparse.Namespace, done: set[str]) -> list[Record]:
    """Records of the cases that are not done, kept as they come."""
    records = []
    work = partial(
        run,
        phantom=arguments.phantom,
        plan=arguments.pipeline,
        others=() if arguments.ours else arguments.peers,
        prior_of=arguments.prior_of,
    )
    todo = [listed for listed in find(arguments.folders) if listed.name not in done]
    with workers(arguments.jobs) as pool:
        for found in pool.map(work, todo):
            records += found
            _append_records(arguments.records, found)
            print(f"{found[0]['case']} done", file=sys.stderr, flush=True)
    return records


def _read_records(path: Path | None) -> list[Record]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path and path.is_file() else []


def _append_records(path: Path | None, records: list[Record]) -> None:
    if path:
        with path.open("a") as file:
            file.writelines(json.dumps(record) + "\n" for record in records)


if __name__ == "__main__":
    main()
