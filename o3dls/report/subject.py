"""What a report is about, from one finished run or several: one case, the estimates, their distances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..case import Case, Points
from ..errors import InputError, did_you_mean
from ..estimate import Estimate
from ..evaluation.interpolation import REACH
from ..geometry.cut_wall import on_cut
from ..geometry.surface import Surface
from ..runs.folder import day_of_end
from ..runs.run import Run
from .palette import places
from .surfaces.display import displayed
from .surfaces.given import found_poses

MOST_SHOWN = 4
HEADLINE = ("held_out", "cross_validated", "ablation", "fitted")  # a run's headline is the first that it has
SETS = {
    "held_out": "held out",
    "held_out_seen": "held out, mapped areas",
    "held_out_unseen": "held out, unmapped areas",
    "cross_validated": "cross-validated points",
    "ablation": "ablation, not fitted",
    "correspondence": "true correspondence",
    "truth_to_surface": "truth to surface",
    "surface_to_truth": "surface to truth",
    "landmarks": "landmarks",
    "fitted": "fitted points",
}


@dataclass(frozen=True, eq=False)
class Result:
    """A result is one estimate as the report shows it: run, name there, its own name, what run.json says."""

    name: str
    key: str
    run: Run

    @property
    def estimate(self) -> Estimate:
        return self.run.estimates[self.key]

    @property
    def scores(self) -> Mapping[str, Any]:
        return self.run.scores[self.key]

    @property
    def validity(self) -> Mapping[str, Any]:
        return self.run.validity[self.key]

    @property
    def drawn_points(self) -> Points:
        """The points that pictures show: all but landmarks."""
        points = self.run.points
        return points.select(points.type != "landmark")

    @property
    def point_distances(self) -> Array:
        """Distances (n,) of the drawn points."""
        return np.asarray(self.drawn_points.columns[f"distance_{self.key}_{self.run.unit}"])

    @property
    def fitted(self) -> tuple[str, ...]:
        """Types of the points that the estimate was fitted to.

        Ablation points are a set of their own where it was not shown them.
        """
        return ("eam",) if "ablation" in self.scores else ("eam", "ablation")

    def measured(self, group: str, like: Result | None = None) -> tuple[Array, Array]:
        """Return positions (n, d) and distances (n,) of a set of points; empty where the run lacks the set.

        The fitted points are its own, or those of another result, `like`, with which it is compared.
        """
        points = self._points_of(group, (like or self).fitted)
        prefix = "left_out" if group == "cross_validated" else "distance"
        values = points.columns.get(f"{prefix}_{self.key}_{self.run.unit}")
        if values is None or group not in self.scores:
            return points.xyz[:0], np.zeros(0)
        known = np.isfinite(values)
        return points.xyz[known], np.asarray(values[known])

    def _points_of(self, group: str, fitted: tuple[str, ...]) -> Points:
        """Return the measured or held-out points that a set is made of."""
        held_out = self.run.held_out
        if not group.startswith("held_out") or held_out is None:
            return self.run.points.of(*{"fitted": fitted, "cross_validated": ("eam",)}.get(group, (group,)))
        unseen = held_out.columns.get("unseen", np.zeros(len(held_out))) > 0
        every = np.ones(len(held_out), dtype=bool)
        return held_out.select({"held_out_seen": ~unseen, "held_out_unseen": unseen}.get(group, every))


@dataclass(frozen=True, eq=False)
class Subject:
    """A subject has results in order, the names to show, their case, and whether to map activation."""

    results: Mapping[str, Result]
    shown: Sequence[str]
    runs: Sequence[Run]
    folders: Sequence[Path]
    activation: bool = False

    @property
    def case(self) -> Case:
        return self.last.run.case

    @property
    def unit(self) -> str:
        return self.last.run.unit

    @property
    def last(self) -> Result:
        """The estimate that the report is about: the last one shown."""
        return self.results[self.shown[-1]]

    @property
    def first(self) -> Result | None:
        """The baseline: the best pose that a stage found (and several runs show), else the first shown."""
        others = [self.results[name] for name in self.shown[:-1]]
        among = self.results.values() if len(self.runs) == 1 else others
        found = [one for one in among if one.key in found_poses(one.run) and one is not self.last]
        return min(reversed(found), key=self._headline_mean, default=next(iter(others), None))

    def _headline_mean(self, result: Result) -> float:
        mean = result.scores.get(self.headline or "", {}).get(f"mean_{self.unit}", np.inf)
        return round(float(mean), 2)  # as it is written: digits that nobody sees pick no baseline

    @cached_property
    def surfaces(self) -> dict[str, Surface]:
        """The shown estimates' surfaces as they are drawn."""
        shown = {name: self.results[name] for name in self.shown}
        return {
            name: displayed(one.estimate.surface, self.case, *one.measured("cross_validated"))
            for name, one in shown.items()
        }

    @property
    def finals(self) -> list[Result]:
        """The last estimate of each run."""
        return [
            next(one for one in self.results.values() if one.run is run and one.key == run.final)
            for run in self.runs
        ]

    @property
    def date(self) -> str:
        """Day (UTC) on which the last run ended, by the time of its run.json; today where none is written."""
        return day_of_end(self.folders[-1]) if self.folders else datetime.now(UTC).date().isoformat()

    def style(self, name: str) -> int:
        """Return the number of the colour and dash of an estimate in all of the report, by its method. Those
        shown come first, so that theirs differ.
        """
        names = list(dict.fromkeys([*self.shown, *self.results]))
        return places([self.results[one].key for one in names])[names.index(name)]

    @cached_property
    def headline(self) -> str | None:
        """The set of points whose distances speak first: one that was not fitted where there is one."""
        return next((group for group in HEADLINE if len(self.last.measured(group)[1])), None)

    @cached_property
    def unmapped(self) -> float | None:
        """Share of the last surface's area that is farther than REACH from every fitted point."""
        return unmapped(self.last.estimate.surface, self.unit)


def unmapped(surface: Surface, unit: str) -> float | None:
    """Return the share of the area far from every fitted point or cut by the image; None if unknown."""
    gap = surface.fields.get(f"distance_to_nearest_point_{unit}")
    if gap is None or surface.dimension == 2:
        return None
    far = (gap > REACH) | on_cut(surface)
    return float(surface.vertex_areas @ far / surface.area)


def read_subject(
    folders: Sequence[Path], compare: Sequence[str] = (), runs: Sequence[Run] | None = None
) -> Subject:
    """Read the subject of a report from finished run folders of one case, whose `runs` may be at hand. Raises
    InputError where they are of several, or none is given.
    """
    from ..runs.folder import read_run

    if not folders:
        raise InputError("no run folder is given: name at least one")
    runs = runs or [read_run(folder) for folder in folders]
    _check_same_case(folders, runs)
    prefixes = [""] if len(runs) == 1 else [f"{name} · " for name in distinct_names(folders)]
    results = [
        Result(prefix + key, key, run)
        for run, prefix in zip(runs, prefixes, strict=True)
        for key in run.estimates
    ]
    named = {result.name: result for result in results}
    subject = Subject(named, _choose_shown(named, runs, prefixes, compare), runs, folders)
    first = None if compare or len(runs) > 1 else subject.first
    return replace(subject, shown=[first.name, subject.last.name]) if first else subject


def _choose_shown(
    named: Mapping[str, Result], runs: Sequence[Run], prefixes: Sequence[str], compare: Sequence[str]
) -> list[str]:
    """Return the named estimates, in every run; without names the last two of one run, or each run's last."""
    for name in compare:
        if name not in named and all(name != result.key for result in named.values()):
            raise InputError(f"report: no estimate '{name}'{did_you_mean(name, list(named))}")
    if compare:
        pairs = [(word, result) for word in compare for result in named.values()]
        return _check_count([result.name for word, result in pairs if word in (result.name, result.key)])
    if len(runs) > 1:
        return [prefix + run.final for run, prefix in zip(runs, prefixes, strict=True)][-MOST_SHOWN:]
    names = list(runs[0].estimates)
    return names[: names.index(runs[0].final) + 1][-2:]


def _check_count(names: list[str]) -> list[str]:
    if len(names) > MOST_SHOWN:
        raise InputError(
            f"report: {len(names)} estimates to show side by side ({', '.join(names)}): at most {MOST_SHOWN}"
        )
    return list(dict.fromkeys(names))


def _check_same_case(folders: Sequence[Path], runs: Sequence[Run]) -> None:
    for folder, run in zip(folders, runs, strict=True):
        if case_key(run.case) != case_key(runs[0].case):
            raise InputError(
                f"{folder}: is of case '{run.case.name}', {folders[0]} of '{runs[0].case.name}', with "
                "another prior or other points; a report shows one case; for several there is o3dls compare"
            )


def case_key(case: Case) -> str:
    """Return what tells cases apart: a hash of prior and points, whatever they are called."""
    return sha256(case.prior.vertices.tobytes() + case.points.xyz.tobytes()).hexdigest()


def distinct_names(folders: Sequence[Path]) -> list[str]:
    """Return folder names, with as much of the path before them as tells them apart."""
    parts = [folder.resolve().parts for folder in folders]
    for depth in range(1, max(map(len, parts)) + 1):
        names = ["/".join(part[-depth:]) for part in parts]
        if len(set(names)) == len(names):
            return names
    raise InputError(f"{folders[0]}: the same run is named twice")
