"""Voltage over late enhancement, against lines that are known: python -m benchmarks.slope DATA

DATA holds priors/lasc2018. Atria of it, la_60 to la_79 to develop, la_80 to la_99 to judge, are enhanced in
patches and move by the families of data_synth.scarred; each point has the voltage of the place where the
catheter truly was. T alone (stage `deform`) brings the enhancement to the points.

Columns, in percent of the true slope: how far the mean slope is off, with its standard error, by ordinary
least squares at the nearest place of the wall after `icp` and after `deform` (naive), by ours, and by
ordinary least squares at the true places, which no map knows: how far the cases themselves are off by chance;
the rms of ours; how many true slopes its 95 % intervals hold. Then the same of the ratio at which there is
0.5 mV, in hundredths.

    python -m benchmarks.slope ../shared/data --cases 80 --judging
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.cases import LASC
from benchmarks.scores import lay_out
from data_synth import Mapping, read_wall
from data_synth.families import FAMILIES
from data_synth.scarred import LOW, RATIO, Scarred, scarred
from o3dls.arrays import Array
from o3dls.case import Case, Points
from o3dls.estimate import Estimate
from o3dls.evaluation.measures.intervals import LEVEL
from o3dls.evaluation.measures.line import Line, crossing, fit_line
from o3dls.evaluation.measures.readings import read_at_points
from o3dls.evaluation.projection import project
from o3dls.geometry.surface import Surface, interpolated
from o3dls.pipeline.file import read_pipeline
from o3dls.pipeline.pipeline import Pipeline
from o3dls.resources import pipeline_file

SAMPLES, SEED = 200, 60_331
FIRST_SEED = {False: 811, True: 2811}
BELIEVED = 0.5
COLUMNS = ("icp", "naive", "ours", "true places")


@dataclass(frozen=True)
class Judged:
    """A case has its number of points; slope and crossing by each way (4,), over the true ones; and whether
    the intervals hold these.
    """

    points: int
    slope: Array
    half: Array
    slope_held: bool
    half_held: bool


def cases(data: Path, count: int, points: int, *, judging: bool, later: int = 0) -> Iterator[Scarred]:
    """Cases with a number of points, of each atrium in turn; families, and maps that are even or in clusters,
    take turns.
    """
    numbers = LASC[judging]
    for k in range(count):
        seed = FIRST_SEED[judging] + later + k
        family = list(FAMILIES)[(k + k // len(numbers)) % len(FAMILIES)]
        how = Mapping(points, clustered=k // len(FAMILIES) % 2 == 0)
        prior = read_wall(data / "priors" / f"lasc2018/la_{numbers[k % len(numbers)]}.ply")
        yield scarred(prior, seed, family=family, how=how)


def fit_motion_alone(case: Case) -> dict[str, Estimate]:
    """Estimates of the default pipeline up to `deform`, by their stages."""
    plan = read_pipeline(pipeline_file("default")).allowed_by(case)
    stages = [stage for stage in plan.stages if stage.name in ("landmarks", "icp", "deform")]
    return dict(Pipeline(stages, folds=0).fit(case.visible()))


def judge(made: Scarred) -> Judged:
    """Fit the line of a case in every way."""
    found = fit_motion_alone(made.case)
    points = made.case.points.of("eam")
    values = np.log(points.numbers("bipolar"))
    low = float(np.log(LOW))
    field = made.case.prior.fields[RATIO]
    line = _fit(found["deform"], field, points, values)
    assert line is not None
    design = np.column_stack([np.ones(len(values)), points.numbers(f"{RATIO}_true")])
    true_places = np.linalg.lstsq(design, values, rcond=None)[0]
    lines = (
        _fit_at_nearest(found["icp"].surface, field, points.xyz, values),
        line.naive,
        line.found,
        true_places,
    )
    ends = line.slope_interval(LEVEL), line.crossing_interval(low, LEVEL)
    return Judged(
        len(values),
        np.array([one[1] / made.slope - 1.0 for one in lines]),
        np.array([crossing(one, low) - made.half for one in lines]),
        ends[0][0] <= made.slope <= ends[0][1],
        not ends[1][0] > made.half and not ends[1][1] < made.half,
    )


def _fit(estimate: Estimate, field: Array, points: Points, values: Array) -> Line | None:
    """Fit the line as `o3dls measure` does, of a field of the prior whose vertices the estimate has."""
    values = np.where(np.asarray(estimate.weights) < BELIEVED, np.nan, values)
    noise = (estimate.sigma or 0.0) * points.relative_noise()
    samples, rng = estimate.samples(SAMPLES, SEED), np.random.default_rng(SEED)
    return fit_line(values, read_at_points(samples, field, points.xyz, noise, rng))


def _fit_at_nearest(surface: Surface, field: Array, xyz: Array, values: Array) -> Array:
    """Level and slope (2,) by ordinary least squares at the nearest places of a surface."""
    met = project(xyz, surface)
    read = interpolated(field, surface.faces[met.face], met.weights)
    return np.asarray(np.linalg.lstsq(np.column_stack([np.ones(len(read)), read]), values, rcond=None)[0])


def table(judged: list[Judged]) -> str:
    """A row for the slopes, and one for the crossings."""
    rows = [["of", "cases", *COLUMNS, "ours less true places", "rms of ours", "% in 95 %"]]
    for name, off, held in (
        ("slope, %", np.array([one.slope for one in judged]), [one.slope_held for one in judged]),
        (
            f"ratio at {LOW:g} mV, /100",
            np.array([one.half for one in judged]),
            [one.half_held for one in judged],
        ),
    ):
        off = 100.0 * off
        means = [_show_mean(column) for column in (*off.T, off[:, 2] - off[:, 3])]
        rms = f"{np.sqrt((off[:, 2] ** 2).mean()):.1f}"
        rows.append([name, str(len(off)), *means, rms, f"{100.0 * np.mean(held):.1f}"])
    return lay_out(rows)


def _show_mean(values: Array) -> str:
    return f"{values.mean():+.1f} ± {values.std(ddof=1) / np.sqrt(len(values)):.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path, help="the folder above priors/")
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--points", type=int, default=250)
    parser.add_argument("--judging", action="store_true", help="of the atria that nothing is chosen on")
    parser.add_argument("--later", type=int, default=0, metavar="N", help="add N to the seeds")
    asked = parser.parse_args()
    judged = list[Judged]()
    for made in cases(asked.data, asked.cases, asked.points, judging=asked.judging, later=asked.later):
        judged.append(judge(made))
        print(made.case.name, np.round(100.0 * judged[-1].slope, 1), file=sys.stderr, flush=True)
    print(table(judged))


if __name__ == "__main__":
    main()
