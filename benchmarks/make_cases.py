"""The standard sets of cases from real atria: python -m benchmarks.make_cases SET OUT --data FOLDER

    python -m benchmarks.make_cases cross cases/dev --data ../shared/data
    python -m benchmarks.make_cases families cases/judge --data ../shared/data --judging
    python -m benchmarks.make_cases cross cases/judge --data ../shared/data --judging --only '*_1_even_2*'
    python -m benchmarks.make_cases unvisited cases/dev --data ../shared/data
    python -m benchmarks.make_cases altered cases/dev --data ../shared/data

FOLDER holds priors/ls_prior, priors/toronto and priors/lasc2018; what is in them is third parties' and goes
into the cases only. Development cases (the default, seeds below 1000) are for choosing and for
benchmarks.peers, judging cases (from 2000) are for nothing but the score. `cross` takes five atria for
development and the other ten for judging; `pairs` takes every one of them as prior of every other, with few
points; `families` moves all fifteen for judging, by other motions; `unvisited` and `badly_segmented` have a
patient's own atrium as the prior, and a map that leaves wall out or a prior that does (benchmarks.own_atria);
`altered` has something wrong (benchmarks.altered_cases). Crossed cases say prior_of = "template". Names are
groups and seeds as benchmarks.accuracy reads them:

    cross_<points>_<noise>_<even|clustered>[_outliers]_<seed>      outliers: 5 %
    family_<name>_<motion>_<landmarks|rough>_<seed>                250 points, noise per point; every second
                                                                   one clustered with 5 % outliers
    unvisited_<visits>_<points>_<even|clustered>_<seed>            visits: all, skipped, half, threequarters
    badly_segmented_<points>_<even|clustered>_<seed>

Long vessels are cut 1.9 radii from the centre (data_synth.wall). Cases that are there already are left alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from functools import cache
from itertools import permutations, product
from pathlib import Path
from time import perf_counter
from typing import Protocol

from benchmarks.altered_cases import Altered, altered_cases
from benchmarks.own_atria import bad_priors, left_out
from data_synth import Mapping, cross, family, read_wall
from data_synth.alignment import alongside
from data_synth.families import FAMILIES
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.geometry.surface import Surface
from o3dls.io.case_writer import write_case

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
}
FEW = (100, 250)


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


def moved(judging: bool) -> Iterator[Wanted]:
    """Every atrium by a motion of every family, plain and large, with and without landmarks: twice for
    judging, so that each is mapped evenly and in clusters once.
    """
    atria = (DEVELOPMENT + JUDGING) * 2 if judging else DEVELOPMENT
    for name, motion, landmarks in product(FAMILIES, MOTIONS, (True, False)):
        group = f"family_{name}_{motion:g}_{'landmarks' if landmarks else 'rough'}"
        for seed, atrium in enumerate(atria, FIRST_SEED["families"][judging]):
            clustered = seed % 2 == 0
            how = Mapping(250, None, clustered, OUTLIERS if clustered else 0.0)
            yield Wanted(
                f"{group}_{seed}", seed, how, atrium, family=name, motion=motion, landmarks=landmarks
            )


def wrong(judging: bool) -> Iterator[Altered]:
    """Cases with something wrong, and healthy ones beside them."""
    return altered_cases(judging, JUDGING if judging else DEVELOPMENT)


SETS: dict[str, Callable[[bool], Iterator[CaseOfASet]]] = {
    "cross": crossed,
    "pairs": paired,
    "families": moved,
    "unvisited": left_out,
    "badly_segmented": bad_priors,
    "altered": wrong,
}


def made(wanted: Wanted, data: Path) -> Case:
    """The case itself."""
    prior = _wall(data, wanted.prior)
    if wanted.truth is None:
        return family(
            prior,
            wanted.seed,
            family=wanted.family,
            motion=wanted.motion,
            landmarks=wanted.landmarks,
            how=wanted.how,
        )
    near = _near(data, wanted.prior, wanted.truth)
    crossed_case = cross(prior, _wall(data, wanted.truth), wanted.seed, how=wanted.how, near=near)
    return replace(crossed_case, prior_of="template")


@cache
def _wall(data: Path, name: str) -> Surface:
    return read_wall(data / "priors" / name)


@cache
def _near(data: Path, prior: str, truth: str) -> Array:
    return alongside(_wall(data, prior), _wall(data, truth))


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
    arguments = parser.parse_args()
    for wanted in SETS[arguments.set](arguments.judging):
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
