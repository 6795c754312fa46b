"""How much a result hangs on what should not matter: python -m benchmarks.stability FOLDER... --records FILE

    python -m benchmarks.stability cases/judge --records stability.jsonl --every 7
    python -m benchmarks.stability --table stability.jsonl

Each case is fitted by the default pipeline without folds, and again

    start      from a pose that is moved by 2 mm and turned by 2 degrees about the middle of the prior, twice
    order      with its points in reverse order
    left out   of 1000 points and more, without 5 % of them

The pose that is moved is that of the landmarks, or `init.csv`, or where the file stands. The distance is the
mean (mm, both directions) of the last surface from that of the case as it is. The structure is another
where the number of pieces or handles differs, or some wall of one surface is over 6 mm from the other; it
is flagged where either run has a warning that puts its result in doubt, and told where either says that a
part was added or removed, and to check it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.cases import Listed, find
from benchmarks.scores import Record, lay_out
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.errors import O3dlsError
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import distances, sample
from o3dls.evaluation.validity import components, euler
from o3dls.geometry.similarity import similarity
from o3dls.geometry.surface import Surface
from o3dls.geometry.twist import rotation
from o3dls.pipeline.file import default_pipeline
from o3dls.pipeline.pipeline import Pipeline
from o3dls.run_warning import RunWarning

MOVE, TURN = 2.0, np.radians(2.0)
STARTS = 2
FINDING = ("landmarks", "global_pose")  # stages that find a pose, from which ICP begins
LEFT_OUT, MANY = 0.05, 1000
NEAR, SHARE = 0.15, 0.95  # mm, and the share of the runs that should be as near
PART = 6.0  # mm: wall that is farther from the other surface is a part that one has and the other has not
SAMPLES = 20_000


def moved_start(T: Array, prior: Array, rng: np.random.Generator) -> Array:
    """The pose, moved and turned in a random direction about where it puts the middle of the prior."""
    turn, way = rng.normal(size=(2, 3))
    R = rotation(TURN * turn / np.linalg.norm(turn))
    middle = T[:3, :3] @ prior.mean(axis=0) + T[:3, 3]
    shift = MOVE * way / np.linalg.norm(way)
    return np.asarray(similarity(R, middle - R @ middle + shift, 1.0) @ T)


def variants(case: Case, start: Array, seed: int) -> Iterator[tuple[str, Case, Array]]:
    """What each is called, the case and the pose from which it begins; the case as it is comes first."""
    rng = np.random.default_rng(seed)
    yield "as it is", case, start
    for _ in range(STARTS):
        yield "start", case, moved_start(start, case.prior.vertices, rng)
    yield "order", replace(case, points=case.points.select(np.arange(len(case.points))[::-1])), start
    eam = np.flatnonzero(case.points.type == "eam")
    if len(eam) >= MANY:
        kept = np.ones(len(case.points), dtype=bool)
        kept[rng.choice(eam, round(LEFT_OUT * len(eam)), replace=False)] = False
        yield "left out", replace(case, points=case.points.select(kept)), start


def repeated(listed: Listed, seed: int) -> Iterator[Record]:
    """A record of each variant against the case as it is; one with `error` where the case is refused."""
    case = replace(listed.read(), truth=None)
    plan = replace(default_pipeline().allowed_by(case), writes=(), folds=0)
    about = {"group": listed.group, "case": listed.name}
    try:
        start = _find_start(plan, case)
        first = None
        for name, variant, pose in variants(case, start, seed):
            last = _fit_from(plan, variant, pose)
            if first is None:
                first = last
                continue
            yield {**about, "what": name, **compared(first, last)}
    except O3dlsError as error:
        yield {**about, "error": str(error)}


def _fit_from(plan: Pipeline, case: Case, pose: Array) -> Estimate:
    """The last estimate of the stages that follow those which find the pose, with the warnings of all."""
    estimate = Estimate(case.prior.transformed(pose), pose, "the pose given")
    warnings: tuple[RunWarning, ...] = ()
    for stage in plan.stages:
        if stage.name not in FINDING:
            estimate = stage(estimate.corrected(case).visible(stage.fits), estimate)
            warnings += estimate.warnings
    return replace(estimate, warnings=warnings)


def _find_start(plan: Pipeline, case: Case) -> Array:
    """The pose from which ICP begins."""
    finding = [stage for stage in plan.stages if stage.name in FINDING]
    if not finding:
        return np.eye(4) if case.init is None else case.init
    return np.asarray(list(Pipeline(finding, folds=0).fit(case).values())[-1].T_map_prior)


def compared(first: Estimate, second: Estimate) -> Record:
    """How far two results lie apart, whether they have one structure, and what is said of it."""
    a, b = first.surface, second.surface
    there, back = distances(sample(a, SAMPLES), b), distances(sample(b, SAMPLES), a)
    parts = max(float(there.max()), float(back.max()))
    same = _shape(a) == _shape(b) and parts <= PART
    said = *first.warnings, *second.warnings
    warned = any(one.kind == "warning" for one in said)
    told = any(one.code == "topology-changed" for one in said)
    apart = 0.5 * float(there.mean() + back.mean())
    return {"apart": apart, "farthest": parts, "same": same, "warned": warned, "told": told}


def _shape(surface: Surface) -> tuple[int, int]:
    return components(surface), euler(surface)


def table(records: Sequence[Record]) -> str:
    """The runs by what was changed, and all together."""
    done = [record for record in records if "apart" in record]
    refused = [f"{record['case']}: {record['error']}" for record in records if "error" in record]
    head = [
        "changed",
        "runs",
        "median",
        "95 %",
        "largest",
        f"within {NEAR:g} mm",
        "another structure",
        "flagged",
        "told",
    ]
    kinds = list(dict.fromkeys(record["what"] for record in done))
    rows = [[kind, *_sum_up([one for one in done if one["what"] == kind])] for kind in kinds]
    rows.append(["all", *_sum_up(done)])
    far = sorted((one for one in done if one["apart"] > NEAR), key=lambda one: -one["apart"])
    named = [
        f"{one['case']} ({one['what']}): {one['apart']:.2f}, farthest {one['farthest']:.1f}" for one in far
    ]
    return "\n".join([lay_out([head, *rows]), "", *named, *refused])


def _sum_up(records: Sequence[Record]) -> list[str]:
    apart = np.array([record["apart"] for record in records])
    other = [record for record in records if not record["same"]]
    return [
        str(len(records)),
        *(f"{x:.3f}" for x in (np.median(apart), np.quantile(apart, SHARE), apart.max())),
        f"{100.0 * (apart <= NEAR).mean():.1f} %",
        str(len(other)),
        *(str(sum(record[said] for record in other)) for said in ("warned", "told")),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="*", type=Path, help="cases, or folders of them")
    parser.add_argument(
        "--records", type=Path, help="file to which each run is written; those there are kept"
    )
    parser.add_argument("--table", type=Path, help="print the table of records, and run nothing")
    parser.add_argument("--every", type=int, default=1, help="only each so-many-th case")
    parser.add_argument("--seed", type=int, default=0, help="of the moves and of what is left out")
    given = parser.parse_args()
    path = given.table or given.records
    lines = path.read_text(encoding="utf-8").splitlines() if path and path.is_file() else []
    records = [json.loads(line) for line in lines]
    if not given.table:
        there = {record["case"] for record in records}
        asked = find(given.folders)[:: given.every]
        for k, listed in enumerate(one for one in asked if one.name not in there):
            own = list(repeated(listed, given.seed))
            records += own
            worst = max((one["apart"] for one in own if "apart" in one), default=np.nan)
            print(f"{k + 1} {listed.name}: at most {worst:.3f} mm apart", file=sys.stderr, flush=True)
            if given.records:
                with given.records.open("a", encoding="utf-8") as file:
                    file.writelines(json.dumps(one) + "\n" for one in own)
    print(table(records))


if __name__ == "__main__":
    main()
