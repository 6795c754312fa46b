"""Cases of the benchmarks: which there are in a folder, which group each belongs to, and how the standard
sets from real atria are made: python -m benchmarks.cases SET OUT --data FOLDER

    python -m benchmarks.cases cross cases/dev --data ../shared/data
    python -m benchmarks.cases families cases/judge --data ../shared/data --judging
    python -m benchmarks.cases cross cases/judge --data ../shared/data --judging --only '*_1_even_2*'
    python -m benchmarks.cases unvisited cases/dev --data ../shared/data
    python -m benchmarks.cases altered cases/dev --data ../shared/data

FOLDER holds priors/ls_prior, priors/toronto and priors/lasc2018; what is in them is third parties' and goes
into the cases only. Development cases (the default, seeds below 1000) are for choosing and for
benchmarks.peers, judging cases (from 2000) are for nothing but the score. `cross` takes five atria for
development and the other ten for judging; `pairs` takes every one of them as prior of every other, with few
points; `poses` crosses twenty patients' atria without landmarks, from a rough pose and in an unknown frame;
`families` moves all fifteen for judging, by other motions, `lasc` the atria of lasc2018; `unvisited`, `whole`
and `badly_segmented` have a patient's own atrium as the prior, and a map that leaves wall out, a dense one,
or a prior that lacks wall, `paths` a map that is taken along a path, `shuffled` the same map in no order;
`one_sided` a wall that is folded on one
side, or points that float there; `altered` has something wrong, and healthy cases beside it. Crossed cases
say prior_of = "template". Names are groups and seeds as benchmarks.accuracy reads them:

    cross_<points>_<noise>_<even|clustered>[_outliers]_<seed>      outliers: 5 %
    cross_250_1_even_<rough|unknown>_<seed>                        without landmarks
    family_<name>_<motion>_<landmarks|rough>_<seed>                250 points, noise per point; every second
                                                                   one clustered with 5 % outliers
    unvisited_<visits>_<points>_<even|clustered>_<seed>            visits: all, skipped, half, threequarters
    whole_<points>_<even|clustered>_<seed>                         noise 1.5 mm, 5 % outliers
    path_<groups|dragged>_<points>_<seed>                          errors that go together, 1 to 2 mm rms
    shuffled_<groups|dragged>_<points>_<seed>                      the same in no order
    <fold|crowd>_<points>_<seed>                   a side of the wall is 9 mm farther inside, or as many
                                                   points float there, down to 18 mm; noise 1 mm
    badly_segmented_<points>_<even|clustered>_<seed>
    altered_<what>_<points>_<seed>     what: a name of data_synth.altered.ALTERATIONS, or
        stranger    another person's prior, said to be the patient's
        inside      30 % of the points without contact
        healthy     even points, noise 1.5 mm, nothing wrong
        noisy       the same with 2 mm

Long vessels are cut 1.9 radii from the centre (data_synth.wall). Cases that are there already are left alone.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from functools import cache
from itertools import cycle, permutations, product
from pathlib import Path
from time import perf_counter
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from data_synth import (
    Mapping,
    Visits,
    atrium,
    badly_segmented,
    cross,
    family,
    lengthened,
    read_wall,
    unvisited,
)
from data_synth.alignment import alongside
from data_synth.altered import ALTERATIONS, altered
from data_synth.catheter import Path as Way
from data_synth.families import FAMILIES
from data_synth.faulty_maps import along, crowded, folded, shuffled
from data_synth.visits import SHARES
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.errors import InputError
from o3dls.geometry.surface import Surface
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case

# groups as benchmarks.accuracy names them
SEEDED = re.compile(
    r"(lah|la|(?:jar|star|extra|missing|sparse|beside)_\d+|cross_\d+_\S+|family_[a-z]+_\S+"
    r"|unvisited_[a-z]+_\d+_[a-z]+|whole_\d+_[a-z]+|(?:path|shuffled)_[a-z]+_\d+|(?:fold|crowd)_\d+"
    r"|badly_segmented_\d+_[a-z]+|altered_[a-z]+_\d+)_(\d+)$"
)
# groups that share one setting of the peers: crossed atria by number of points, but for the hardest, which
# have their own; families by name and strength
TUNED_TOGETHER = re.compile(r"(cross_\d+(?!_2_clustered_outliers)|family_[a-z]+_[\d.]+)(?:_|$)")

DEVELOPMENT = (
    "ls_prior/la_01.ply",
    "ls_prior/la_02.ply",
    "toronto/2018001_aligned_la.obj",
    "ls_prior/la_03.ply",
    "toronto/2018015_2018015_LA_Aligned.obj",
)
JUDGING = (
    "ls_prior/la_04.ply",
    "ls_prior/la_05.ply",
    "toronto/RegularHeart_NORMAL_LA.obj",
    "ls_prior/la_06.ply",
    "ls_prior/la_07.ply",
    "toronto/2018013_2018013_LA_Aligned.obj",
    "ls_prior/la_08.ply",
    "ls_prior/la_09.ply",
    "toronto/2018012_LA_Aligned.obj",
    "ls_prior/la_10.ply",
)
STEPS = (1, 3)  # from a prior to its truths in the list above: twenty pairs of ten, each atrium in four
POINTS = (100, 250, 1000, 4000, 20_000)
NOISE = (1.0, 2.0)
MOTIONS = (1.0, 2.0)
OUTLIERS = 0.05
FIRST_SEED = {
    "cross": {False: 101, True: 2101},
    "pairs": {False: 501, True: 2501},
    "families": {False: 301, True: 2301},
    "lasc": {False: 651, True: 2651},
    "unvisited": {False: 701, True: 2701},
    "altered": {False: 701, True: 2701},
    "badly_segmented": {False: 901, True: 2901},
    "whole": {False: 951, True: 3101},
    "paths": {False: 961, True: 3201},
    "one_sided": {False: 981, True: 3301},
    "poses": {False: 601, True: 3401},
}
FEW = (100, 250)
POSE_STEPS = {"rough": 1, "unknown": 7}  # from a prior to its truth in the list, of every way to start
# where the prior is the patient's own; lasc2018: the first without handles whose veins, made longer, touch
# no other wall
OWN_DEVELOPMENT = (
    "toronto/2018001_aligned_la.obj",
    "lasc2018/la_60.ply",
    "lasc2018/la_61.ply",
    "toronto/2018015_2018015_LA_Aligned.obj",
    "lasc2018/la_62.ply",
    "lasc2018/la_63.ply",
    "lasc2018/la_68.ply",
)
OWN_JUDGING = (
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
OWN_POINTS = (100, 350, 1000, 4000)
OWN_NOISE = 1.5
OWN_OUTLIERS = (0.0, 0.05)
WHOLE_POINTS = (1000, 4000, 20_000)
WHOLE = {False: 5, True: 10}  # atria, the last of each list
REACH = 2.6  # radii: CT veins stay longer than catheters go
PATHS = (("groups", False), ("dragged", True))  # how a catheter goes, and whether it is one tip
SIDE_POINTS, SIDE_NOISE, SIDE_ATRIA = (250, 1000, 4000), 1.0, (4, 10)
PATH_POINTS = (250, 500, 1000, 4000)
PATH_RMS, PATH_INSIDE = (1.0, 2.0), 0.08  # mm per axis, share
BAD_POINTS = (250, 1000)
BAD = {False: 5, True: 10}  # atria, the first of each list
LASC = {False: range(60, 80), True: range(80, 100)}  # numbers of atria of lasc2018
EACH_KIND = 3  # cases of a kind and number of points
PHANTOM = "phantom"
ALTERED_NOISE, MANY_OUTLIERS = 1.5, 0.3
# kinds and numbers of points, each three times, of the healthy ones more to count false alarms on. A seed is
# the place in this list: what is new goes to its end, and leaves the cases before it as they are
KINDS: tuple[tuple[str, tuple[int, ...]], ...] = (
    ("ventricle", (250, 1000)),
    ("aorta", (250, 1000)),
    ("beside", (250, 1000)),
    ("stranger", (250, 1000)),
    ("mirrored", (250, 1000)),
    ("lost", (250, 1000)),
    ("later", (250, 1000)),
    ("side", (250, 1000)),
    ("swapped", (250,)),
    ("mismarked", (250,)),
    ("scaled", (250,)),
    ("inside", (250, 1000)),
    ("path", (250, 1000)),
    ("segmented", (250, 1000)),
    ("half", (250,)),
    ("healthy", (250, 250, 1000, 4000)),
    ("noisy", (250, 1000, 4000)),
    ("floating", (250, 1000)),
    ("tented", (250, 1000)),
    ("breathing", (250, 1000)),
    ("veins", (350, 1000)),
    ("quarter", (250,)),
    ("path", (4000,)),
    ("ventricle", (500,)),
    ("aorta", (500,)),
    ("side", (500,)),
    ("scaled", (1000,)),
    ("breathing", (2000,)),
    ("floating", (2000,)),
    ("tented", (2000,)),
    ("ventricle", (2000,)),
    ("aorta", (2000,)),
)
TAKEN = {"half": 2, "quarter": 4, "veins": 1.6}  # times the points, of which a part is kept
WITHOUT_PHANTOMS = ("stranger", "inside", "healthy", "noisy", "veins")


@dataclass(frozen=True, order=True)
class Listed:
    """A case folder, perhaps with another file of points; `seed` is None where the case came from no
    generator.
    """

    group: str
    name: str
    folder: Path
    points: Path | None = None
    seed: int | None = None

    def read(self) -> Case:
        """The case; where other points are fitted, the ablation points are those of the case itself, for
        scoring.
        """
        case = read_case(self.folder)
        if self.points is None:
            return case
        noisy = read_case(self.folder, points=self.points)
        columns = {
            k: np.concatenate(
                [v[noisy.points.type != "ablation"], case.points.columns[k][case.points.type == "ablation"]]
            )
            for k, v in noisy.points.columns.items()
            if k in case.points.columns
        }
        keep = noisy.points.type != "ablation"
        own = case.points.type == "ablation"
        xyz = np.vstack([noisy.points.xyz[keep], case.points.xyz[own]])
        kind = np.concatenate([noisy.points.type[keep], case.points.type[own]])
        return replace(noisy, points=replace(noisy.points, xyz=xyz, type=kind, columns=columns, order=None))


def tuned_as(group: str) -> str:
    """Name that a group's settings of the peers have."""
    wider = TUNED_TOGETHER.match(group)
    return wider[1] if wider else group


def find(folders: Iterable[Path]) -> list[Listed]:
    """Every case folder among or in the folders given, sorted by group. Raises InputError where there is
    none.
    """
    found = sorted(
        {case for folder in folders for case in _find_in(Path(folder))},
        key=lambda c: (c.group, c.seed or 0, c.name),
    )
    if not found:
        raise InputError(f"no case folder (with points.csv and prior.*) in {', '.join(map(str, folders))}")
    return found


def _find_in(folder: Path) -> Iterator[Listed]:
    for path in [folder, *sorted(p for p in folder.rglob("*") if p.is_dir())]:
        if not (path / "points.csv").is_file() or not list(path.glob("prior.*")):
            continue
        seeded = SEEDED.match(path.name)
        if seeded:
            yield Listed(seeded[1], path.name, path, None, int(seeded[2]))
            continue
        yield Listed(path.name, path.name, path)
        # the same case with other points, such as noisier ones
        for other in sorted(path.glob("points_*.csv")):
            name = f"{path.name}+{other.stem.removeprefix('points_')}"
            yield Listed(name, name, path, other)


@dataclass(frozen=True)
class Wanted:
    """A case by its name, and what it is made of; truth is None where the prior itself moved."""

    name: str
    seed: int
    how: Mapping
    prior: str
    truth: str | None = None
    family: str = ""
    motion: float = 1.0
    landmarks: bool = True

    def case(self, data: Path) -> Case:
        return made(self, data)


class CaseOfASet(Protocol):
    """A case of any set: what it is called and made of, and how it is made from the folder of data."""

    @property
    def name(self) -> str: ...
    @property
    def seed(self) -> int: ...
    @property
    def prior(self) -> str: ...
    @property
    def truth(self) -> str | None: ...

    def case(self, data: Path) -> Case: ...


def crossed(judging: bool) -> Iterator[Wanted]:
    """Every pair with every number of points, noise and spread; the seed is the pair's."""
    atria = JUDGING if judging else DEVELOPMENT
    pairs = [
        (k, (k + step) % len(atria)) for step in (STEPS if judging else STEPS[:1]) for k in range(len(atria))
    ]
    kinds = product(POINTS, NOISE, (False, True), (0.0, OUTLIERS))
    for points, noise, clustered, outliers in kinds:
        group = f"cross_{points}_{noise:g}_" + ("clustered" if clustered else "even")
        group += "_outliers" if outliers else ""
        for seed, (a, b) in enumerate(pairs, FIRST_SEED["cross"][judging]):
            how = Mapping(points, noise, clustered, outliers)
            yield Wanted(f"{group}_{seed}", seed, how, atria[a], atria[b])


def paired(judging: bool) -> Iterator[Wanted]:
    """Every ordered pair of atria, mapped evenly with few points; the seed is the pair's."""
    atria = JUDGING if judging else DEVELOPMENT
    for points, noise in product(FEW, NOISE):
        for seed, (prior, truth) in enumerate(permutations(atria, 2), FIRST_SEED["pairs"][judging]):
            how = Mapping(points, noise, False, 0.0)
            yield Wanted(f"cross_{points}_{noise:g}_even_{seed}", seed, how, prior, truth)


@dataclass(frozen=True)
class WithoutLandmarks:
    """A crossed case by its name, which starts from a rough pose or, in an unknown frame, from none."""

    name: str
    seed: int
    prior: str
    truth: str
    unknown: bool

    def case(self, data: Path) -> Case:
        near = _align_vertices(data, self.prior, self.truth)
        walls = _read_wall(data, self.prior), _read_wall(data, self.truth)
        found = cross(*walls, self.seed, landmarks=False, how=Mapping(250, NOISE[0], False, 0.0), near=near)
        if self.unknown:
            turn = Rotation.random(rng=np.random.default_rng((self.seed, 3407))).as_matrix()
            turned = found.prior.with_vertices(found.prior.vertices @ turn.T)
            found = replace(found, prior=turned, init=None)
        return replace(found, prior_of="template")


def without_landmarks(judging: bool) -> Iterator[WithoutLandmarks]:
    """Twenty patients' atria, each the prior of one from a rough pose and of another in an unknown frame."""
    numbers = LASC[judging]
    seed = FIRST_SEED["poses"][judging]
    for (way, step), k in product(POSE_STEPS.items(), range(len(numbers))):
        prior, truth = (f"lasc2018/la_{numbers[one % len(numbers)]}.ply" for one in (k, k + step))
        yield WithoutLandmarks(f"cross_250_1_even_{way}_{seed}", seed, prior, truth, way == "unknown")
        seed += 1


def moved(judging: bool) -> Iterator[Wanted]:
    """Every atrium by a motion of every family, plain and large, with and without landmarks: twice for
    judging, so that each is mapped evenly and in clusters once.
    """
    atria = (DEVELOPMENT + JUDGING) * 2 if judging else DEVELOPMENT
    for name, motion, landmarks in product(FAMILIES, MOTIONS, (True, False)):
        group = f"family_{name}_{motion:g}_{'landmarks' if landmarks else 'rough'}"
        for seed, prior in enumerate(atria, FIRST_SEED["families"][judging]):
            clustered = seed % 2 == 0
            how = Mapping(250, None, clustered, OUTLIERS if clustered else 0.0)
            yield Wanted(f"{group}_{seed}", seed, how, prior, family=name, motion=motion, landmarks=landmarks)


def moved_of_lasc(judging: bool) -> Iterator[Wanted]:
    """Every atrium of lasc2018 by a motion, plain and large, with landmarks: families, and maps that are even
    or in clusters, take turns.
    """
    for motion in MOTIONS:
        for k, number in enumerate(LASC[judging]):
            seed = FIRST_SEED["lasc"][judging] + k
            name = list(FAMILIES)[k % len(FAMILIES)]
            clustered = k // len(FAMILIES) % 2 == 0
            how = Mapping(250, None, clustered, OUTLIERS if clustered else 0.0)
            named = f"family_{name}_{motion:g}_landmarks_{seed}"
            yield Wanted(named, seed, how, f"lasc2018/la_{number}.ply", family=name, motion=motion)


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
    for a, prior in enumerate(OWN_JUDGING if judging else OWN_DEVELOPMENT):
        for v, (where, clustered) in enumerate(product(SHARES, (False, True))):
            seed = FIRST_SEED["unvisited"][judging] + 8 * a + v
            points = OWN_POINTS[-(v // 2 + 2 * (v % 2) + a) % len(OWN_POINTS)]
            drawn = np.random.default_rng((seed, 80_173))
            family, outliers = str(drawn.choice(list(FAMILIES))), float(drawn.choice(OWN_OUTLIERS))
            how = Mapping(points, OWN_NOISE, clustered, outliers)
            name = f"unvisited_{where}_{points}_{'clustered' if clustered else 'even'}_{seed}"
            yield Unvisited(name, seed, how, prior, Visits(where), family, bool(drawn.integers(2)))


def densely_mapped(judging: bool) -> Iterator[Wanted]:
    """Some patients' own atria with a plain motion and many points, of which T alone may be as near as any
    reconstruction; families take turns.
    """
    atria = (OWN_JUDGING if judging else OWN_DEVELOPMENT)[-WHOLE[judging] :]
    for points, clustered in product(WHOLE_POINTS, (False, True)):
        for k, (prior, motion) in enumerate(zip(atria, cycle(FAMILIES), strict=False)):
            seed = FIRST_SEED["whole"][judging] + k
            how = Mapping(points, OWN_NOISE, clustered, OUTLIERS)
            name = f"whole_{points}_{'clustered' if clustered else 'even'}_{seed}"
            yield Wanted(name, seed, how, prior, family=motion)


@dataclass(frozen=True)
class AlongPath:
    """A case whose map is taken along a path, by its name, and what it is made of."""

    name: str
    seed: int
    points: int
    prior: str
    family: str
    dragged: bool
    in_order: bool = True
    truth: None = None

    def case(self, data: Path) -> Case:
        prior = _read_wall(data, self.prior)
        still = family(prior, self.seed, family=self.family, how=Mapping(self.points, OWN_NOISE, False))
        rng = np.random.default_rng((self.seed, self.points, 70_841))
        found = along(rng, still, Way(self.points, rng.uniform(*PATH_RMS), PATH_INSIDE, self.dragged))
        return found if self.in_order else shuffled(rng, found)


def along_paths(judging: bool) -> Iterator[AlongPath]:
    """Some patients' own atria with a plain motion, mapped by electrode groups or by one tip that is dragged,
    with errors that go together; families take turns.
    """
    atria = (OWN_JUDGING if judging else OWN_DEVELOPMENT)[-WHOLE[judging] :]
    for (way, dragged), points in product(PATHS, PATH_POINTS):
        for k, (prior, motion) in enumerate(zip(atria, cycle(FAMILIES), strict=False)):
            seed = FIRST_SEED["paths"][judging] + k
            yield AlongPath(f"path_{way}_{points}_{seed}", seed, points, prior, motion, dragged)


def in_no_order(judging: bool) -> Iterator[AlongPath]:
    """The same maps, whose order was lost."""
    for path in along_paths(judging):
        yield replace(path, name=path.name.replace("path", "shuffled"), in_order=False)


@dataclass(frozen=True)
class OneSided:
    """A case of one's own atrium on one side of which the wall is elsewhere, or no point touches it."""

    name: str
    seed: int
    points: int
    prior: str
    family: str
    crowd: bool
    truth: None = None

    def case(self, data: Path) -> Case:
        prior = _read_wall(data, self.prior)
        still = family(prior, self.seed, family=self.family, how=Mapping(self.points, SIDE_NOISE, False))
        rng = np.random.default_rng((self.seed, self.points, 60_247))
        return (crowded if self.crowd else folded)(rng, still)


def one_sided(judging: bool) -> Iterator[OneSided]:
    """Some patients' own atria, evenly mapped, with a fold of the wall on one side and, of the same atrium,
    with as many points that float there.
    """
    first = FIRST_SEED["one_sided"][judging]
    for points, (kind, crowd) in product(SIDE_POINTS, (("fold", False), ("crowd", True))):
        for k, motion in zip(range(SIDE_ATRIA[judging]), cycle(FAMILIES), strict=False):
            prior = f"lasc2018/la_{(80 if judging else 60) + 2 * k}.ply"
            yield OneSided(f"{kind}_{points}_{first + k}", first + k, points, prior, motion, crowd)


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
            _read_wall(data, self.prior),
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
    atria = (OWN_JUDGING if judging else OWN_DEVELOPMENT)[: BAD[judging]]
    for k, (points, (a, prior)) in enumerate(product(BAD_POINTS, enumerate(atria))):
        seed = FIRST_SEED["badly_segmented"][judging] + k
        clustered, remeshed = (a + k // len(atria)) % 2 == 1, a // 2 % 2 == 0
        drawn = np.random.default_rng((seed, 80_173))
        family, outliers = str(drawn.choice(list(FAMILIES))), float(drawn.choice(OWN_OUTLIERS))
        how = Mapping(points, OWN_NOISE, clustered, outliers)
        name = f"badly_segmented_{points}_{'clustered' if clustered else 'even'}_{seed}"
        yield BadlySegmented(name, seed, how, prior, family, bool(drawn.integers(2)), remeshed)


@cache
def long_veined(data: Path, name: str) -> Surface:
    """An atrium whose veins are longer than a catheter goes: CT veins are, those of lasc2018 are made so."""
    surface = read_wall(data / "priors" / name, REACH)
    return surface if name.startswith("toronto") else lengthened(surface)


@dataclass(frozen=True)
class Altered:
    """An altered case by its name, and what it is made of; truth: whose atrium is mapped, where it is not the
    prior's own.
    """

    name: str
    seed: int
    kind: str
    points: int
    prior: str
    truth: str | None = None

    def case(self, data: Path) -> Case:
        """The case itself."""
        good = self._make_good(data)
        return altered(good, self.kind, self.seed) if self.kind in ALTERATIONS else good

    def _make_good(self, data: Path) -> Case:
        """The case before it is altered."""
        points = round(self.points * TAKEN.get(self.kind, 1))
        motion = 1.0 if self.kind in ("healthy", "noisy") else 1.0 + self.seed % 2
        if self.prior == PHANTOM:
            return atrium(self.seed, motion=motion, noise=ALTERED_NOISE, points=points, outliers=OUTLIERS)
        prior, how = _read_wall(data, self.prior), self._choose_mapping(points)
        if self.truth:
            return cross(prior, _read_wall(data, self.truth), self.seed, how=how)
        name = list(FAMILIES)[self.seed % len(FAMILIES)]
        return family(prior, self.seed, family=name, motion=motion, how=how)

    def _choose_mapping(self, points: int) -> Mapping:
        if self.kind in ("healthy", "noisy"):
            return Mapping(points, 2.0 if self.kind == "noisy" else ALTERED_NOISE, False)
        clustered = self.seed % 2 == 0 and self.kind != "veins"  # even as a density filter leaves them
        return Mapping(points, ALTERED_NOISE, clustered, MANY_OUTLIERS if self.kind == "inside" else OUTLIERS)


def altered_cases(judging: bool) -> Iterator[Altered]:
    """Cases with something wrong, and healthy ones beside them. Atria are la_60 to la_79 of lasc2018 to
    develop and la_80 to la_99 to judge, every fourth one of ls_prior or toronto, and where the alteration
    allows phantoms. They move by the families of data_synth in turn, healthy ones with strength 1, others
    with 1 or 2.
    """
    first = FIRST_SEED["altered"][judging]
    wanted = [(kind, n) for kind, many in KINDS for n in many for _ in range(EACH_KIND)]
    atria = _take_turns(LASC[judging], JUDGING if judging else DEVELOPMENT, 2 * len(wanted))
    for k, (kind, points) in enumerate(wanted):
        prior = PHANTOM if k % EACH_KIND == 1 and kind not in WITHOUT_PHANTOMS else next(atria)
        truth = next(atria) if kind == "stranger" else None
        yield Altered(f"altered_{kind}_{points}_{first + k}", first + k, kind, points, prior, truth)


def _take_turns(numbers: Sequence[int], others: Sequence[str], count: int) -> Iterator[str]:
    """Names of atria in turn: of lasc2018 by their numbers, and every fourth of the others."""
    for k in range(count):
        if k % 4 == 3:
            yield others[k // 4 % len(others)]
        else:
            yield f"lasc2018/la_{numbers[(k - k // 4) % len(numbers)]}.ply"


SETS: dict[str, Callable[[bool], Iterator[CaseOfASet]]] = {
    "cross": crossed,
    "pairs": paired,
    "poses": without_landmarks,
    "families": moved,
    "lasc": moved_of_lasc,
    "unvisited": left_out,
    "whole": densely_mapped,
    "paths": along_paths,
    "shuffled": in_no_order,
    "one_sided": one_sided,
    "badly_segmented": bad_priors,
    "altered": altered_cases,
}


def made(wanted: Wanted, data: Path) -> Case:
    """The case itself."""
    prior = _read_wall(data, wanted.prior)
    if wanted.truth is None:
        return family(
            prior,
            wanted.seed,
            family=wanted.family,
            motion=wanted.motion,
            landmarks=wanted.landmarks,
            how=wanted.how,
        )
    near = _align_vertices(data, wanted.prior, wanted.truth)
    crossed_case = cross(prior, _read_wall(data, wanted.truth), wanted.seed, how=wanted.how, near=near)
    return replace(crossed_case, prior_of="template")


def _with_later_seed(wanted: CaseOfASet, by: int) -> CaseOfASet:
    """The same kind of case with another seed, which its name ends with."""
    seed = wanted.seed + by
    return replace(wanted, seed=seed, name=f"{wanted.name.rpartition('_')[0]}_{seed}")  # type: ignore[type-var]


@cache
def _read_wall(data: Path, name: str) -> Surface:
    return read_wall(data / "priors" / name)


@cache
def _align_vertices(data: Path, prior: str, truth: str) -> Array:
    return alongside(_read_wall(data, prior), _read_wall(data, truth))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("set", choices=SETS)
    parser.add_argument("out", type=Path)
    parser.add_argument("--data", type=Path, required=True, help="the folder above priors/")
    parser.add_argument("--judging", action="store_true", help="the cases that nothing is chosen on")
    parser.add_argument("--only", default="*", metavar="PATTERN", help="names, as the shell matches them")
    parser.add_argument("--list", action="store_true", help="print names and what they are made of, no cases")
    parser.add_argument(
        "--later", type=int, default=0, metavar="N", help="add N to the seeds: cases that nobody has tried"
    )
    arguments = parser.parse_args()
    for first in SETS[arguments.set](arguments.judging):
        wanted = _with_later_seed(first, arguments.later)
        if not fnmatch(wanted.name, arguments.only):
            continue
        said = f"{wanted.name}: {wanted.prior}" + (f" -> {wanted.truth}" if wanted.truth else "")
        folder = arguments.out / wanted.name
        if arguments.list or folder.exists():
            print(said)
            continue
        begin = perf_counter()
        write_case(folder, wanted.case(arguments.data))
        print(f"{said}, {perf_counter() - begin:.1f} s", flush=True)


if __name__ == "__main__":
    main()
