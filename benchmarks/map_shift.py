"""Maps of which one part is shifted: python -m benchmarks.map_shift FOLDER...

    python -m benchmarks.map_shift ../shared/data/phantom/la_0*           a part of each map is shifted
    python -m benchmarks.map_shift CASES --whole                          maps as they are: none must be named
    python -m benchmarks.cases badly_segmented BAD --data ../shared/data --judging
    python -m benchmarks.map_shift BAD --whole                            and where the prior lacks a vein

The points on the left (x above the median), or those taken in the second half of the file, are moved by some
mm along some directions; landmarks, which are taken first, stay. Columns: what was found, and the mean
distance in mm of noise-free points of the true wall (held_out.csv) from the surface: of the map as it was,
shifted, and shifted with deform.map_shift = "fit". A shift along the normal of the part's plane stretches the
wall, and is the hardest to tell from a motion. A map that is whole has the distance as it is and, where a
shift is named, with deform.map_shift = "fit": what the advice would do.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from o3dls.arrays import Array
    from o3dls.case import Case
    from o3dls.estimate import Estimate

NEAR = 0.15  # mm: no farther from the true wall than the result of the map that is whole by more
DIRECTIONS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0), "xyz": (1.0, 1.0, 1.0)}


def shifted(case: Case, part: str, offset: Array) -> Case:
    """The case with the `left` half of its points, or those of the `later` half, moved by an offset (d,)."""
    import numpy as np

    points = case.points
    eam = np.flatnonzero(points.type == "eam")
    key = points.xyz[:, 0] if part == "left" else np.arange(float(len(points)))
    moves = (key > np.median(key[eam])) & (points.type != "landmark")
    return replace(case, points=replace(points, xyz=points.xyz + moves[:, None] * offset))


def deformed(case: Case, map_shift: str) -> Estimate:
    """The estimate of `deform` in the default pipeline."""
    from o3dls.pipeline.file import read_pipeline
    from o3dls.pipeline.pipeline import Pipeline
    from o3dls.resources import pipeline_file
    from o3dls.stages.deform import Deform

    default = read_pipeline(pipeline_file("default")).allowed_by(case).stages
    before = [stage for stage in default if stage.name in ("landmarks", "global_pose", "icp")]
    asked = Deform.model_validate({"map_shift": map_shift})
    return Pipeline([*before, asked], folds=0).fit(case)["deform"]


def off(case: Case, estimate: Estimate) -> float:
    """Mean distance (mm) of the held-out points."""
    from o3dls.evaluation.distances import distances

    assert case.truth is not None
    assert case.truth.held_out is not None
    return float(distances(case.truth.held_out, estimate.surface).mean())


def named(estimate: Estimate) -> str:
    """The sentence that names a shifted part; empty where none is."""
    return next((one.sentence for one in estimate.warnings if one.code == "map-shift"), "")


def rows(case: Case, lengths: list[float], directions: list[str]) -> Iterator[tuple[str, bool, bool, str]]:
    """By part, length and direction: the case in words, whether it was named, whether it is hardly farther
    than the map that is whole once the offset is taken out, and the rest of the line.
    """
    import numpy as np

    whole = off(case, deformed(case, "ignore"))
    for part in ("later", "left"):
        for length in lengths:
            for name in directions:
                way = np.array(DIRECTIONS[name])
                moved = shifted(case, part, length * way / np.linalg.norm(way))
                found = deformed(moved, "fit")
                sentence = named(found)
                without = off(case, found)
                near = without <= whole + NEAR
                distances = f"{whole:.2f} | {off(case, deformed(moved, 'ignore')):.2f} | {without:.2f}"
                yield f"{part} | {length:g} {name}", bool(sentence), near, f"{distances} | {sentence or '-'}"


def row_of_whole(case: Case) -> tuple[str, bool, bool, str]:
    """The same of a map that nothing is done to: what is named is wrong, and costs what following it does."""
    found = deformed(case, "report")
    sentence = named(found)
    known = case.truth is not None and case.truth.held_out is not None
    distances = f"{off(case, found):.2f}" if known else "-"
    if sentence and known:
        distances += f" | {off(case, deformed(case, 'fit')):.2f}"
    return "whole", bool(sentence), False, f"{distances} | {sentence or '-'}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="+", type=Path, help="case folders, or folders of them")
    parser.add_argument("--whole", action="store_true", help="do not shift anything: what is named is wrong")
    parser.add_argument("--lengths", nargs="+", type=float, default=[5.0, 10.0, 15.0], metavar="MM")
    parser.add_argument("--directions", nargs="+", choices=DIRECTIONS, default=["y"])
    arguments = parser.parse_args()
    os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    from benchmarks.cases import find

    count = {"all": 0, "named": 0, "near": 0}
    for listed in find(arguments.folders):
        case = listed.read()
        if arguments.whole:
            found = [row_of_whole(case)]
        else:
            found = list(rows(case, arguments.lengths, arguments.directions))
        for kind, is_named, is_near, rest in found:
            print(f"| {listed.name} | {kind} | {rest} |", flush=True)
            count["all"] += 1
            count["named"] += is_named
            count["near"] += is_named and is_near
    near = "" if arguments.whole else f"; {count['near']} of these no farther than the whole map by {NEAR} mm"
    print(f"{count['named']} of {count['all']} named{near}")


if __name__ == "__main__":
    main()
