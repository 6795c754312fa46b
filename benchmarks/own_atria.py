"""Cases whose prior is the patient's own atrium: maps that leave wall out, and priors that are badly
segmented. The file says which anatomies develop and which judge; benchmarks.make_cases writes them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np

from data_synth import Mapping, Visits, badly_segmented, lengthened, read_wall, unvisited
from data_synth.families import FAMILIES
from data_synth.visits import SHARES
from o3dls.case import Case
from o3dls.geometry.surface import Surface

# lasc2018: the first without handles whose veins, made longer, touch no other wall
DEVELOPMENT = (
    "toronto/2018001_aligned_la.obj",
    "lasc2018/la_60.ply",
    "lasc2018/la_61.ply",
    "toronto/2018015_2018015_LA_Aligned.obj",
    "lasc2018/la_62.ply",
    "lasc2018/la_63.ply",
    "lasc2018/la_68.ply",
)
JUDGING = (
    "toronto/2018001_aligned_la.obj",
    "lasc2018/la_80.ply",
    "lasc2018/la_81.ply",
    "toronto/2018012_LA_Aligned.obj",
    "lasc2018/la_84.ply",
    "lasc2018/la_85.ply",
    "toronto/2018013_2018013_LA_Aligned.obj",
    "lasc2018/la_86.ply",
    "lasc2018/la_87.ply",
    "toronto/2018015_2018015_LA_Aligned.obj",
    "lasc2018/la_88.ply",
    "lasc2018/la_91.ply",
    "toronto/RegularHeart_NORMAL_LA.obj",
    "lasc2018/la_92.ply",
    "lasc2018/la_94.ply",
)
POINTS = (100, 350, 1000, 4000)
NOISE = 1.5
OUTLIERS = (0.0, 0.05)
REACH = 2.6  # radii: CT veins stay longer than catheters go
FIRST_SEED = {False: 701, True: 2701}
BAD_SEED = {False: 901, True: 2901}
BAD_POINTS = (250, 1000)
BAD = {False: 5, True: 10}  # atria, the first of each list


@dataclass(frozen=True)
class Unvisited:
    """A case by its name, and what it is made of."""

    name: str
    seed: int
    how: Mapping
    prior: str
    visits: Visits
    family: str
    landmarks: bool
    truth: None = None

    def case(self, data: Path) -> Case:
        prior = long_veined(data, self.prior)
        return unvisited(
            prior, self.seed, self.visits, family=self.family, landmarks=self.landmarks, how=self.how
        )


def left_out(judging: bool) -> Iterator[Unvisited]:
    """Every atrium by every kind of visit, evenly and in clusters. The number of points takes turns, so that
    each kind of visit meets each number, on other atria; motion, outliers and start are drawn.
    """
    for a, atrium in enumerate(JUDGING if judging else DEVELOPMENT):
        for v, (where, clustered) in enumerate(product(SHARES, (False, True))):
            seed = FIRST_SEED[judging] + 8 * a + v
            points = POINTS[-(v // 2 + 2 * (v % 2) + a) % len(POINTS)]
            drawn = np.random.default_rng((seed, 80_173))
            family, outliers = str(drawn.choice(list(FAMILIES))), float(drawn.choice(OUTLIERS))
            how = Mapping(points, NOISE, clustered, outliers)
            name = f"unvisited_{where}_{points}_{'clustered' if clustered else 'even'}_{seed}"
            yield Unvisited(name, seed, how, atrium, Visits(where), family, bool(drawn.integers(2)))


@dataclass(frozen=True)
class BadlySegmented:
    """A case whose prior lacks what the truth has, by its name, and what it is made of."""

    name: str
    seed: int
    how: Mapping
    prior: str
    family: str
    landmarks: bool
    remeshed: bool
    truth: None = None

    def case(self, data: Path) -> Case:
        return badly_segmented(
            read_wall(data / "priors" / self.prior),
            self.seed,
            family=self.family,
            landmarks=self.landmarks,
            how=self.how,
            remeshed=self.remeshed,
        )


def bad_priors(judging: bool) -> Iterator[BadlySegmented]:
    """Some atria with both numbers of points, even and in clusters in turns, and so are the two ways from
    voxels to a surface; motion, outliers and start are drawn.
    """
    atria = (JUDGING if judging else DEVELOPMENT)[: BAD[judging]]
    for k, (points, (a, atrium)) in enumerate(product(BAD_POINTS, enumerate(atria))):
        seed, clustered, remeshed = BAD_SEED[judging] + k, (a + k // len(atria)) % 2 == 1, a // 2 % 2 == 0
        drawn = np.random.default_rng((seed, 80_173))
        family, outliers = str(drawn.choice(list(FAMILIES))), float(drawn.choice(OUTLIERS))
        how = Mapping(points, NOISE, clustered, outliers)
        name = f"badly_segmented_{points}_{'clustered' if clustered else 'even'}_{seed}"
        yield BadlySegmented(name, seed, how, atrium, family, bool(drawn.integers(2)), remeshed)


@cache
def long_veined(data: Path, name: str) -> Surface:
    """An atrium whose veins are longer than a catheter goes: CT veins are, those of lasc2018 are made so."""
    surface = read_wall(data / "priors" / name, REACH)
    return surface if name.startswith("toronto") else lengthened(surface)
