"""A real atrium that moved by a motion of one of the families."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from o3dls import Case, Surface

from . import pose, wall
from .families import moved, remains
from .mapping import Mapping, case_of, mapped
from .sampling import Rows
from .shapes import Array

LANDMARKS = ("L1", "L2", "L3", "L4")
EVERY = 5  # vertices, of those whose way is written down


@dataclass(frozen=True, eq=False)
class Beaten:
    """A wall that has moved and lies in a mapping system's frame, the rigid matrix (4, 4) into that frame, a
    rough one, and what the best similarity leaves of the motion (mm rms).
    """

    wall: Surface
    rigid: Array
    rough: Array
    left: float


def beaten(
    rest: Surface, family: str, strength: float, beat: np.random.Generator, scanner: np.random.Generator
) -> Beaten:
    """A wall after a motion of a family (`families.moved`): its size is another by up to 5 %, it lies in
    another frame. `beat` draws the motion, `scanner` the pose.
    """
    after = moved(rest, family, beat, strength)
    rigid, scale = pose.frame(scanner), scanner.uniform(*pose.SCALE)
    middle = rest.vertices.mean(axis=0)
    at = pose.under(rigid, middle + scale * (after.vertices - middle))
    off = pose.rough(scanner, at.mean(axis=0))
    return Beaten(rest.with_vertices(at), rigid, off @ rigid, remains(rest, after.vertices))


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
    after = beaten(prior, family, motion, beat, scanner)
    places = wall.far_places(prior, len(LANDMARKS)) if landmarks else np.zeros(0, dtype=np.int64)
    points, truth = mapped(catheter, after.wall, how, named(after.wall, places))
    truth = replace(truth, correspondence=ways_of(prior, after.wall))
    said = (
        f"{family}: seed {seed}, motion {motion:g}, {after.left:.2f} mm rms after the best similarity; {how}"
    )
    start = marked(prior, places) if landmarks else after.rough
    return case_of(f"family_{family}_{seed}", prior, (points, truth), start, said)


def named(surface: Surface, places: Rows) -> dict[str, Array]:
    """The positions (3,) of vertices by the landmarks' names."""
    return dict(zip(LANDMARKS, surface.vertices[places], strict=False))


def marked(prior: Surface, places: Rows) -> dict[str, Array]:
    """The same, as somebody reads them off."""
    return {name: np.round(at, 3) for name, at in named(prior, places).items()}


def ways_of(rest: Surface, after: Surface) -> tuple[Array, Array]:
    """Some vertices (k, 3) at rest, and where they have moved."""
    some = np.arange(0, len(rest.vertices), EVERY)
    return rest.vertices[some], after.vertices[some]
