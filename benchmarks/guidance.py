"""A map that grows where it is proposed to: python -m benchmarks.guidance [--seeds 10] [--families arap flow
piston]

The wall of the atrium of data_synth, moved by a motion of each family, is mapped point by point with 1 mm of
noise. The first 15 points are clustered; the others lie where `suggest` proposes them (five at a time, and
evenly where it proposes none), evenly over the wall, or clustered with a quarter of the wall unseen. Printed
is the mean distance in mm of points of the true wall, and of those in the unseen part alone, from the surface
of `deform` fitted to so many points: mean and standard error over the cases, and the ratios of the means.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from dataclasses import replace
from time import process_time
from typing import TYPE_CHECKING

from benchmarks.next_places import deformed, with_points

if TYPE_CHECKING:
    import numpy as np

    from o3dls.arrays import Array
    from o3dls.case import Case

COUNTS = (30, 60, 120, 250)
FIRST = 15
TOGETHER = 5
NOISE = 1.0  # mm, sd per axis
FIRST_SEED = 9_301
FAMILIES = ("arap", "flow", "piston")
WAYS = ("planned", "even", "clustered")


def first(case: Case, count: int) -> Case:
    """The case with its first mapping points alone, and its landmarks."""
    import numpy as np

    rows = np.flatnonzero(case.points.type == "eam")[:count]
    return replace(case, points=case.points.select(np.r_[rows, np.flatnonzero(case.points.type != "eam")]))


def cases(family: str, seed: int) -> tuple[Case, Case]:
    """One wall, mapped in clusters and evenly."""
    from data_synth.atrium import atrium
    from data_synth.family import family as moved
    from data_synth.mapping import Mapping

    prior = atrium(seed).prior
    clustered, even = (
        moved(prior, seed, family=family, how=Mapping(max(COUNTS), NOISE, clustered=one))
        for one in (True, False)
    )
    return clustered, even


def planned(start: Case, spare: Array, rng: np.random.Generator, times: list[float]) -> Iterator[Case]:
    """Cases of so many points as are counted, that grow where it is proposed; `spare` (n, 3): points of the
    wall for when nothing is. times: takes the seconds of each choice.
    """
    import numpy as np

    from o3dls import suggest

    case, left = start, iter(spare)
    for count in COUNTS:
        while (have := int((case.points.type == "eam").sum())) < count:
            estimate = deformed(case)
            begin = process_time()
            wanted = min(TOGETHER, count - have)
            found = [place.xyz for place in suggest(case, estimate, wanted).places]
            times += [(process_time() - begin) / max(len(found), 1)]
            at = np.array(found or [next(left) for _ in range(wanted)])
            case = with_points(case, at, NOISE * rng.normal(size=(len(at), 3)))
        yield case


def off(case: Case, truth: Case) -> tuple[float, float]:
    """Mean distance (mm) of points of the true wall, and of those in its unseen part."""
    from o3dls.evaluation.distances import distances

    assert truth.truth is not None
    assert truth.truth.held_out is not None
    assert truth.truth.unseen is not None
    found = distances(truth.truth.held_out, deformed(case).surface)
    return float(found.mean()), float(found[truth.truth.unseen].mean())


def errors(family: str, seed: int, times: list[float]) -> Array:
    """Distances (way, count, whole or unseen)."""
    import numpy as np

    clustered, even = cases(family, seed)
    rng: np.random.Generator = np.random.default_rng((seed, 5_501))
    assert even.truth is not None
    assert even.truth.held_out is not None
    spare = rng.permutation(even.truth.held_out)
    grown = {
        "planned": planned(first(clustered, FIRST), spare, rng, times),
        "even": (joined(clustered, even, count) for count in COUNTS),
        "clustered": (first(clustered, count) for count in COUNTS),
    }
    return np.array([[off(case, clustered) for case in grown[way]] for way in WAYS])


def joined(clustered: Case, even: Case, count: int) -> Case:
    """The first clustered points, and even ones to so many."""
    start = first(clustered, FIRST)
    wanted = even.points.of("eam").xyz[: count - FIRST]
    return with_points(start, wanted, 0.0 * wanted, snapped=False)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10, help="of each family")
    parser.add_argument("--families", nargs="+", default=FAMILIES, choices=FAMILIES)
    arguments = parser.parse_args()
    os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    import numpy as np

    times: list[float] = []
    every = []
    for family in arguments.families:
        for seed in range(FIRST_SEED, FIRST_SEED + arguments.seeds):
            every.append(errors(family, seed, times))
            at = every[-1][:, COUNTS.index(60)]
            cells = ", ".join(f"{way} {a:.2f} ({b:.2f})" for way, (a, b) in zip(WAYS, at, strict=True))
            print(f"{family} {seed}, 60 points, whole (unseen): {cells}", flush=True)
    table = np.array(every)
    mean, error = table.mean(axis=0), table.std(axis=0, ddof=1) / np.sqrt(len(table))
    print(f"\n| points | wall | {' | '.join(WAYS)} | planned / clustered | planned / even |")
    print("|---|---|---|---|---|---|---|")
    for k, count in enumerate(COUNTS):
        for part, name in enumerate(("all", "unseen")):
            cells = [f"{mean[w, k, part]:.3f} ± {error[w, k, part]:.3f}" for w in range(len(WAYS))]
            ratios = [f"{mean[0, k, part] / mean[w, k, part]:.2f}" for w in (2, 1)]
            print(f"| {count} | {name} | {' | '.join([*cells, *ratios])} |")
    print(
        f"\n{len(table)} cases; a choice took {1000 * float(np.median(times)):.0f} ms of processor (median)"
    )


if __name__ == "__main__":
    main()
