"""A cohort on two workers of dask against one: python -m benchmarks.cohort [--cases 16]

The demo's atrium with other seeds, the default pipeline, one thread a worker. Two workers shall be at least
1.8 times as fast as one, begin and end included. What the engine takes is what one worker needs from its
first outcome to its last beyond a plain loop over the same cases: at most 5 %. On a machine that does other
work the clock is an upper bound; beside it stands the time of the processor, of which two workers need no
more than one.
"""

from __future__ import annotations

import argparse
import os
import resource
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

from data_synth import atrium
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.pipeline.batch import run_cohort, run_into
from o3dls.pipeline.file import default_pipeline
from o3dls.pipeline.study import planned

FASTER, ENGINE = 1.8, 5.0  # times at least, % at most
FIRST_SEED = 61_001


@dataclass(frozen=True)
class Took:
    """Seconds of a batch: by the clock, of the processor, and from the first outcome to the last."""

    clock: float
    cpu: float
    between: float


def processor() -> float:
    """Seconds that this process, and those it waited for, have had of the processors."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def batch(folders: list[Path], out: Path, workers: int) -> Took:
    """Run the cases on so many workers."""
    ends: list[float] = []
    begin, cpu = perf_counter(), processor()
    study = planned(folders, default_pipeline(), trim=True)
    outcomes = run_cohort(
        study,
        out,
        jobs=workers,
        scheduler="local",
        told=lambda _: ends.append(perf_counter()),
    )
    clock, cpu = perf_counter() - begin, processor() - cpu
    if failed := [str(one) for one in outcomes if one.error]:
        raise SystemExit("\n".join(failed))
    return Took(clock, cpu, ends[-1] - ends[0])


def looped(folders: list[Path], out: Path) -> float:
    """Seconds from the first outcome to the last of a plain loop over the cases."""
    ends = []
    for folder in folders:
        case = read_case(folder)
        run_into(default_pipeline().allowed_by(case), case, out / folder.name)
        ends.append(perf_counter())
    return ends[-1] - ends[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=16, help="how many, at least 2")
    asked = parser.parse_args()
    os.environ["NUMBA_NUM_THREADS"] = "1"
    with TemporaryDirectory() as name:
        folder = Path(name)
        folders = [folder / "cases" / f"atrium_{k:02d}" for k in range(asked.cases)]
        for k, case in enumerate(folders):
            write_case(case, replace(atrium(seed=FIRST_SEED + k), name=case.name))
        batch(folders[:2], folder / "warm", 1)  # compiles the loops
        with ProcessPoolExecutor(1, get_context("spawn")) as process:
            loop = process.submit(looped, folders, folder / "loop").result()
        one, two = (batch(folders, folder / f"by_{n}", n) for n in (1, 2))
    print(f"{'workers':10}{'clock, s':>10}{'cpu, s':>10}")
    for n, took in ((1, one), (2, two)):
        print(f"{n:<10}{took.clock:10.1f}{took.cpu:10.1f}")
    print(f"two are {one.clock / two.clock:.2f} times as fast; at least {FASTER:g} is asked for")
    share = 100.0 * (one.between - loop) / one.between
    print(f"first outcome to last: one {one.between:.1f} s, a plain loop {loop:.1f} s")
    print(f"engine: {share:.1f} % of the time of one; at most {ENGINE:g} is asked for")


if __name__ == "__main__":
    main()
