"""Activation times and velocities against waves that are known: python -m benchmarks.activation DATA

DATA holds priors/lasc2018. Waves of data_synth.waves go over its atria, la_60 to la_79 to develop, la_80 to
la_99 to judge: they solve the eikonal equation with uneven speed (.6 to 1 m/s, two slow patches of .2 to .4
m/s) from one focus or two, about lines of block, or round and round a vein. They are mapped at 250, 500 or
1000 points, even or clustered with a quarter of the wall unseen, with errors of place of 1 mm per axis, noise
of 3 to 6 ms, and 5 % of the times annotated anywhere in the window.

    python -m benchmarks.activation ../shared/data --cases 24 --judging

Columns, over the wall that the map tells of: cases; the mean error in ms of ours, of a plain Gaussian process
(Matern 3/2 of the straight distance, tuned by marginal likelihood, with noise), of quLATi where its results
were given, and of the mean of near points by a Gaussian (as `lat` of a run); how much of the wall has its
true time in our 95 % interval and in that of the plain process, in percent; on how much of the wall a
velocity is told; the median of the told speed over the true one there, and of one over the length of the
slope of the mean of near points; that of the told speed on slow wall alone; how much of it has the true speed
in its interval; seconds of the processor. Waves that go round and round are places on a circle for the others
too: they fit its two coordinates.

A second table has the told speed by number of points and true speed, with the share of that wall on which one
is told, how much of it has the true speed in its interval, and the speed (exact) of the true times themselves
where their slope is averaged over 3 mm.

Another program is compared in an environment of its own: --write FOLDER writes what it needs of each case
(NAME.npz: vertices, faces, face and weights of each point, time, cycle, 0 where there is none), --read FOLDER
takes its answer (NAME.npz: time and sd at the vertices).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from time import process_time

import numpy as np

from benchmarks.activation_peers import average, blur_speed, fit_plain
from benchmarks.cases import LASC
from benchmarks.scores import lay_out
from data_synth import motion, read_wall
from data_synth.waves import KINDS, MappedWave, Wave, map_wave, wave
from o3dls.arrays import Array
from o3dls.evaluation.activation.activation_map import map_activation
from o3dls.evaluation.activation.velocity import Told
from o3dls.evaluation.activation.winding import wrap
from o3dls.evaluation.projection import project
from o3dls.geometry.surface import Surface

POINTS = (250, 500, 1000)
CLASSES = (0.2, 0.3, 0.45, 0.7, 0.8, 0.9, 1.01)  # m/s, borders of classes of the true speed
FIRST_SEED = {False: 5201, True: 7301}
SLOW = 0.45  # m/s
OVER, SAMPLES = 25.0, 200  # mm over which an error of registration varies; samples of it
TWO_SIDED = 1.96
UNKNOWN = 100.0


@dataclass(frozen=True, eq=False)
class MappedCase:
    """A case has its name, kind, surface, true wave and map; and samples (s, n, 3) of how far each vertex may
    lie from where it should, None where the wall is the true one.
    """

    name: str
    kind: str
    points: int
    surface: Surface
    wave: Wave
    map: MappedWave
    errors: Array | None


def make_cases(data: Path, count: int, *, judging: bool, registration: float = 0.0) -> Iterator[MappedCase]:
    """Make so many cases: kinds, numbers of points, even and clustered ones and atria in turn. registration:
    sd of its error in mm per axis.
    """
    numbers = LASC[judging]
    for k in range(count):
        kind, points, clustered = KINDS[k % 4], POINTS[k % 3], k // 4 % 2 == 1
        seed = FIRST_SEED[judging] + k
        surface = read_wall(data / "priors" / "lasc2018" / f"la_{numbers[k % len(numbers)]}.ply")
        found = wave(surface, seed, kind)
        name = f"{kind.replace(' ', '_')}_{points}_{'clustered' if clustered else 'even'}_{seed}"
        mapped = map_wave(surface, found, seed, points, clustered=clustered)
        moved, errors = misplace(surface, seed, registration) if registration else (surface, None)
        yield MappedCase(name, kind, points, moved, found, mapped, errors)


def misplace(surface: Surface, seed: int, sd: float) -> tuple[Surface, Array]:
    """Return the surface as a registration with errors has it, and samples (s, n, 3) of its errors."""
    rng = np.random.default_rng((seed, 40_127))
    at = surface.vertices
    drawn = np.stack([motion.wobble(rng, sd, OVER, 3)(at) - at for _ in range(SAMPLES + 1)])
    return replace(surface, vertices=at + drawn[0]), drawn[1:]


@dataclass(frozen=True, eq=False)
class Judged:
    """What is judged of a case: its kind, number of points and numbers; and at each vertex the area (n,) that
    is mapped, the true speed, the told one with its interval, whether it is told, and that of the blurred
    true times.
    """

    kind: str
    points: int
    numbers: dict[str, float]
    speeds: dict[str, Array]


def judge_case(case: MappedCase, answers: Path | None) -> Judged:
    """Return what is found of one case."""
    surface, true = case.surface, case.wave
    began = process_time()
    found = map_activation(surface, case.map.xyz, case.map.time, errors=case.errors, cycle=true.cycle)
    seconds = process_time() - began
    area = surface.vertex_areas * (found.known & np.isfinite(true.time))
    time = np.nan_to_num(true.time)

    def miss(answer: Array) -> Array:
        return np.abs(wrap(answer - time, true.cycle))

    plain, plain_sd = fit_plain(surface, case.map, true.cycle)
    averaged, naive = average(surface, case.map, true.cycle)
    told, speed = area * (found.told == Told.VELOCITY), found.velocity
    slow = told * (true.speed < SLOW)
    held = (speed.low <= true.speed) & (true.speed <= speed.high)
    missed = miss(found.time)
    numbers = {
        "error": _mean(missed, area),
        "plain": _mean(miss(plain), area),
        "quLATi": np.nan,
        "averaged": _mean(miss(averaged), area * np.isfinite(averaged)),
        "in 95 %": 100.0 * _mean(missed <= TWO_SIDED * found.sd, area),
        "plain in 95 %": 100.0 * _mean(miss(plain) <= TWO_SIDED * plain_sd, area),
        "told": 100.0 * float(told.sum() / area.sum()),
        "speed": _median(speed.speed / true.speed, told),
        "naive": _median(naive / true.speed, told),
        "slow": _median(speed.speed / true.speed, slow),
        "speed in 95 %": 100.0 * _mean(held, told),
        "seconds": seconds,
    }
    if answers is not None and (answers / f"{case.name}.npz").exists():
        with np.load(answers / f"{case.name}.npz") as answer:
            numbers["quLATi"] = _mean(miss(answer["time"]), area)
    exact = blur_speed(found.posterior.harmonics, true)
    speeds = {"area": area, "told": told, "true": true.speed, "speed": speed.speed, "held": held * 1.0}
    return Judged(case.kind, case.points, numbers, speeds | {"exact": exact})


def _mean(values: Array, area: Array) -> float:
    return float(area @ np.nan_to_num(values) / area.sum()) if area.sum() > 0.0 else np.nan


def _median(values: Array, area: Array) -> float:
    if not area.sum() > 0.0:
        return np.nan
    order = np.argsort(values)
    total = np.cumsum(area[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def write_case(folder: Path, case: MappedCase) -> None:
    """Write what another program needs of a case."""
    met = project(case.map.xyz, case.surface)
    np.savez(
        folder / f"{case.name}.npz",
        vertices=case.surface.vertices,
        faces=case.surface.faces,
        face=met.face,
        weights=met.weights,
        time=case.map.time,
        cycle=case.wave.cycle or 0.0,
    )


def table(cases: Sequence[Judged]) -> str:
    """A row for each kind of wave, for each number of points, and for all."""
    rows = [["waves", "cases", *cases[0].numbers]]
    for name, some in group_cases(cases):
        numbers = [one.numbers for one in some]
        rows.append([name, str(len(some)), *(_average_cell(numbers, key) for key in numbers[0])])
    return lay_out(rows)


def group_cases(cases: Sequence[Judged]) -> Iterator[tuple[str, list[Judged]]]:
    """Name the cases of each kind of wave, of each number of points, and all."""
    for name, wanted in (
        [(kind, kind) for kind in KINDS] + [(f"{n} points", n) for n in POINTS] + [("all", None)]
    ):
        some = [one for one in cases if wanted in (None, one.kind, one.points)]
        if some:
            yield name, some


def table_of_speeds(cases: Sequence[Judged]) -> str:
    """A row for each number of points and class of the true speed: of how much of that wall a speed is told,
    the told speed over the true one, how much of it has that in its interval, and what blurred true times
    tell of it.
    """
    rows = [["points", "true speed", "told", "speed", "in 95 %", "exact"]]
    for name, some in group_cases(cases):
        if name in KINDS:
            continue
        at = {key: np.concatenate([one.speeds[key] for one in some]) for key in some[0].speeds}
        for low, high in pairwise(CLASSES):
            inside = (at["true"] >= low) & (at["true"] < high)
            told = at["told"] * inside
            if not told.any():
                continue
            share = 100.0 * told.sum() / (at["area"] * inside).sum()
            ratios = (_median(at[key] / at["true"], told) for key in ("speed", "exact"))
            ours, exact = (f"{one:.2f}" for one in ratios)
            held = 100.0 * _mean(at["held"], told)
            rows.append([name, f"{low:g} to {high:g}", f"{share:.0f}", ours, f"{held:.0f}", exact])
    return lay_out(rows)


def _average_cell(some: Sequence[dict[str, float]], key: str) -> str:
    known = np.array([one[key] for one in some])
    known = known[np.isfinite(known)]
    return f"{known.mean():.2f}" if len(known) else ""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path, help="the folder above priors/")
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--judging", action="store_true", help="of the atria that nothing is chosen on")
    parser.add_argument("--registration", type=float, default=0.0, metavar="MM", help="sd of its error")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write the cases for another program")
    parser.add_argument("--read", type=Path, metavar="FOLDER", help="answers of another program")
    asked = parser.parse_args()
    judged = list[Judged]()
    made = make_cases(asked.data, asked.cases, judging=asked.judging, registration=asked.registration)
    for case in made:
        if asked.write:
            asked.write.mkdir(parents=True, exist_ok=True)
            write_case(asked.write, case)
            continue
        judged.append(judge_case(case, asked.read))
        print(case.name, {k: round(v, 2) for k, v in judged[-1].numbers.items()}, file=sys.stderr, flush=True)
    if judged:
        print(table(judged), table_of_speeds(judged), sep="\n\n")


if __name__ == "__main__":
    main()
