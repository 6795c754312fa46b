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

    python -m benchmarks.make_cases cross cases --data ../shared/data --judging
    python -m benchmarks.make_cases families cases --data ../shared/data --judging

patients' own atria whose map leaves wall out, as priors of their own and once more as if they were templates,
and priors that are badly segmented:

    python -m benchmarks.make_cases unvisited cases --data ../shared/data --judging
    python -m benchmarks.accuracy cases --ours
    python -m benchmarks.accuracy cases --ours --prior-of template
    python -m benchmarks.make_cases badly_segmented cases --data ../shared/data --judging

Rows: start (landmarks), icp (our robust similarity), deform (T only),
topology (its T, of a changed prior),
level_set (T and phi), each peer as tuned by benchmarks.peers, and with --phantom phantom.py the generator's
bound. Columns: mean +- standard error (worst); ssd_seen and ssd_unseen: between surface and truth, both ways,
in mapped areas and in others; in 95 %: of the wall within its 95 % band; prior only: the same of wall that is
farther than 10 mm from every point. Under the tables of `unvisited` groups there is one of vein wall lost
(benchmarks.scores), and how often a shift of a part of the map was named.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.cases import Listed, find, tuned_as
from o3dls.pipeline.workers import workers

Record = dict[str, Any]


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


def peers(case: Any, group: str, icp: Any, icp_seconds: float) -> Iterator[tuple[str, Any, float]]:
    """Results of the other methods, as tuned for the group; where it was not tuned they are left out."""
    from benchmarks.peers import FAILURES, PEERS, applicable, tuned
    from o3dls.estimate import Estimate

    settings = tuned().get(tuned_as(group), {})
    for name in applicable(case):
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
    ours_alone: bool,
    prior_of: str | None = None,
) -> list[Record]:
    """Records of every method on one case, which says whose anatomy its prior is unless `prior_of` does."""
    from benchmarks.bound import MOTION, bound, load

    case = listed.read()
    case = replace(case, **{"prior_of": prior_of}) if prior_of else case
    results = list(ours(case, plan))
    icp, seconds = next((estimate, seconds) for name, estimate, seconds in results if name == "icp")
    if not ours_alone:
        results += list(peers(case, listed.group, icp, seconds))
    records = [{"method": name, "seconds": took, **record(case, found)} for name, found, took in results]
    if phantom is not None and listed.group in MOTION:
        records.append({"method": "bound", **bound(listed, case, load(phantom))})
    return [{"group": listed.group, "case": listed.name, **record} for record in records]


def record(case: Any, estimate: Any) -> Record:
    """Scores of an estimate, and the codes of what it warns of."""
    from benchmarks.scores import scores, vein_scores

    warned = sorted({warning.code for warning in estimate.warnings})
    return {**scores(case, estimate), **vein_scores(case, estimate.surface), "warnings": warned}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="+", type=Path, help="case folders, or folders of them")
    parser.add_argument("--phantom", type=Path, help="the generator's file, for its bound")
    parser.add_argument("--pipeline", type=Path, help="a pipeline file in place of the default pipeline")
    parser.add_argument("--ours", action="store_true", help="leave the other methods out")
    parser.add_argument("--prior-of", choices=("patient", "template"), help="in place of what the cases say")
    parser.add_argument(
        "--records",
        type=Path,
        help="one JSON line per case and method; cases that are in it already are not run again",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=1,
        help="processes side by side (times are then those of a shared machine)",
    )
    arguments = parser.parse_args()
    # for the processes below
    os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    records = _read(arguments.records)
    done = {record["case"] for record in records}
    todo = [listed for listed in find(arguments.folders) if listed.name not in done]
    with workers(arguments.jobs) as pool:
        for found in pool.map(
            partial(
                run,
                phantom=arguments.phantom,
                plan=arguments.pipeline,
                ours_alone=arguments.ours,
                prior_of=arguments.prior_of,
            ),
            todo,
        ):
            records += found
            _keep(arguments.records, found)
            print(f"{found[0]['case']} done", file=sys.stderr, flush=True)
    from benchmarks.scores import shifts_named, tables, vein_table

    print("\n\n".join(part for part in (tables(records), vein_table(records), shifts_named(records)) if part))


def _read(path: Path | None) -> list[Record]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path and path.is_file() else []


def _keep(path: Path | None, records: list[Record]) -> None:
    if path:
        with path.open("a") as file:
            file.writelines(json.dumps(record) + "\n" for record in records)


if __name__ == "__main__":
    main()
