"""A run as the cohort's page needs it; and estimates of one name that were made in different ways, told
apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from ...arrays import Array
from ...runs.record import Provenance
from ..checks import checks
from ..drawing.pictures import thumbnail
from ..expected import expected_error
from ..grading.check import Grade, doubtful, worst_grade
from ..grading.remarks import remarks, warnings_of
from ..grading.wrong_poses import wrong_poses_of
from ..subject import HEADLINE, SETS, Result, Subject, case_key, distinct_names, read_subject

MOST_SAID = 6  # differing parameters that are named


@dataclass(frozen=True, eq=False)
class Entry:
    """An entry is one run: its folder and name, its case, the distances of the estimates that it compares,
    and what was said of it.

    case_key: equal for runs of one case; group: the set of points it is judged by, None where there is none;
    first, last: what is compared, first is None where there is one estimate alone; measured: positions (n, d)
    and distances (n,) of both; made: the parameters that made each, as `stage.parameter`.
    """

    folder: Path
    name: str
    case: str
    case_key: str
    group: str | None
    unit: str
    first: str | None
    last: str
    measured: Mapping[str, tuple[Array, Array]]
    made: Mapping[str, Mapping[str, str]]
    valid: bool
    seconds: float
    warnings: int
    grade: Grade = "none"  # the worst of its checks
    doubts: tuple[str, ...] = ()  # the checks that ask for a look, in short, the worst first
    wrong_poses: tuple[str, ...] = ()  # what its stages, such as variants of ICP, got wrong: a sentence each
    picture: bytes = b""  # a small one of the result, as a file of WebP
    metrics: Mapping[str, float] = field(default_factory=dict)  # of the result, by their names


def read_entries(folders: Sequence[Path]) -> list[Entry]:
    """Read the runs in these folders, one after the other to save memory. Raises InputError where one is no
    run, or is named twice.
    """
    names = distinct_names(folders) if folders else []
    return [_make_entry(read_subject([folder]), name) for folder, name in zip(folders, names, strict=True)]


def _make_entry(subject: Subject, name: str) -> Entry:
    group, last, first = subject.headline, subject.last, subject.first
    shown = [one for one in (first, last) if one and group and len(one.measured(group, last)[1])]
    provenance = last.run.provenance
    return Entry(
        folder=subject.folders[0],
        name=name,
        case=subject.case.name,
        case_key=case_key(subject.case),
        group=group,
        unit=subject.unit,
        first=first.key if first is not None and first in shown else None,
        last=last.key,
        measured={one.key: one.measured(group, last) for one in shown if group},
        made={one.key: _parameters_up_to(one, provenance, group) for one in shown},
        valid=not last.run.faults_of(last.key),
        seconds=provenance.seconds,
        warnings=len(warnings_of(remarks(subject))),
        grade=worst_grade(found := checks(subject)),
        doubts=tuple(f"{one.name}: {one.short or one.said}" for one in doubtful(found)),
        wrong_poses=tuple(one.describe(subject.unit) for one in wrong_poses_of(subject)),
        picture=thumbnail(subject),
        metrics=_measure_result(subject),
    )


def _measure_result(subject: Subject) -> dict[str, float]:
    """Return the mean distances of a result to the sets that were not fitted, the error that its posterior
    expects, and its distance to the true surface, where they are known.
    """
    scores, unit = subject.last.scores, subject.unit
    found = {
        f"mean distance, {SETS[name]}": scores.get(name, {}).get(f"mean_{unit}")
        for name in HEADLINE
        if name != "fitted"
    }
    expected = expected_error(subject)
    found["expected error"] = expected.all if expected else None
    found["true error"] = scores.get("truth", {}).get(f"assd_{unit}")
    return {name: float(value) for name, value in found.items() if value is not None}


def _parameters_up_to(result: Result, provenance: Provenance, group: str | None) -> dict[str, str]:
    """Return every parameter of the stages up to the one that made an estimate."""
    found = {"folds": str(provenance.pipeline["folds"])} if group == "cross_validated" else {}
    made = {key: str(value) for key, value in provenance.parameters.items()}
    names = stages_of(made)
    upto = names[: names.index(result.key) + 1] if result.key in names else ()  # no stage made `start`
    return found | {key: value for key, value in made.items() if _stage_of_key(key) in upto}


def told_apart(entries: Sequence[Entry]) -> tuple[list[Entry], dict[str, str]]:
    """Return the runs with a number behind the name of each estimate that was made in different ways, such as
    `level_set (2)`; and say for each of these names what differs.

    Parts that only one of two cases allows, such as landmarks, are no difference between runs of the two.
    """
    ways: dict[str, list[list[Entry]]] = {}
    for entry in entries:
        for name in entry.measured:
            known = ways.setdefault(name, [])
            same = next((way for way in known if all(_made_alike(entry, other, name) for other in way)), None)
            if same is None:
                known.append(same := [])
            same.append(entry)
    several = {name: found for name, found in ways.items() if len(found) > 1}
    labels = {
        (id(entry), name): f"{name} ({k})"
        for name, found in several.items()
        for k, way in enumerate(found, 1)
        for entry in way
    }
    notes = {
        f"{name} ({k})": _describe_difference([way[0].made[name] for way in found], k - 1)
        for name, found in several.items()
        for k in range(1, len(found) + 1)
    }
    return [_relabel_entry(entry, labels) for entry in entries], notes


def _made_alike(one: Entry, other: Entry, name: str) -> bool:
    a, b = one.made[name], other.made[name]
    if one.case_key == other.case_key:
        return a == b
    both = {*stages_of(a)} & {*stages_of(b)}
    return all(a.get(key) == b.get(key) for key in {*a, *b} if _stage_of_key(key) in both)


def _describe_difference(made: Sequence[Mapping[str, str]], k: int) -> str:
    """Say what is so in the k-th of several ways and not in all."""
    stages = [stages_of(one) for one in made]
    shared = set(stages[0]).intersection(*stages)
    said = [
        f"{key} = {value}"
        for key, value in made[k].items()
        if _stage_of_key(key) in shared and len({one.get(key) for one in made}) > 1
    ]
    said += [
        f"{'with' if name in stages[k] else 'without'} {name}"
        for name in dict.fromkeys(name for names in stages for name in names)
        if name not in shared
    ]
    more = f" and {len(said) - MOST_SAID} more" if len(said) > MOST_SAID else ""
    return ", ".join(said[:MOST_SAID]) + more


def stages_of(made: Mapping[str, str]) -> list[str]:
    """Return the stages that these parameters belong to, in their order."""
    return list(dict.fromkeys(map(_stage_of_key, made)))


def _stage_of_key(key: str) -> str:
    return key.partition(".")[0]


def _relabel_entry(entry: Entry, labels: Mapping[tuple[int, str], str]) -> Entry:
    def new(name: str) -> str:
        return labels.get((id(entry), name), name)

    return replace(
        entry,
        first=new(entry.first) if entry.first else None,
        last=new(entry.last),
        measured={new(name): found for name, found in entry.measured.items()},
        made={new(name): found for name, found in entry.made.items()},
    )
