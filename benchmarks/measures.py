"""Numbers of a surface with their intervals, against those of the true wall: python -m benchmarks.measures
FOLDER...

Of each case whose true wall has the faces of its prior (phantoms and families of motion), T alone (stage
`deform`) is measured as `o3dls measure` does: volume, areas of the eight octants of the prior, sections of
its tubes, straight distances of six places of it and lengths of ways between them, and the share of each
octant below the median of a field that stays in the map (a wave of 40 mm in each direction). The same
vertices are measured on the true wall. Eight lesions on it, measured within 1 mm per axis, have gaps along a
line, and distances to a scar of the wall: where another wave is high.

Columns: how many numbers; how many true ones the 95 % intervals hold, and how many the quantiles of the
samples as they are drawn; the mean error of the naive number over
the true one, and its rms, in percent (of shares in points, of lesions in mm); and the histogram of the
truth's rank among these 200 samples, in fifths, in percent (simulation-based calibration): 20
each where samples are calibrated, more at the ends where they are too narrow.

Of a case whose true wall is another surface (a prior of another person) the default pipeline's result is
measured: its volume, the areas of the eight octants about its middle, and the sections of its tubes, in rows
of their own. The true section is spanned by the places of the true wall that are nearest to its border, so
that a section that lies farther along its tube does not count.

Below: the seconds that a case takes by the clock, and those of the processor's cores together, from the
motion to the intervals of 200 samples.

    python -m benchmarks.cases families cases --data ../shared/data --judging
    python -m benchmarks.measures cases
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from benchmarks.cases import find
from benchmarks.scores import lay_out
from benchmarks.slope import fit_motion_alone
from o3dls.arrays import Array, Mask
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.evaluation.measures.intervals import LEVEL, draw_numbers, sample_numbers
from o3dls.evaluation.measures.lesions import Lesions, Scar, draw_lesions
from o3dls.evaluation.measures.numbers import Parts, Quantity, measure_surface, places_on
from o3dls.evaluation.measures.ways import shortest_ways
from o3dls.geometry.inner_balls import depth_in_tubes
from o3dls.geometry.spread import spread
from o3dls.geometry.surface import Surface
from o3dls.motion.wall.samples import SurfaceSamples
from o3dls.parallel import one_blas_thread
from o3dls.pipeline.file import default_pipeline

SAMPLES, SEED = 200, 40_193
DEEP, LEAST = 5.0, 40  # mm out of the chamber; vertices of a tube
PLACES = 6
WAVE = 40.0  # mm
FIFTHS = 5
LESIONS, OFF, HIGH = 8, 1.0, 0.85  # mm per axis; from which share of the wall's waves on there is scar
OF_LESIONS = ("gap", "largest gap", "distance to scar")


class Judged:
    """Numbers of one kind are collected over cases: the true ones, the naive ones, and what samples say."""

    def __init__(self) -> None:
        self.true, self.naive, self.within, self.in_plain, self.rank = (list[float]() for _ in range(5))

    def take(self, true: float, naive: float, drawn: Array, samples: Array) -> None:
        """Take a true number, the naive one, what it may be (n,), and those (n,) of the samples."""
        self.true.append(true)
        self.naive.append(naive)
        for held, numbers in ((self.within, drawn), (self.in_plain, samples)):
            low, high = np.quantile(numbers, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
            held.append(float(low <= true <= high))
        self.rank.append(float((samples < true).mean()))

    def cells(self, kind: str) -> list[str]:
        """A row of the table."""
        true, naive = np.array(self.true), np.array(self.naive)
        plain = kind.startswith("share") or kind in OF_LESIONS
        off = naive - true if plain else 100.0 * (naive / np.where(plain, 1.0, true) - 1.0)
        counts = np.histogram(self.rank, FIFTHS, (0.0, 1.0))[0]
        spread_over = " ".join(f"{100.0 * count / len(true):.0f}" for count in counts)
        return [
            kind,
            str(len(true)),
            *(f"{100.0 * np.mean(held):.1f}" for held in (self.within, self.in_plain)),
            f"{off.mean():+.2f}",
            f"{np.sqrt((off**2).mean()):.2f}",
            spread_over,
        ]


@one_blas_thread()
def judge_case(case: Case, estimate: Estimate, judged: dict[str, Judged]) -> tuple[float, float]:
    """Measure an estimate that has the vertices of the prior, and the true wall, take that in, and return the
    seconds that our numbers take, by the clock and of the processor.
    """
    assert case.truth is not None
    assert case.truth.surface is not None
    surface, truth = estimate.surface, case.truth.surface
    begin, used = perf_counter(), process_time()
    parts = parts_of(case.prior, surface)
    # the field's own median on the surface, so that about half of the wall lies below
    values = wave(surface.vertices)
    parts = replace(parts, thresholds=(float(np.median(values)),))
    samples = estimate.samples(SAMPLES, SEED)
    naive = measure_surface(surface, parts, None, values)
    drawn = draw_numbers(samples, parts, naive, values)
    taken = perf_counter() - begin, process_time() - used
    plain = sample_numbers(samples, parts, values)
    true = measure_surface(truth, parts, None, wave(truth.vertices))
    for quantity, numbers in drawn.items():
        kind = _name_kind(quantity)
        judged.setdefault(kind, Judged()).take(true[quantity], naive[quantity], numbers, plain[quantity])
    judge_lesions(case.prior, truth, samples, judged)
    return taken


@one_blas_thread()
def judge_unlike(case: Case, truth: Surface, judged: dict[str, Judged]) -> None:
    """Measure the volume and the octants' areas of the default pipeline's result and of the true wall, which
    has no vertex in common with it, and take that in.
    """
    plan = replace(default_pipeline().allowed_by(case), writes=(), folds=0)
    estimate = list(plan.run(replace(case, truth=None)).estimates.values())[-1]
    surface = estimate.surface
    middle = surface.vertices.mean(axis=0)
    octants, true_octants = (_find_octants(wall.vertices, middle) for wall in (surface, truth))
    parts = Parts(octants, _find_tubes(surface), template=True)
    nearest = surface.with_vertices(truth.closest_point.query(surface.vertices)[2])
    samples = estimate.samples(SAMPLES, SEED)
    naive = measure_surface(surface, parts)
    true = measure_surface(nearest, parts) | measure_surface(truth, Parts(true_octants))
    drawn, plain = draw_numbers(samples, parts, naive), sample_numbers(samples, parts)
    for quantity in drawn.keys() & true.keys():
        kind = f"{_name_kind(quantity)}, another's prior"
        judged.setdefault(kind, Judged()).take(
            true[quantity], naive[quantity], drawn[quantity], plain[quantity]
        )


def judge_lesions(prior: Surface, truth: Surface, samples: SurfaceSamples, judged: dict[str, Judged]) -> None:
    """Measure distances of lesions on the true wall, and as they are known, and take that in. Samples have
    the vertices of the prior.
    """
    rng = np.random.default_rng(SEED)
    at = truth.vertices[rng.choice(len(truth.vertices), LESIONS, replace=False)]
    names, line = tuple(str(k) for k in range(LESIONS)), ("line",) * LESIONS
    field = wave(prior.vertices)
    scar = {"scar": Scar(np.quantile(field, HIGH) - field, of_wall=True)}
    still = SurfaceSamples(truth, truth.vertices[None], np.ones((1, len(truth.vertices)), dtype=bool))
    true, _ = draw_lesions(still, Lesions(names, at, np.zeros(LESIONS), line), scar, rng)
    seen = at + OFF * rng.normal(size=at.shape)
    naive, drawn = draw_lesions(samples, Lesions(names, seen, np.full(LESIONS, OFF), line), scar, rng)
    for quantity, numbers in drawn.items():
        kind = _name_kind(quantity)
        judged.setdefault(kind, Judged()).take(true[quantity], naive[quantity], numbers, numbers)


def _name_kind(quantity: Quantity) -> str:
    """Return what the number is, without the threshold."""
    return quantity.what.split(" below")[0] + (" below" if " below" in quantity.what else "")


def parts_of(prior: Surface, surface: Surface) -> Parts:
    """Octants of the prior about its middle, its tubes, and places spread over it."""
    at = spread(prior.vertices, PLACES)
    places = places_on(surface, {str(k): surface.vertices[one] for k, one in enumerate(at)})
    return Parts(
        _find_octants(prior.vertices, prior.vertices.mean(axis=0)),
        _find_tubes(prior),
        places,
        shortest_ways(
            surface,
            np.ones(len(prior.vertices), dtype=bool),
            {name: vertex for name, (vertex, _) in places.items()},
        ),
    )


def _find_octants(at: Array, middle: Array) -> dict[str, Mask]:
    octant = (at > middle) @ np.array([1, 2, 4])
    return {str(k): octant == k for k in range(8) if (octant == k).any()}


def _find_tubes(prior: Surface) -> dict[str, Mask]:
    depth = depth_in_tubes(prior.vertices, prior.vertex_normals, prior.vertices)
    deep, n = depth > DEEP, len(depth)
    edges = np.concatenate([prior.faces[:, [0, 1]], prior.faces[:, [1, 2]], prior.faces[:, [2, 0]]])
    edges = edges[deep[edges].all(axis=1)]
    graph = sparse.csr_array((np.ones(len(edges)), edges.T), shape=(n, n))
    part = connected_components(graph, directed=False)[1]
    sizes = np.bincount(part[deep])
    return {str(k): deep & (part == one) for k, one in enumerate(np.flatnonzero(sizes >= LEAST))}


def wave(at: Array) -> Array:
    """A field in the map (n,) at places (n, 3)."""
    return np.asarray(np.sin(2.0 * np.pi * at / WAVE).sum(axis=1))


def table(judged: dict[str, Judged]) -> str:
    """A row for each kind of number."""
    head = ["number", "n", "% in 95 %", "of samples", "naive off, %", "rms, %", "ranks in fifths, %"]
    return lay_out([head, *(one.cells(kind) for kind, one in judged.items())])


def measure_cases(folders: Iterable[Path]) -> tuple[dict[str, Judged], list[tuple[float, float]]]:
    """Judge all cases in folders; also the seconds of each, by the clock and of the processor."""
    judged, seconds = dict[str, Judged](), list[tuple[float, float]]()
    for listed in find(folders):
        case = listed.read()
        truth = case.truth and case.truth.surface
        if case.dimension == 2 or not truth:
            print(f"{listed.name}: has no true wall in space, left out", file=sys.stderr)
            continue
        if np.array_equal(truth.faces, case.prior.faces):
            seconds.append(judge_case(case, fit_motion_alone(case)["deform"], judged))
        else:
            judge_unlike(case, truth, judged)
        print(listed.name, file=sys.stderr, flush=True)
    return judged, seconds


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="+", type=Path)
    judged, seconds = measure_cases(parser.parse_args().folders)
    print(table(judged))
    if seconds:
        print()
    for of, taken in zip(("by the clock", "of the processor"), zip(*seconds, strict=True), strict=False):
        print(f"seconds {of}: {np.median(taken):.2f} in the median, {max(taken):.2f} at most")


if __name__ == "__main__":
    main()
