"""Where to map next: python -m benchmarks.next_places [--seeds 20] [--points 60] [--draws 3]

A clustered, sparse map of an atrium (data_synth) is fitted; five more points are taken where `suggest`
proposes them, or at random on the wall of the chamber; each map is fitted anew. Printed is the mean distance
in mm of points of the true wall from the surface of `deform`, per seed and over the seeds with its standard
error. The same five draws of noise go to both.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from o3dls.arrays import Array
    from o3dls.case import Case
    from o3dls.estimate import Estimate

NOISE = 1.5  # mm, sd per axis
FIRST_SEED = 8_101
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


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--points", type=int, default=60, help="of the sparse map")
    parser.add_argument("--draws", type=int, default=3, help="of five random places")
    arguments = parser.parse_args()
    os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    import numpy as np

    print(HEAD)
    rows = []
    for seed in range(FIRST_SEED, FIRST_SEED + arguments.seeds):
        rows.append(compared(seed, arguments.points, arguments.draws))
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


if __name__ == "__main__":
    main()
