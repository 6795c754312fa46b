"""Time and memory of `o3dls run` over the faces of the prior and the points of the map: python -m
benchmarks.sizes

Each case is made afresh (data_synth's atrium, --seed), its prior split and decimated to so many faces, and
run as from the shell, loops compiled: files, report and pictures are in the time. Columns: faces, points and
folds of the cross-validation, seconds by the clock and of all processors, and the most memory that all
processes of the run hold together (shared pages count once; asked every 50 ms), in MB. On a machine that does
other work the clock is an upper bound.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, sleep

import psutil

from benchmarks.speed import refined
from data_synth.atrium import atrium
from o3dls.io.case_writer import write_case
from o3dls.pipeline.file import default_pipeline
from o3dls.resources import demo_case, pipeline_file

FACES, POINTS = (1000, 20_000, 100_000, 500_000), (250, 1000, 4000, 20_000)
USUAL = 250  # points where the faces are varied
AS_INSTALLED = {"PYTHONDONTWRITEBYTECODE": ""}  # modules are compiled once, whatever this shell says
LIMITS = {  # seconds, MB: on two cores that do nothing else
    (100_000, True): "15 s",
    (500_000, False): "30 s, 1200 MB",
}


def held_memory(process: psutil.Process) -> float:
    """MB that a process and all that it began hold together; pages that they share count once."""
    total = 0.0
    for one in [process, *process.children(recursive=True)]:
        try:
            total += getattr(one.memory_full_info(), "pss", 0)
        except psutil.Error:  # it has ended since
            continue
    return total / 1024.0**2


def timed_run(case: Path, out: Path, pipeline: list[str]) -> tuple[float, float, float]:
    """Seconds by the clock, seconds of all processors and largest MB of `o3dls run` on a case folder.

    :raises subprocess.CalledProcessError: if the run fails
    """
    command = [sys.executable, "-m", "o3dls", "run", *pipeline, "--case", str(case), "--out", str(out), "-q"]
    before, begin, most = os.times(), perf_counter(), 0.0
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, env=os.environ | AS_INSTALLED) as run:
        process = psutil.Process(run.pid)
        while run.poll() is None:
            most = max(most, held_memory(process))
            sleep(0.05)
    seconds, after = perf_counter() - begin, os.times()
    if run.returncode:
        raise subprocess.CalledProcessError(run.returncode, command)
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    return seconds, spent, most


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=6401, help="of the synthetic atrium")
    parser.add_argument("--faces", type=int, nargs="+", default=FACES, help="of the prior")
    parser.add_argument("--points", type=int, nargs="*", default=POINTS, help="of the map")
    given = parser.parse_args()
    sizes = [(faces, USUAL) for faces in given.faces] + [(FACES[1], points) for points in given.points]
    print("| faces | points | folds | seconds | processor, s | memory, MB | asked |")
    print("|---|---|---|---|---|---|---|")
    with TemporaryDirectory(prefix="o3dls-sizes-") as name:
        folder, folds = Path(name), default_pipeline().folds
        alone = folder / "no_folds.toml"
        alone.write_text(f"folds = 0\n{pipeline_file('default').read_text(encoding='utf-8')}")
        timed_run(demo_case(), folder / "warm", [])  # compiles what is not
        for k, (faces, points) in enumerate(dict.fromkeys(sizes)):
            made = atrium(given.seed, points=points)
            prior = refined(made.prior, faces)
            write_case(folder / f"case{k}", replace(made, prior=prior))
            for few in (True, False):
                pipeline = [str(alone)] if few else []
                found = timed_run(folder / f"case{k}", folder / f"run{k}{few}", pipeline)
                asked = LIMITS.get((faces, not few), "") if points == USUAL else ""
                row = [len(prior.faces), points, 0 if few else folds, *(f"{x:.1f}" for x in found[:2])]
                print(f"| {' | '.join(map(str, row))} | {found[2]:.0f} | {asked} |", flush=True)


if __name__ == "__main__":
    main()
