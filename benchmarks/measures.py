"""Numbers of a surface with their intervals, against those of the true wall: python -m benchmarks.measures
FOLDER...

Of each case whose true wall has the faces of its prior (phantoms and families of motion), T alone (stage
`deform`) is measured as `o3dls measure` does: volume, areas of the eight octants of the prior, sections of
its tubes, straight distances of six places of it and lengths of ways between them, and the share of each
octant below the median of a field that stays in the map (a wave of 40 mm in each direction). The same
vertices are measured on the true wall.

Columns: how many numbers; how many true ones the 95 % intervals hold; the mean error of the naive number over
the true one, and its rms, in percent (of the share: in points); and the histogram of the truth's rank among
200 samples, in fifths, in percent: 20 each where samples are calibrated, more at the ends where they are too
narrow.

    python -m benchmarks.cases families cases --data ../shared/data --judging
    python -m benchmarks.measures cases
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from benchmarks.accuracy import ours
from benchmarks.cases import find
from benchmarks.scores import lay_out
from o3dls.arrays import Array, Mask
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.evaluation.measures.intervals import LEVEL, draw_numbers
from o3dls.evaluation.measures.numbers import Parts, Quantity, measure_surface, places_on
from o3dls.evaluation.measures.ways import shortest_ways
from o3dls.geometry.inner_balls import depth_in_tubes
from o3dls.geometry.spread import spread
from o3dls.geometry.surface import Surface

SAMPLES, SEED = 200, 40_193
DEEP, LEAST = 5.0, 40  # mm out of the chamber; vertices of a tube
PLACES = 6
WAVE = 40.0  # mm
FIFTHS = 5


class Judged:
    """Numbers of one kind are collected over cases: the true ones, the naive ones, and what samples say."""

    def __init__(self) -> None:
        self.true, self.naive, self.within, self.rank = (list[float]() for _ in range(4))

    def take(self, true: float, naive: float, drawn: Array) -> None:
        """Take a true number, the naive one, and those (n,) of the samples."""
        low, high = np.quantile(drawn, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
        self.true.append(true)
        self.naive.append(naive)
        self.within.append(float(low <= true <= high))
        self.rank.append(float((drawn < true).mean()))

    def cells(self, kind: str) -> list[str]:
        """A row of the table."""
        true, naive = np.array(self.true), np.array(self.naive)
        off = naive - true if kind.startswith("share") else 100.0 * (naive / true - 1.0)
        counts = np.histogram(self.rank, FIFTHS, (0.0, 1.0))[0]
        held = f"{100.0 * np.mean(self.within):.1f}"
        spread_over = " ".join(f"{100.0 * count / len(true):.0f}" for count in counts)
        return [
            kind,
            str(len(true)),
            held,
            f"{off.mean():+.2f}",
            f"{np.sqrt((off**2).mean()):.2f}",
            spread_over,
        ]


def judge_case(case: Case, estimate: Estimate, judged: dict[str, Judged]) -> None:
    """Measure an estimate that has the vertices of the prior, and the true wall, and take that in."""
    assert case.truth is not None
    assert case.truth.surface is not None
    surface, truth = estimate.surface, case.truth.surface
    parts = parts_of(case.prior, surface)
    samples = estimate.samples(SAMPLES, SEED)
    # the field's own median on the surface, so that about half of the wall lies below
    values = wave(surface.vertices)
    parts = replace(parts, thresholds=(float(np.median(values)),))
    true = measure_surface(truth, parts, None, wave(truth.vertices))
    naive = measure_surface(surface, parts, None, values)
    for quantity, drawn in draw_numbers(samples, parts, values).items():
        kind = _name_kind(quantity)
        judged.setdefault(kind, Judged()).take(true[quantity], naive[quantity], drawn)


def _name_kind(quantity: Quantity) -> str:
    """Return what the number is, without the threshold."""
    return quantity.what.split(" below")[0] + (" below" if " below" in quantity.what else "")


def parts_of(prior: Surface, surface: Surface) -> Parts:
    """Octants of the prior about its middle, its tubes, and places spread over it."""
    octant = (prior.vertices > prior.vertices.mean(axis=0)) @ np.array([1, 2, 4])
    at = spread(prior.vertices, PLACES)
    places = places_on(surface, {str(k): surface.vertices[one] for k, one in enumerate(at)})
    return Parts(
        {str(k): octant == k for k in range(8) if (octant == k).any()},
        _find_tubes(prior),
        places,
        shortest_ways(
            surface, np.ones(len(octant), dtype=bool), {name: vertex for name, (vertex, _) in places.items()}
        ),
    )


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
    head = ["number", "n", "% in 95 %", "naive off, %", "rms, %", "ranks in fifths, %"]
    return lay_out([head, *(one.cells(kind) for kind, one in judged.items())])


def measure_cases(folders: Iterable[Path]) -> dict[str, Judged]:
    """Judge all cases in folders."""
    judged = dict[str, Judged]()
    for listed in find(folders):
        case = listed.read()
        truth = case.truth and case.truth.surface
        if case.dimension == 2 or not truth or not np.array_equal(truth.faces, case.prior.faces):
            print(f"{listed.name}: its true wall is not the prior's, left out", file=sys.stderr)
            continue
        estimate = next(one for name, one, _ in ours(case.visible(), None) if name == "deform")
        judge_case(case, estimate, judged)
        print(listed.name, file=sys.stderr, flush=True)
    return judged


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="+", type=Path)
    print(table(measure_cases(parser.parse_args().folders)))


if __name__ == "__main__":
    main()
