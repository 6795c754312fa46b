"""Where to map next: python -m benchmarks.next_places [--seeds 20] [--points 60] [--draws 3]
or: python -m benchmarks.next_places --grow [--seeds 10] [--families arap flow piston]

A clustered, sparse map of an atrium (data_synth) is fitted; five more points are taken where `suggest`
proposes them, or at random on the wall of the chamber; each map is fitted anew. Printed is the mean distance
in mm of points of the true wall from the surface of `deform`, per seed and over the seeds with its standard
error. The same five draws of noise go to both.

With --grow the wall of the atrium, moved by a motion of each family, is mapped point by point with 1 mm of
noise. The first 15 points are clustered; the others lie where `suggest` proposes them (five at a time, and
evenly where it proposes none), evenly over the wall, or clustered with a quarter of the wall unseen. Printed
is the mean distance in mm of points of the true wall, and of those in the unseen part alone, from the surface
of `deform` fitted to so many points: mean and standard error over the cases, and the ratios of the means.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from time import process_time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from o3dls.arrays import Array
    from o3dls.case import Case
    from o3dls.estimate import Estimate

NOISE = 1.5  # mm, sd per axis
FIRST_SEED = 8_101
COUNTS = (30, 60, 120, 250)
FIRST_POINTS = 15
TOGETHER = 5
GROWN_NOISE = 1.0  # mm, sd per axis
FIRST_GROWN_SEED = 9_301
FAMILIES = ("arap", "flow", "piston")
WAYS = ("planned", "even", "clustered")
HEAD = "| seed | before | five proposed | five random |\n|---|---|---|---|"


def deformed(case: Case) -> Estimate:
    """The estimate of `deform` in the default pipeline."""
    from o3dls.pipeline.file import default_pipeline

    plan = default_pipeline().allowed_by(case)
    stages = [stage for stage in plan.stages if stage.name in ("landmarks", "icp", "deform")]
    return replace(plan, stages=stages, folds=0, writes=()).fit(case)["deform"]


def off(case: Case, estimate: Estimate) -> float:
    """Mean distance (mm) of points of the true wall."""
    from o3dls.evaluation.distances import distances

    assert case.truth is not None
    assert case.truth.held_out is not None
    return float(distances(case.truth.held_out, estimate.surface).mean())


def with_points(case: Case, at: Array, noise: Array, *, snapped: bool = True) -> Case:
    """The case with more mapping points: on the true wall nearest to places (k, 3), or at these where they
    are not `snapped`, and off it by noise.
    """
    import numpy as np
    from scipy.spatial import cKDTree

    assert case.truth is not None
    assert case.truth.held_out is not None
    wall = case.truth.held_out
    points = case.points
    at = wall[cKDTree(wall).query(at)[1]] if snapped else at
    xyz = np.vstack([points.xyz, at + noise[: len(at)]])
    kinds = np.r_[points.type, np.repeat("eam", len(at))]
    empty = {
        name: np.full(len(at), "" if values.dtype.kind == "U" else np.nan)
        for name, values in points.columns.items()
    }
    columns = {name: np.r_[values, empty[name]] for name, values in points.columns.items()}
    return replace(case, points=replace(points, xyz=xyz, type=kinds, columns=columns, order=None))


def chamber(case: Case) -> Array:
    """Points (n, 3) of the true wall that are not deep in a vein or the appendage: 5 mm, as in `suggest`."""
    from scipy.spatial import cKDTree

    from o3dls.geometry.inner_balls import depth_in_tubes

    assert case.truth is not None
    assert case.truth.held_out is not None
    assert case.truth.surface is not None
    truth, wall = case.truth.surface, case.truth.held_out
    nearest = cKDTree(truth.vertices).query(wall)[1]
    return wall[depth_in_tubes(wall, truth.vertex_normals[nearest], truth.vertices) < 5.0]


def compared(seed: int, points: int, draws: int) -> tuple[float, float, float]:
    """Error before, after five proposed points, and after five random ones, the mean of so many draws."""
    import numpy as np

    from data_synth.atrium import atrium
    from o3dls import suggest

    case = atrium(seed, points=points, noise=NOISE)
    start = deformed(case)
    places = np.array([place.xyz for place in suggest(case, start, 5).places])
    rng: np.random.Generator = np.random.default_rng((seed, 4_409))
    noise = NOISE * rng.normal(size=(5, 3))
    proposed = off(case, deformed(with_points(case, places, noise)))
    wall = chamber(case)
    others = [wall[rng.choice(len(wall), len(places), replace=False)] for _ in range(draws)]
    random = float(np.mean([off(case, deformed(with_points(case, at, noise))) for at in others]))
    return off(case, start), proposed, random


def print_added(seeds: int, points: int, draws: int) -> None:
    """The table of sparse maps and five points more."""
    import numpy as np

    print(HEAD)
    rows = []
    for seed in range(FIRST_SEED, FIRST_SEED + seeds):
        rows.append(compared(seed, points, draws))
        print(f"| {seed} | {' | '.join(f'{one:.3f}' for one in rows[-1])} |", flush=True)
    table = np.array(rows)
    errors = table.std(axis=0, ddof=1) / np.sqrt(len(table))
    cells = (f"{m:.3f} ± {e:.3f}" for m, e in zip(table.mean(axis=0), errors, strict=True))
    print(f"| mean | {' | '.join(cells)} |")
    gap = table[:, 1] - table[:, 2]
    print(
        f"proposed - random: {gap.mean():+.3f} ± {gap.std(ddof=1) / np.sqrt(len(gap)):.3f} mm, closer on "
        f"{(gap < 0).sum()} of {len(gap)}"
    )


def take_first(case: Case, count: int) -> Case:
    """The case with its first mapping points alone, and its landmarks."""
    import numpy as np

    rows = np.flatnonzero(case.points.type == "eam")[:count]
    return replace(case, points=case.points.select(np.r_[rows, np.flatnonzero(case.points.type != "eam")]))


def map_wall(family: str, seed: int) -> tuple[Case, Case]:
    """One wall, mapped in clusters and evenly."""
    from data_synth.atrium import atrium
    from data_synth.family import family as moved
    from data_synth.mapping import Mapping

    prior = atrium(seed).prior
    clustered, even = (
        moved(prior, seed, family=family, how=Mapping(max(COUNTS), GROWN_NOISE, clustered=one))
        for one in (True, False)
    )
    return clustered, even


def grow_map(start: Case, spare: Array, rng: np.random.Generator, times: list[float]) -> Iterator[Case]:
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
            case = with_points(case, at, GROWN_NOISE * rng.normal(size=(len(at), 3)))
        yield case


def parts_off(case: Case, truth: Case) -> tuple[float, float]:
    """Mean distance (mm) of points of the true wall, and of those in its unseen part."""
    from o3dls.evaluation.distances import distances

    assert truth.truth is not None
    assert truth.truth.held_out is not None
    assert truth.truth.unseen is not None
    found = distances(truth.truth.held_out, deformed(case).surface)
    return float(found.mean()), float(found[truth.truth.unseen].mean())


def compare_ways(family: str, seed: int, times: list[float]) -> Array:
    """Distances (way, count, whole or unseen)."""
    import numpy as np

    clustered, even = map_wall(family, seed)
    rng: np.random.Generator = np.random.default_rng((seed, 5_501))
    assert even.truth is not None
    assert even.truth.held_out is not None
    spare = rng.permutation(even.truth.held_out)
    grown = {
        "planned": grow_map(take_first(clustered, FIRST_POINTS), spare, rng, times),
        "even": (join_maps(clustered, even, count) for count in COUNTS),
        "clustered": (take_first(clustered, count) for count in COUNTS),
    }
    return np.array([[parts_off(case, clustered) for case in grown[way]] for way in WAYS])


def join_maps(clustered: Case, even: Case, count: int) -> Case:
    """The first clustered points, and even ones to so many."""
    start = take_first(clustered, FIRST_POINTS)
    wanted = even.points.of("eam").xyz[: count - FIRST_POINTS]
    return with_points(start, wanted, 0.0 * wanted, snapped=False)


def print_grown(families: Sequence[str], seeds: int) -> None:
    """The table of maps that grow, over so many seeds of each family."""
    import numpy as np

    times: list[float] = []
    every = []
    for family in families:
        for seed in range(FIRST_GROWN_SEED, FIRST_GROWN_SEED + seeds):
            every.append(compare_ways(family, seed, times))
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


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, help="how many: 20, or with --grow 10 of each family")
    parser.add_argument("--points", type=int, default=60, help="of the sparse map")
    parser.add_argument("--draws", type=int, default=3, help="of five random places")
    parser.add_argument("--grow", action="store_true", help="a map that grows where it is proposed to")
    parser.add_argument("--families", nargs="+", default=FAMILIES, choices=FAMILIES, help="with --grow")
    arguments = parser.parse_args()
    os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    if arguments.grow:
        print_grown(arguments.families, arguments.seeds or 10)
    else:
        print_added(arguments.seeds or 20, arguments.points, arguments.draws)


if __name__ == "__main__":
    main()
