"""The verdict as a classifier: python -m benchmarks.verdict FOLDER... --records FILE

    python -m benchmarks.make_cases altered cases/dev --data ../shared/data
    python -m benchmarks.verdict cases/dev --records dev.jsonl --runs runs/dev      every case, one line each
    python -m benchmarks.verdict cases/dev --records dev.jsonl --peers poisson      and a peer's error
    python -m benchmarks.verdict --table dev.jsonl --csv dev.csv
    python -m benchmarks.verdict --again runs/dev --records dev.jsonl --out new.jsonl

Each case is run as `o3dls run --case` runs it, without folds unless asked for, and graded as a user sees it
who has no truth: truth, held-out points and correspondence are hidden from the run. With `--runs` the run
folders stay, and `--again` grades them anew, without fitting, when the checks have changed; warnings are
those of the fit. A line has the grade, every check and warning, the expected error, the raw statistics that a
check could use (benchmarks.verdict_statistics) and the true errors of every estimate. What is a bad result,
and what the table says of them, is in benchmarks.verdict_table.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from benchmarks.cases import Listed, find
from o3dls.pipeline.workers import workers

Record = dict[str, Any]
PEERS = ("thin-plate", "poisson", "pycpd", "nricp_sumner", "open3d icp")  # the quick ones first


def judged(listed: Listed, folds: int = 0, keep: Path | None = None) -> Record:
    """The record of one case, run and graded without its truth; a case that is refused says why."""
    from benchmarks.verdict_statistics import statistics
    from benchmarks.verdict_truth import true_errors
    from o3dls.errors import O3dlsError
    from o3dls.pipeline.file import default_pipeline

    case = listed.read()
    about = {"group": listed.group, "case": listed.name, "points": int((case.points.type == "eam").sum())}
    hidden = replace(case, truth=None)
    begin = perf_counter()
    try:
        plan = replace(default_pipeline().allowed_by(hidden), writes=(), folds=folds)
        run = plan.run(hidden)
    except O3dlsError as error:
        return {**about, "error": str(error), "seconds": perf_counter() - begin}
    seconds = {"seconds": perf_counter() - begin}
    with TemporaryDirectory() as temporary:
        folder = run.write((keep or Path(temporary)) / listed.name, force=True)
        graded = grading(folder)
    truth = {"truth": true_errors(case, run.estimates)}
    return {**about, **graded, **seconds, "stats": statistics(run), **truth}


def grading(folder: Path) -> Record:
    """What a user is told of a finished run: grade, checks, warnings, expected error."""
    from o3dls.cli.summary import summary
    from o3dls.report.checks import checks
    from o3dls.report.expected import expected_error
    from o3dls.report.subject import read_subject
    from o3dls.run_warning import each_once

    subject = read_subject([folder])
    warned = each_once(one for e in subject.last.run.estimates.values() for one in e.warnings)
    expected = expected_error(subject)
    return {
        "grade": summary(folder).grade,
        "final": subject.last.key,
        "checks": [{"name": one.name, "grade": one.grade, "said": one.said} for one in checks(subject)],
        "warnings": [warning.record() for warning in warned],
        "headline": None if expected is None else vars(expected),
        "validity": dict(subject.last.validity),
    }


def graded_again(record: Record, runs: Path) -> Record:
    """The record with what the checks say now of the run that was kept, and with statistics that are new."""
    from benchmarks.verdict_statistics import statistics
    from o3dls.runs.folder import read_run

    folder = runs / record["case"]
    if "error" in record or not folder.is_dir():
        return record
    stats = record["stats"] | statistics(read_run(folder))
    return record | grading(folder) | {"stats": stats}


def compared(listed: Listed, records: dict[str, Record], names: list[str]) -> Record:
    """The mean errors of some peers on a case, from the pose of its ICP."""
    from benchmarks.verdict_truth import peers_errors

    pose = records[listed.name]["stats"]["icp_pose"]
    return {"case": listed.name, "peers": peers_errors(listed, pose, names)}


def read_records(path: Path | None) -> dict[str, Record]:
    """Records by case: lines of one case are joined, and so are their peers."""
    found: dict[str, Record] = {}
    lines = path.read_text().splitlines() if path and path.is_file() else []
    for record in map(json.loads, lines):
        before = found.get(record["case"], {})
        peers = before.get("peers", {}) | record.get("peers", {})
        found[record["case"]] = before | record | ({"peers": peers} if peers else {})
    return found


def _kept(path: Path | None, records: Iterable[Record]) -> None:
    """Append each record as it comes, and say so."""
    for record in records:
        said = record.get("error") or record.get("grade") or record.get("peers")
        print(f"{record['case']}: {said}", file=sys.stderr, flush=True)
        if path:
            with path.open("a") as file:
                file.write(json.dumps(record) + "\n")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="*", type=Path, help="case folders, or folders of them")
    parser.add_argument("--records", type=Path, help="one JSON line per case; those in it are not run again")
    parser.add_argument("--jobs", type=int, default=1, help="processes side by side")
    parser.add_argument("--folds", type=int, default=0, help="folds of the cross-validation")
    parser.add_argument("--runs", type=Path, help="keep the run folders here")
    parser.add_argument(
        "--peers",
        nargs="*",
        choices=PEERS,
        metavar="NAME",
        help="run these peers, or all, on the cases that have none of them yet",
    )
    parser.add_argument("--table", type=Path, help="print the table of these records")
    parser.add_argument("--csv", type=Path, help="with --table: every case as a row")
    parser.add_argument("--again", type=Path, help="grade the run folders kept here anew, into --out")
    parser.add_argument("--out", type=Path, help="with --again: where the records go")
    return parser.parse_args()


def _run(arguments: argparse.Namespace) -> None:
    records = read_records(arguments.records)
    listed = find(arguments.folders)
    if arguments.peers is not None:
        names = arguments.peers or list(PEERS)
        graded = [one for one in listed if "grade" in records.get(one.name, {})]
        todo = [one for one in graded if not set(names) & records[one.name].get("peers", {}).keys()]
        work = partial(compared, records={one.name: records[one.name] for one in todo}, names=names)
    else:
        todo = [one for one in listed if one.name not in records]
        work = partial(judged, folds=arguments.folds, keep=arguments.runs)
    with workers(arguments.jobs) as pool:
        _kept(arguments.records, pool.map(work, todo))


def main() -> None:
    from benchmarks.verdict_table import table, write_csv

    arguments = _arguments()
    os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    if arguments.again:
        found = (graded_again(r, arguments.again) for r in read_records(arguments.records).values())
        _kept(arguments.out, found)
    elif not arguments.table:
        _run(arguments)
    shown = arguments.table or arguments.out or arguments.records
    records = list(read_records(shown).values())
    print(table(records))
    if arguments.csv:
        write_csv(arguments.csv, records)


if __name__ == "__main__":
    main()
