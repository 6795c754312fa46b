"""A patient's own atrium as the prior, and a map that leaves wall out because no catheter was there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from o3dls import Case, Surface

from . import wall
from .chamber import Chamber, chamber
from .family import LANDMARKS, beaten, marked, named, ways_of
from .mapping import Mapping, case_of, mapped
from .sampling import Mask, Rows
from .visits import Visits

NOISE = 1.5  # mm


def unvisited(
    prior: Surface,
    seed: int = 7,
    visits: Visits | None = None,
    *,
    family: str = "flow",
    landmarks: bool = True,
    how: Mapping | None = None,
) -> Case:
    """The case of a seed: the truth is the whole prior, moved as `family` does by a motion of strength 1;
    its points are where a catheter was (`visits`; everywhere to 12 mm into the veins if not given).

    landmarks: four places far apart on the wall that was visited, L1 to L4, marked in the map within 2 mm;
    without them the start is a rigid pose that is off by 3 to 10 degrees and 3 to 10 mm. A held-out point is
    `unseen` where no catheter was; the true surface has `chamber.Chamber` as fields `depth_mm` and `tube`.
    """
    how, visits = how or Mapping(noise=NOISE, clustered=False), visits or Visits()
    beat, scanner, catheter, way = np.random.default_rng((seed, 60_659)).spawn(4)
    after = beaten(prior, family, 1.0, beat, scanner)
    parts = chamber(after.wall)
    missed = visits.missed(way, after.wall, parts)
    places = _places(after.wall, missed) if landmarks else np.zeros(0, dtype=np.int64)
    points, truth = mapped(catheter, after.wall, how, named(after.wall, places), missed)
    truth = replace(truth, surface=told(after.wall, parts), correspondence=ways_of(prior, after.wall))
    said = f"{family}: seed {seed}, {after.left:.2f} mm rms after the best similarity; {_said(how, visits)}"
    start = marked(prior, places) if landmarks else after.rough
    return case_of(f"unvisited_{seed}", prior, (points, truth), start, said)


def told(surface: Surface, parts: Chamber) -> Surface:
    """A surface with its parts as fields `depth_mm` and `tube`, by which scores know what is vein."""
    return replace(surface, fields={"depth_mm": parts.depth, "tube": parts.tube.astype(np.float64)})


def _places(after: Surface, missed: Mask) -> Rows:
    """Vertices (4,) for landmarks, on wall that was visited."""
    seen = np.ones(len(after.vertices), dtype=bool)
    seen[after.faces[missed]] = False
    return wall.far_places(after, len(LANDMARKS), seen)


def _said(how: Mapping, visits: Visits) -> str:
    spread = "clustered" if how.clustered else "filtered"
    noise = "0.5 to 2 mm per point" if how.noise is None else f"{how.noise:g} mm"
    return f"{how.points} points, {spread}, {visits}, noise {noise}, outliers {how.outliers:.2f}"
