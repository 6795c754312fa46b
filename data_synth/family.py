"""A real atrium that moved by a motion of one of the families."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from o3dls import Case, Surface

from . import pose, wall
from .families import moved, remains
from .mapping import Mapping, case_of, mapped

LANDMARKS = ("L1", "L2", "L3", "L4")
EVERY = 5  # vertices, of those whose way is written down


def family(
    prior: Surface,
    seed: int = 7,
    *,
    family: str = "flow",
    motion: float = 1.0,
    landmarks: bool = True,
    how: Mapping | None = None,
) -> Case:
    """The case of a seed: `prior` stays in its own frame; the truth has moved by a motion of the family
    (`families.moved`), has another size by up to 5 % and lies in a mapping system's frame.

    motion: 1 leaves 1.0 to 1.8 mm rms after the best similarity, 2 twice that. landmarks: four far ends of
    the prior, L1 to L4, marked in the map within 2 mm; without them the start is a rigid pose that is off by
    3 to 10 degrees and 3 to 10 mm.
    """
    how = how or Mapping()
    beat, scanner, catheter = np.random.default_rng((seed, 4517)).spawn(3)
    beaten = moved(prior, family, beat, motion)
    rigid, scale = pose.frame(scanner), scanner.uniform(*pose.SCALE)
    middle = prior.vertices.mean(axis=0)
    at = pose.under(rigid, middle + scale * (beaten.vertices - middle))
    off = pose.rough(scanner, at.mean(axis=0))
    places = wall.far_places(prior, len(LANDMARKS)) if landmarks else np.zeros(0, dtype=np.int64)
    names = LANDMARKS[: len(places)]
    points, truth = mapped(catheter, prior.with_vertices(at), how, dict(zip(names, at[places], strict=True)))
    some = np.arange(0, len(at), EVERY)
    truth = replace(truth, correspondence=(prior.vertices[some], at[some]))
    marks = dict(zip(names, np.round(prior.vertices[places], 3), strict=True))
    left = remains(prior, beaten.vertices)
    said = f"{family}: seed {seed}, motion {motion:g}, {left:.2f} mm rms after the best similarity; {how}"
    name = f"family_{family}_{seed}"
    return case_of(name, prior, (points, truth), marks if landmarks else off @ rigid, said)
