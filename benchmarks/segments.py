"""Segments of left atria: python -m benchmarks.segments FOLDER

FOLDER holds priors/lasc2018, priors/ls_prior and priors/toronto, as in `benchmarks.cases`. The openings of
each atrium are found without any landmark, and the atrium is divided. Then the landmarks that were found are
moved by normal errors whose length is 2 mm in the mean square, and given: the segments are compared with
those of the landmarks that were not moved. So are those of the eight places of the consensus (A to I), moved
in the same way and put back on the rims that they belong to. The patient's axes are given where the files are
in LPS, and not where their frame is not known (toronto).

Columns: seconds of the processor to find the openings and to divide, in the mean and at most, and at most to
find the coordinates; the least number of segments that are there, of eight; how far a vertex or the middle of
a face lies at most from where its coordinates lead back to, in mm; Dice of the segments by area with moved
landmarks and with moved places: the mean over segments and seeds, that of the worst atrium, and the least of
a segment in the mean over seeds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from time import process_time

import numpy as np

from benchmarks.scores import lay_out
from o3dls.arrays import Array, Ints
from o3dls.errors import InputError
from o3dls.evaluation.segments.coordinates import AtrialCoordinates, find_coordinates
from o3dls.evaluation.segments.division import SEGMENTS, VALVE, divide
from o3dls.evaluation.segments.openings import find_openings
from o3dls.geometry.surface import Surface
from o3dls.io.surfaces import read_surface

SEEDS = (52_107, 52_108, 52_109, 52_110, 52_111)
JITTER = 2.0  # mm
GROUPS = {"lasc2018": "*.ply", "ls_prior": "*.ply", "toronto": "*.obj"}
LPS = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])  # left, front, up
AXES = {"lasc2018": LPS, "ls_prior": LPS}
MOVED, WORDS = ("landmarks", "places"), ("Dice by", "worst by", "segment by")
NAMES = [k for k in SEGMENTS if k != VALVE]


def judge_atrium(surface: Surface, axes: Array | None) -> dict[str, float]:
    """Return the numbers of one atrium."""
    began = process_time()
    openings = find_openings(surface, axes=axes)
    found = divide(surface, openings)
    seconds = process_time() - began
    still = divide(surface, find_openings(surface, openings.landmarks(), axes)).segment
    began = process_time()
    coordinates = find_coordinates(surface, openings, found)
    numbers = {"seconds": seconds, "segments": float(len(np.intersect1d(found.segment, NAMES)))}
    numbers |= {"coordinates": process_time() - began, "round trip": _measure_round_trip(coordinates)}
    by_landmarks, by_places = [], []
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        moved = find_openings(surface, _move(openings.landmarks(), rng), axes)
        by_landmarks.append(_dice_by_segment(surface, still, divide(surface, moved).segment))
        again = divide(surface, openings, _move(found.places, rng)).segment
        by_places.append(_dice_by_segment(surface, found.segment, again))
    for name, alike in (("landmarks", by_landmarks), ("places", by_places)):
        numbers[name] = float(np.nanmean(alike))
        numbers[f"least by {name}"] = float(np.nanmin(np.mean(alike, axis=0)))
    return numbers


def _measure_round_trip(found: AtrialCoordinates) -> float:
    """Return the largest distance of a place from where its coordinates lead back to."""
    worst = 0.0
    vertices = found.surface.vertices
    for sheet, flat in found.flat.items():
        for corners in (
            np.repeat(flat.faces[:, :1], 3, axis=1),
            flat.faces,
        ):  # a vertex, the middle of a face
            alpha, beta = (0.5 + 0.5 * flat.places[corners].mean(axis=1)).T
            back = found.places(alpha, beta, np.full(len(corners), sheet))
            at = vertices[flat.origin[corners]].mean(axis=1)
            worst = max(worst, float(np.linalg.norm(back - at, axis=1).max()))
    return worst


def _move(places: Mapping[str, Array], rng: np.random.Generator) -> dict[str, Array]:
    return {name: at + rng.normal(0.0, JITTER / np.sqrt(3.0), 3) for name, at in places.items()}


def _dice_by_segment(surface: Surface, a: Ints, b: Ints) -> list[float]:
    """Return the Dice of each segment by area, NaN where neither has it."""
    area = surface.vertex_areas
    found = list[float]()
    for k in NAMES:
        total = area @ (a == k) + area @ (b == k)
        found.append(float(2.0 * area @ ((a == k) & (b == k)) / total) if total > 0.0 else np.nan)
    return found


def _read_atria(folder: Path) -> dict[tuple[str, str], Path]:
    found = {
        (group, path.stem): path
        for group, pattern in GROUPS.items()
        for path in sorted((folder / "priors" / group).glob(pattern))
    }
    if not found:
        raise InputError(
            f"{folder}: has no atria: must hold priors/lasc2018, priors/ls_prior, priors/toronto"
        )
    return found


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.segments")
    parser.add_argument("folder", type=Path)
    options = parser.parse_args(arguments)
    rows = {}
    for (group, name), path in _read_atria(options.folder).items():
        rows[group, name] = judge_atrium(read_surface(path), AXES.get(group))
        print(f"{group} {name}", *(f"{key} {x:.3f}" for key, x in rows[group, name].items()), file=sys.stderr)
    print(tabulate(rows))


def tabulate(rows: Mapping[tuple[str, str], Mapping[str, float]]) -> str:
    """Lay out a line for each group of atria."""
    heads = ["atria", "n", "seconds", "most", "coordinates", "segments", "round trip"]
    lines = [heads + [f"{word} {of}" for of in MOVED for word in WORDS]]
    for group in GROUPS:
        of = [row for (one, _), row in rows.items() if one == group]
        if not of:
            continue
        column = {key: np.array([row[key] for row in of]) for key in of[0]}
        line = [group, str(len(of)), f"{column['seconds'].mean():.2f}", f"{column['seconds'].max():.2f}"]
        line += [f"{column['coordinates'].max():.2f}", f"{column['segments'].min():.0f}"]
        line.append(f"{column['round trip'].max():.1e}")
        for moved in MOVED:
            dice, least = column[moved], column[f"least by {moved}"]
            line += [f"{x:.3f}" for x in (dice.mean(), dice.min(), least.min())]
        lines.append(line)
    return lay_out(lines)


if __name__ == "__main__":
    main(sys.argv[1:])
