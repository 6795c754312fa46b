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

Another program is compared in an environment of its own: --write FOLDER writes what it needs of each case
(NAME.npz: vertices, faces, face and weights of each point, time, cycle, 0 where there is none), --read FOLDER
takes its answer (NAME.npz: time and sd at the vertices).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.distance import cdist

from benchmarks.cases import LASC
from benchmarks.scores import lay_out
from data_synth import read_wall
from data_synth.waves import KINDS, MappedWave, Wave, map_wave, wave
from o3dls.arrays import Array
from o3dls.evaluation.activation.activation_map import map_activation
from o3dls.evaluation.activation.velocity import Told
from o3dls.evaluation.activation.winding import wrap
from o3dls.evaluation.interpolation import to_surface
from o3dls.evaluation.measures.numbers import slopes
from o3dls.evaluation.projection import project
from o3dls.geometry.surface import Surface

POINTS = (250, 500, 1000)
FIRST_SEED = {False: 5201, True: 7301}
SLOW = 0.45  # m/s
TWO_SIDED = 1.96
UNKNOWN = 100.0


@dataclass(frozen=True, eq=False)
class MappedCase:
    """A case has its name, kind, surface, true wave and map."""

    name: str
    kind: str
    points: int
    surface: Surface
    wave: Wave
    map: MappedWave


def make_cases(data: Path, count: int, *, judging: bool) -> Iterator[MappedCase]:
    """Make so many cases: kinds, numbers of points, even and clustered ones and atria in turn."""
    numbers = LASC[judging]
    for k in range(count):
        kind, points, clustered = KINDS[k % 4], POINTS[k % 3], k // 4 % 2 == 1
        seed = FIRST_SEED[judging] + k
        surface = read_wall(data / "priors" / "lasc2018" / f"la_{numbers[k % len(numbers)]}.ply")
        found = wave(surface, seed, kind)
        name = f"{kind.replace(' ', '_')}_{points}_{'clustered' if clustered else 'even'}_{seed}"
        mapped = map_wave(surface, found, seed, points, clustered=clustered)
        yield MappedCase(name, kind, points, surface, found, mapped)


def judge_case(case: MappedCase, answers: Path | None) -> dict[str, float]:
    """Return the numbers of one case."""
    surface, true = case.surface, case.wave
    began = process_time()
    found = map_activation(surface, case.map.xyz, case.map.time, cycle=true.cycle)
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
    return numbers


def _mean(values: Array, area: Array) -> float:
    return float(area @ np.nan_to_num(values) / area.sum()) if area.sum() > 0.0 else np.nan


def _median(values: Array, area: Array) -> float:
    if not area.sum() > 0.0:
        return np.nan
    order = np.argsort(values)
    total = np.cumsum(area[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def _coordinates(mapped: MappedWave, cycle: float | None) -> Array:
    """Return what is fitted at the points (k, c): the time, or exp(i phase)."""
    if cycle is None:
        return mapped.time[:, None]
    phase = 2.0 * np.pi * mapped.time / cycle
    return np.column_stack([np.cos(phase), np.sin(phase)])


def fit_plain(surface: Surface, mapped: MappedWave, cycle: float | None) -> tuple[Array, Array]:
    """Return the mean and sd (n,) of a plain Gaussian process in ms."""
    values = _coordinates(mapped, cycle)
    middle, scale = values.mean(axis=0), float(values.std())
    values = (values - middle) / scale
    distance = cdist(mapped.xyz, mapped.xyz)

    def covariance(apart: Array, log: Array) -> Array:
        scaled = np.sqrt(3.0) * apart / np.exp(log[1])
        return np.exp(2.0 * log[0]) * (1.0 + scaled) * np.exp(-scaled)

    def surprise(log: Array) -> float:
        joint = covariance(distance, log)
        joint[np.diag_indices_from(joint)] += np.exp(2.0 * log[2]) + 1e-8
        factor = np.linalg.cholesky(joint)
        white = np.linalg.solve(factor, values)
        return float(0.5 * (white**2).sum() + values.shape[1] * np.log(np.diag(factor)).sum())

    bounds = [(-3.0, 3.0), (0.0, 5.0), (-4.0, 1.0)]
    log = minimize(surprise, np.log([1.0, 30.0, 0.3]), method="L-BFGS-B", bounds=bounds).x
    joint = covariance(distance, log)
    joint[np.diag_indices_from(joint)] += np.exp(2.0 * log[2]) + 1e-8
    cross = covariance(cdist(surface.vertices, mapped.xyz), log)
    answer = np.linalg.solve(joint, np.hstack([values, cross.T]))
    mean = middle + scale * cross @ answer[:, : values.shape[1]]
    left = np.exp(2.0 * log[0]) - (cross.T * answer[:, values.shape[1] :]).sum(axis=0)
    sd = scale * np.sqrt(np.maximum(left, 0.0))
    if cycle is None:
        return mean[:, 0], sd
    turn = cycle / (2.0 * np.pi)
    return np.arctan2(mean[:, 1], mean[:, 0]) * turn, sd / np.linalg.norm(mean, axis=1) * turn


def average(surface: Surface, mapped: MappedWave, cycle: float | None) -> tuple[Array, Array]:
    """Return the mean of near times (n,) and the speed (n,) by its slope."""
    values = np.column_stack([
        to_surface(mapped.xyz, one, surface) for one in _coordinates(mapped, cycle).T
    ])  # fmt: skip
    steep = np.stack([slopes(surface, one) for one in values.T])
    if cycle is None:
        return values[:, 0], 1.0 / np.maximum(np.linalg.norm(steep[0], axis=1), 1e-9)
    turn, size = cycle / (2.0 * np.pi), (values**2).sum(axis=1)
    steep = turn * (values[:, :1] * steep[1] - values[:, 1:] * steep[0]) / size[:, None]
    speed = 1.0 / np.maximum(np.linalg.norm(np.nan_to_num(steep), axis=1), 1e-9)
    return np.arctan2(values[:, 1], values[:, 0]) * turn, speed


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


def table(cases: Sequence[tuple[str, int, dict[str, float]]]) -> str:
    """A row for each kind of wave, for each number of points, and for all."""
    rows = [["waves", "cases", *cases[0][2]]]
    for name, wanted in (
        [(kind, kind) for kind in KINDS] + [(f"{n} points", n) for n in POINTS] + [("all", None)]
    ):
        some = [numbers for kind, points, numbers in cases if wanted in (None, kind, points)]
        if some:
            rows.append([name, str(len(some)), *(_average_cell(some, key) for key in some[0])])
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
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write the cases for another program")
    parser.add_argument("--read", type=Path, metavar="FOLDER", help="answers of another program")
    asked = parser.parse_args()
    judged = list[tuple[str, int, dict[str, float]]]()
    for case in make_cases(asked.data, asked.cases, judging=asked.judging):
        if asked.write:
            asked.write.mkdir(parents=True, exist_ok=True)
            write_case(asked.write, case)
            continue
        judged.append((case.kind, case.points, judge_case(case, asked.read)))
        print(case.name, {k: round(v, 2) for k, v in judged[-1][2].items()}, file=sys.stderr, flush=True)
    if judged:
        print(table(judged))


if __name__ == "__main__":
    main()
