"""Seconds of every case of a set, and of another version of the program on the same cases: python -m
benchmarks.times FOLDER...

    python -m benchmarks.times cases/judge --each 10
    python -m benchmarks.times cases/judge --each 4 --against ../o3dls_before

Time is that of all stages of the default pipeline, without folds, files and report: of the processor, which
does not mind what else the machine does, and in brackets the median by the clock. Loops are compiled before,
and the first case is run once before it counts. The other version is a folder with its source, which runs in
the same environment; the two take turns, case by case.

Columns: the group, how many cases, median, largest, largest over median (asked: at most 2), and with
--against the median of the other version, ours over it, and that ratio by the clock.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from itertools import groupby
from pathlib import Path
from statistics import median

from benchmarks.cases import Listed, find
from benchmarks.scores import lay_out

HERE = Path(__file__).parents[1]
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
SERVER = """
import json, sys, time
from o3dls.io.case_reader import read_case
from o3dls.pipeline.file import read_pipeline
from o3dls.pipeline.pipeline import Pipeline
from o3dls.resources import pipeline_file
for line in sys.stdin:
    case = read_case(line.strip())
    stages = read_pipeline(pipeline_file("default")).allowed_by(case).stages
    clock, processor = time.perf_counter(), time.process_time()
    Pipeline(stages, folds=0).fit(case)
    print(json.dumps([time.process_time() - processor, time.perf_counter() - clock]), flush=True)
"""
Seconds = tuple[float, float]  # of the processor, by the clock


class Version:
    """A process that runs cases by the source in a folder."""

    def __init__(self, source: Path) -> None:
        variables = os.environ | ONE_THREAD | {"PYTHONPATH": str(source)}
        compiled = [sys.executable, "-m", "o3dls", "doctor", "--compile", "-q"]
        subprocess.run(compiled, cwd=source, env=variables, check=True, stdout=subprocess.DEVNULL)
        self.process = subprocess.Popen(
            [sys.executable, "-c", SERVER],
            cwd=source,
            env=variables,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

    def seconds(self, case: Path) -> Seconds:
        """What the case takes. Raises SystemExit where it cannot be run."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(case.resolve(), file=self.process.stdin, flush=True)
        for line in self.process.stdout:
            if line.startswith("["):  # libraries say things there too
                processor, clock = json.loads(line)
                return processor, clock
        raise SystemExit(f"{case}: the program ended without a result")

    def close(self) -> None:
        self.process.communicate()


def chosen(folders: list[Path], each: int | None) -> list[Listed]:
    """The first cases of each group."""
    groups = groupby(find(folders), key=lambda case: case.group)
    return [case for _, members in groups for case in list(members)[:each]]


def row(group: str, ours: list[Seconds], theirs: list[Seconds]) -> list[str]:
    """A line of the table."""
    processor, clock = (median(column) for column in zip(*ours, strict=True))
    most = max(seconds for seconds, _ in ours)
    times = [f"{processor:.2f} ({clock:.2f})", f"{most:.2f}", f"{most / processor:.2f}"]
    cells = [group, str(len(ours)), *times]
    if not theirs:
        return cells
    before, by_clock = (median(column) for column in zip(*theirs, strict=True))
    return [*cells, f"{before:.2f} ({by_clock:.2f})", f"{processor / before:.2f}", f"{clock / by_clock:.2f}"]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="+", type=Path, help="case folders, or folders of them")
    parser.add_argument("--each", type=int, metavar="N", help="no more cases of a group than this")
    parser.add_argument("--against", type=Path, metavar="SOURCE", help="folder of another version's source")
    given = parser.parse_args()
    cases = chosen(given.folders, given.each)
    versions = [Version(source) for source in (HERE, given.against) if source]
    for version in versions:
        version.seconds(cases[0].folder)
    head = ["group", "cases", "seconds", "largest", "over median"]
    rows = [head + ["other version", "ours over it", "by the clock"] * (given.against is not None)]
    for group, members in groupby(cases, key=lambda case: case.group):
        found: list[list[Seconds]] = [[], []]
        for case in members:
            for times, version in zip(found, versions, strict=False):
                times.append(version.seconds(case.folder))
            said = "  ".join(f"{times[-1][0]:.2f}" for times in found if times)
            print(f"{case.name}  {said}", file=sys.stderr, flush=True)
        rows.append(row(group, *found))
    for version in versions:
        version.close()
    print(lay_out(rows))


if __name__ == "__main__":
    main()
