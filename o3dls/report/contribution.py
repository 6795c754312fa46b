"""What each stage on the way to the last estimate brought, on the set of points that speaks first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

from .markup import signed
from .subject import Subject

LEAST = 0.005  # smaller changes would be written as 0.00


@dataclass(frozen=True)
class Step:
    """A step is a stage, with the mean distance before and after it."""

    stage: str
    before: float
    after: float

    @property
    def change(self) -> float:
        """The change of the mean distance; it is negative where the stage came closer."""
        return self.after - self.before


def steps(subject: Subject) -> list[Step]:
    """Return the stages from the start of the run to its last estimate shown, each with its means."""
    scores = subject.last.run.scores
    key = f"mean_{subject.unit}"
    group = subject.headline or ""
    means = {name: found[group][key] for name, found in scores.items() if group in found}
    way = [name for name in _trace_way(subject) if name in means]
    return [Step(name, means[before], means[name]) for before, name in pairwise(way)]


def _trace_way(subject: Subject) -> list[str]:
    """Return names of the estimates from the first to the last, each begun from the one before it."""
    origin = _find_origins(subject)
    way = [subject.last.key]
    while way[-1] in origin:
        way.append(origin[way[-1]])
    return way[::-1]


def _find_origins(subject: Subject) -> Mapping[str, str]:
    """Return the estimate that each stage began from: the one before it, or the one named by `after`."""
    names = list(subject.last.run.estimates)
    made = subject.last.run.provenance.parameters
    return {name: made.get(f"{name}.after") or before for before, name in pairwise(names)}


def credit(subject: Subject) -> str | None:
    """Say which stage after the baseline gained most, where that is not the last one."""
    found = steps(subject)
    names = [one.stage for one in found]
    if subject.first is None or subject.first.run is not subject.last.run:
        return None
    begin = names.index(subject.first.key) + 1 if subject.first.key in names else 0
    since = found[begin:]
    best = min(since, key=lambda one: one.change, default=None)
    if best is None or best.stage == subject.last.key or best.change > -LEAST:
        return None
    unit, own = subject.unit, since[-1]
    return (
        f"The largest gain is that of {best.stage} ({signed(best.change)} {unit}); {own.stage} itself "
        f"changed the mean by {signed(own.change)} {unit}."
    )
