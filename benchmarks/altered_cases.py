"""The cases of `python -m benchmarks.make_cases altered`: with something wrong, and healthy ones beside them.

    altered_<what>_<points>_<seed>     what: a name of data_synth.altered.ALTERATIONS, or
        stranger    another person's prior, said to be the patient's
        inside      30 % of the points without contact
        healthy     even points, noise 1.5 mm, nothing wrong
        noisy       the same with 2 mm

Atria are priors/lasc2018 la_60 to la_79 to develop and la_80 to la_99 to judge, every fourth one of ls_prior
or toronto as benchmarks.make_cases parts them, and where the alteration allows phantoms. They move by the
families of data_synth in turn, healthy ones with strength 1, others with 1 or 2.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from data_synth import Mapping, atrium, cross, family, read_wall
from data_synth.altered import ALTERATIONS, altered
from data_synth.families import FAMILIES
from o3dls.case import Case
from o3dls.geometry.surface import Surface

LASC = {False: range(60, 80), True: range(80, 100)}
FIRST_SEED = {False: 701, True: 2701}
EACH = 3  # cases of a kind and number of points
PHANTOM = "phantom"
NOISE, OUTLIERS, MANY = 1.5, 0.05, 0.3
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
        good = self._good(data)
        return altered(good, self.kind, self.seed) if self.kind in ALTERATIONS else good

    def _good(self, data: Path) -> Case:
        """The case before it is altered."""
        points = round(self.points * TAKEN.get(self.kind, 1))
        motion = 1.0 if self.kind in ("healthy", "noisy") else 1.0 + self.seed % 2
        if self.prior == PHANTOM:
            return atrium(self.seed, motion=motion, noise=NOISE, points=points, outliers=OUTLIERS)
        prior, how = _wall(data, self.prior), self._mapping(points)
        if self.truth:
            return cross(prior, _wall(data, self.truth), self.seed, how=how)
        name = list(FAMILIES)[self.seed % len(FAMILIES)]
        return family(prior, self.seed, family=name, motion=motion, how=how)

    def _mapping(self, points: int) -> Mapping:
        if self.kind in ("healthy", "noisy"):
            return Mapping(points, 2.0 if self.kind == "noisy" else NOISE, False)
        clustered = self.seed % 2 == 0 and self.kind != "veins"  # even as a density filter leaves them
        return Mapping(points, NOISE, clustered, MANY if self.kind == "inside" else OUTLIERS)


def altered_cases(judging: bool, others: Sequence[str]) -> Iterator[Altered]:
    """The altered cases; others: atria beside those of lasc2018."""
    first = FIRST_SEED[judging]
    wanted = [(kind, n) for kind, many in KINDS for n in many for _ in range(EACH)]
    atria = _atria(judging, others, 2 * len(wanted))
    for k, (kind, points) in enumerate(wanted):
        prior = PHANTOM if k % EACH == 1 and kind not in WITHOUT_PHANTOMS else next(atria)
        truth = next(atria) if kind == "stranger" else None
        yield Altered(f"altered_{kind}_{points}_{first + k}", first + k, kind, points, prior, truth)


def _atria(judging: bool, others: Sequence[str], count: int) -> Iterator[str]:
    """Names of atria in turn, every fourth of the others."""
    numbers = LASC[judging]
    for k in range(count):
        if k % 4 == 3:
            yield others[k // 4 % len(others)]
        else:
            yield f"lasc2018/la_{numbers[(k - k // 4) % len(numbers)]}.ply"


@cache
def _wall(data: Path, name: str) -> Surface:
    return read_wall(data / "priors" / name)
