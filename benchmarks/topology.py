"""Does the result have the truth's topology where the prior's differs: python -m benchmarks.topology CASES

    python -m benchmarks.topology CASES/cross_1000_1_even_2* [--jobs 2]

CASES are of benchmarks.make_cases cross. A handle of the truth counts as shown where the rule of `level_set`
keeps it on the truth's own level set (1 mm): where the points are likelier by `evidence` than with the handle
cut or its tunnel filled. That the truth lacks a handle of the prior always counts as shown.
"""

from __future__ import annotations

import argparse
import os
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from o3dls.case import Case
    from o3dls.geometry.surface import Surface

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
SPACING = 1.0  # mm
WIDTH = 4.0  # mm, of the truth's level set
NOISE = 2  # which part of a name cross_<points>_<noise>_... is the noise in mm


class Row(NamedTuple):
    """A case and numbers of handles: of its prior, of its truth, of those that points show, of the result."""

    case: str
    prior: int
    truth: int
    shown: int
    result: int

    @property
    def differs(self) -> bool:
        return self.prior != self.truth and self.truth == self.shown

    @property
    def right(self) -> bool:
        return self.result == self.truth


def handles(surface: Surface) -> int:
    """Number of handles of a closed surface."""
    from o3dls.geometry.components import components_and_euler

    pieces, euler = components_and_euler(surface.vertices, surface.faces)
    return pieces - euler // 2


def shown(case: Case, noise: float) -> int:
    """How many handles of the truth its points show."""
    import numpy as np

    from o3dls.geometry.similarity import rms_radius
    from o3dls.geometry.surface import Surface
    from o3dls.levelset.grid.band import Band
    from o3dls.levelset.grid.distance import signed_distance
    from o3dls.levelset.grid.isosurface import zero_set
    from o3dls.reconstruction.points.point_density import PointDensity
    from o3dls.reconstruction.settings import ReconstructionSettings
    from o3dls.reconstruction.shape.handles import without_handles

    assert case.truth is not None
    assert case.truth.surface is not None
    settings = ReconstructionSettings()
    near = signed_distance(case.truth.surface.vertices, case.truth.surface.faces, SPACING, WIDTH)
    box = near.band.dense(near.phi)
    phi = np.where(np.isnan(box), WIDTH, box).astype(np.float64)
    points = case.points.of("eam").xyz
    density = PointDensity(points, noise, near.band.low, SPACING, settings.handles)
    least = settings.least_outside * SPACING
    asked = settings.handles.least_cut * (rms_radius(case.truth.surface.vertices) / SPACING) ** 2
    kept = without_handles(phi, density.log_likelihoods, settings.handles, least, asked)
    nodes = np.argwhere(np.ones(phi.shape, dtype=bool)).astype(np.int32)
    band = Band(SPACING, WIDTH, near.band.low, phi.shape, nodes)
    return handles(Surface(*zero_set(band, kept.ravel())))


def judged(folder: Path) -> Row | None:
    """The row of a case; None where prior and truth have the same topology."""
    from dataclasses import replace

    from o3dls.io.case_reader import read_case
    from o3dls.pipeline.file import default_pipeline

    case = read_case(folder)
    assert case.truth is not None
    assert case.truth.surface is not None
    before, after = handles(case.prior), handles(case.truth.surface)
    if before == after:
        return None
    found = replace(default_pipeline().allowed_by(case), folds=0, writes=()).fit(case)
    noise = float(folder.name.split("_")[NOISE])
    return Row(folder.name, before, after, shown(case, noise), handles(found["level_set"].surface))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", nargs="+", type=Path)
    parser.add_argument("--jobs", type=int, default=1, help="cases at a time")
    arguments = parser.parse_args()
    os.environ.update(dict.fromkeys(THREADS, "1"))
    print("| case | handles of prior | of truth | shown by points | of result | |\n|---|---|---|---|---|---|")
    told = []
    with get_context("spawn").Pool(arguments.jobs) as pool:
        for row in pool.imap(judged, arguments.cases):
            if row is None:
                continue
            said = ("right" if row.right else "wrong") if row.differs else "points do not show it"
            print(
                f"| {row.case} | {row.prior} | {row.truth} | {row.shown} | {row.result} | {said} |",
                flush=True,
            )
            told += [row.right] if row.differs else []
    if told:
        print(f"{sum(told)} of {len(told)} right where points show that the topology differs")


if __name__ == "__main__":
    main()
