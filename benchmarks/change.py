"""What `o3dls change` says of two maps of one heart, against what truly changed: python -m benchmarks.change
FOLDER

Pairs are made of atria of lasc2018 by data_synth.redo, la_60 to la_79 to develop and la_80 to la_99 to judge:
two maps each, with another motion, other points, other noise of places (1 mm per axis) and values (20 %), and
another gain (a factor of .8 to 1.25); 250, 500 or 1000 points, in every second pair clustered with a quarter
of the wall unseen. The truth is smooth and patchy with old scars; in some pairs the second map has a new scar
of 2 to 6 cm2 below .5 mV, on wall that both maps see.

    python -m benchmarks.change pairs --make 24 50 --data ../shared/data --judging
    python -m benchmarks.change pairs

Runs are made by the default pipeline without folds and kept in the folders of the pairs. Columns: pairs; in
how many the new scar was found; the mean error of its area, over the part of it on wall that is compared,
without and with sign, in percent; how many are off by at most 15 %; how many intervals hold the area; in how
many pairs anything else is called changed, and on how much of the wall at most, in percent. Then, in percent:
the compared wall whose true change lies in its interval; the gains that do; the wall whose true displacement
does; the changes of volume that do.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.cases import LASC
from benchmarks.scores import lay_out
from data_synth import Mapping, read_wall
from data_synth.case_points import true_surface
from data_synth.redo import CHANGED, VOLTAGE, redo
from o3dls.arrays import Array
from o3dls.evaluation.measures.numbers import CM2
from o3dls.geometry.similarity import apply, fit_similarity
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.pipeline.file import default_pipeline
from o3dls.pipeline.pipeline import Pipeline
from o3dls.report.mapping.change import change_of

POINTS = (250, 500, 1000)
AREAS = (2.0, 3.0, 4.0, 5.0, 6.0)  # cm²
FIRST_SEED = {False: 1201, True: 3401}
ALLOWED = 0.15
SIDES = ("before", "after")


def make_pairs(out: Path, data: Path, changed: int, same: int, *, judging: bool) -> None:
    """Write so many pairs of cases with a new scar and without one; those that are there are left alone."""
    numbers = LASC[judging]
    for k in range(changed + same):
        seed, points, even = FIRST_SEED[judging] + k, POINTS[k % 3], k % 2 == 0
        area = AREAS[k % 5] if k < changed else 0.0
        name = f"redo_{points}_{'even' if even else 'clustered'}_{area:g}cm2_{seed}"
        if (out / name).exists():
            continue
        prior = read_wall(data / "priors" / "lasc2018" / f"la_{numbers[k % len(numbers)]}.ply")
        pair = redo(prior, seed, area, Mapping(points, 1.0, not even))
        for side, case in zip(SIDES, (pair.before, pair.after), strict=True):
            write_case(out / name / side, case)
        print(name, file=sys.stderr, flush=True)


def run_pair(folder: Path) -> list[Path]:
    """Run both cases of a pair where that is not done, and return the folders of the runs."""
    runs = [folder / f"run_{side}" for side in SIDES]
    for side, run in zip(SIDES, runs, strict=True):
        if not run.exists():
            case = read_case(folder / side).visible()
            Pipeline(default_pipeline().allowed_by(case).stages, folds=0).run(case).write(run)
    return runs


@dataclass(frozen=True)
class Judged:
    """A pair as it was judged: its points; the true area (cm²) of the new scar on compared wall, that of what
    was found of it, with its interval; the share of the wall that is called changed beside it; and shares
    of true numbers that lie in their intervals.
    """

    points: int
    true: float
    found: float
    low: float
    high: float
    false: float
    values: float
    gain: float
    displacement: float
    volume: float

    @property
    def error(self) -> float:
        """Relative error of the area."""
        return self.found / self.true - 1.0


def judge_pair(folder: Path) -> Judged:
    """Compare the runs of a pair, and the result with the truth."""
    found = change_of(run_pair(folder))
    before, after = (true_surface(read_case(folder / side)) for side in SIDES)
    fields, area = found.surface.fields, found.surface.vertex_areas
    compared = np.isfinite(fields["changed"])
    scar, weight = before.fields[CHANGED] > 0.5, before.vertex_areas
    true = float(weight @ (scar & compared)) / CM2
    areas = [row for row in found.rows if row.what == "area"]
    parts = [fields["changed"] == k for k in range(1, len(areas) + 1)]
    hits = [row for row, inside in zip(areas, parts, strict=True) if (inside & scar).any()]
    false = sum(float(area @ inside) for inside in parts if not (inside & scar).any())
    gain = float(np.median((after.fields[VOLTAGE] / before.fields[VOLTAGE])[~scar]))
    change = after.fields[VOLTAGE] / gain - before.fields[VOLTAGE]
    laid = apply(fit_similarity(after.vertices, before.vertices, weight, scale=False), after.vertices)
    way = ((laid - before.vertices) * before.vertex_normals).sum(axis=1)
    grown = (after.volume - before.volume) / 1000.0
    rows = {row.what: row for row in found.rows}
    return Judged(
        int(folder.name.split("_")[1]),
        true,
        *(sum(getattr(row, name) for row in hits) for name in ("value", "low", "high")),
        false / found.surface.area,
        _share_within(change, fields["change_low"], fields["change_high"], area * compared),
        float(rows["ratio everywhere"].low <= gain <= rows["ratio everywhere"].high),
        _share_within(way, fields["displacement_low"], fields["displacement_high"], area * compared),
        float(rows["change of volume"].low <= grown <= rows["change of volume"].high),
    )


def _share_within(true: Array, low: Array, high: Array, area: Array) -> float:
    return float(area @ ((low <= true) & (true <= high)) / area.sum())


def table(judged: list[Judged]) -> str:
    """A row for each number of points of pairs with a new scar and of pairs without, and one for all."""
    head = ["points", "pairs", "found", "area off", "signed", "within 15 %", "in 95 %", "more", "at most"]
    rows = [[*head, "values", "gain", "displaced", "volume"]]
    for name, kind in (("scar", True), ("none", False)):
        own = [one for one in judged if (one.true > 0.0) == kind]
        for points in (*POINTS, None):
            some = [one for one in own if points in (one.points, None)]
            if some:
                rows.append([f"{name} {points or 'all'}", str(len(some)), *_list_cells(some, scar=kind)])
    return lay_out(rows)


def _list_cells(some: list[Judged], *, scar: bool) -> list[str]:
    cells = [""] * 5
    if scar:
        hit = [one for one in some if one.found > 0.0]
        error = np.array([one.error for one in hit])
        held = sum(one.low <= one.true <= one.high for one in hit)
        off = [f"{100.0 * np.abs(error).mean():.1f}", f"{100.0 * error.mean():+.1f}"] if hit else ["", ""]
        cells = [str(len(hit)), *off, str(int((np.abs(error) <= ALLOWED).sum())), str(held)]
    false = [one.false for one in some]
    cells += [str(sum(share > 0.0 for share in false)), f"{100.0 * max(false):.1f}"]
    names = ("values", "gain", "displacement", "volume")
    return [*cells, *(f"{100.0 * np.mean([getattr(one, name) for one in some]):.1f}" for name in names)]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--make", type=int, nargs=2, metavar=("SCAR", "NONE"), help="how many pairs to make")
    parser.add_argument("--data", type=Path, help="the folder above priors/")
    parser.add_argument("--judging", action="store_true", help="of the atria that nothing is chosen on")
    asked = parser.parse_args()
    if asked.make:
        if asked.data is None:
            parser.error("--make needs --data, the folder above priors/")
        make_pairs(asked.folder, asked.data, *asked.make, judging=asked.judging)
        return
    judged = list[Judged]()
    for folder in sorted(asked.folder.glob("redo_*"), key=lambda one: int(one.name.rpartition("_")[2])):
        judged.append(judge_pair(folder))
        print(folder.name, judged[-1], file=sys.stderr, flush=True)
    print(table(judged))


if __name__ == "__main__":
    main()
