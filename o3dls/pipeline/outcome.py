"""What became of the cases of a cohort, as their folders say it, and the table of it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import InputError, escaped
from ..io.atomic import write_file
from ..io.documents import read_json
from ..io.table import read_table
from ..runs.estimate_files import write_rows
from ..runs.folder import read_record
from ..runs.tables import score_rows

COHORT, PAGE = "cohort.csv", "cohort.html"  # the page is the report's: see report/writer.py
FAILED = ".failed.json"  # ends the name of the file that says why a case has no run
PARTIAL = re.compile(r"\..*\.partial-")


@dataclass(frozen=True)
class Outcome:
    """An outcome says what became of one case, and what it was warned of.

    Rows of its scores, or the sentence that says why there are none. skipped: its run was there already.
    """

    case: str
    rows: list[dict[str, Any]]
    faults: list[str]
    error: str | None = None
    warnings: list[str] = field(default_factory=list)
    skipped: bool = False

    def __str__(self) -> str:
        said = self.error or "; ".join(self.faults) or "done"
        return f"{self.case}: {said}{' (its run is there already, skipped)' if self.skipped else ''}"


def outcome_of(folder: Path) -> Outcome:
    """Return the outcome of a case by its finished run. Raises InputError where the folder holds none."""
    found = read_record(folder)
    warned = dict.fromkeys(one for estimate in found.estimates.values() for one in estimate.warnings)
    return Outcome(
        folder.name,
        score_rows({name: one.scores for name, one in found.estimates.items()}),
        found.faults,
        warnings=[one.sentence for one in warned],
    )


def note_failure(outcome: Outcome, out: Path) -> None:
    """Leave beside where the run would be why there is none, for tables that are made later."""
    said = {"case": outcome.case, "error": outcome.error, "warnings": outcome.warnings}
    write_file(out / f"{outcome.case}{FAILED}", json.dumps(said, indent=1) + "\n")


def forget_failure(run: Path) -> None:
    """Remove what an earlier failure left beside the place of a run."""
    run.with_name(run.name + FAILED).unlink(missing_ok=True)


def gathered(runs: Path) -> list[Outcome]:
    """Return the outcomes of all cases whose runs, or the reasons that there are none, stand in a folder.

    A run that cannot be read is an outcome too. Raises InputError where there is neither.
    """
    if not runs.is_dir():
        raise InputError(f"{runs}: is not a folder; name the one that `o3dls batch` wrote its runs into")
    failed = {path.name.removesuffix(FAILED): path for path in runs.glob(f"*{FAILED}") if path.is_file()}
    made = [
        folder
        for folder in runs.iterdir()
        if (folder / "run.json").is_file() and folder.name not in failed and not PARTIAL.match(folder.name)
    ]
    if not made and not failed:
        raise InputError(f"{runs}: holds no runs; name the folder that `o3dls batch` wrote its runs into")
    found = [_read_failure(name, path) for name, path in failed.items()] + [
        _read_outcome(folder) for folder in made
    ]
    return sorted(found, key=lambda outcome: outcome.case)


def _read_outcome(folder: Path) -> Outcome:
    try:
        return outcome_of(folder)
    except InputError as error:
        return Outcome(folder.name, [], [], str(error))


def _read_failure(name: str, path: Path) -> Outcome:
    said = read_json(path)
    if not isinstance(said, dict) or not isinstance(said.get("error"), str):
        raise InputError(f"{path}: does not say why the case failed; run it again")
    return Outcome(name, [], [], said["error"], [str(warning) for warning in said.get("warnings", [])])


def write_table(out: Path, outcomes: Iterable[Outcome]) -> None:
    """Write cohort.csv, by the names of the cases: it is the same however and in whatever order it was
    computed.
    """
    ordered = sorted(outcomes, key=lambda outcome: outcome.case)
    write_rows(out / COHORT, [row for outcome in ordered for row in cohort_rows(outcome)])


def cohort_rows(outcome: Outcome) -> list[dict[str, Any]]:
    """Return rows of the cohort's table.

    Case, error, faults of its final surface, warnings, then the columns of scores.csv.
    """
    said = {"faults": "; ".join(outcome.faults), "warnings": "; ".join(outcome.warnings)}
    head = {"case": outcome.case, "error": outcome.error or "", **said}
    return [head | row for row in outcome.rows] or [head]


def check_table(out: Path, cases: Iterable[str] | None) -> None:
    """Raise InputError where the table or the page cannot be written into a folder, or is there and speaks of
    other cases than these. cases: None where any may be replaced.
    """
    for path in (out / COHORT, out / PAGE):
        if path.is_dir():
            raise InputError(f"{path}: is a folder, and the batch writes a file there; name another folder")
    if cases is None:
        return
    advice = "name another folder or use --force"
    known = {_shown_name(case) for case in cases}
    if (out / COHORT).exists():
        try:
            there = read_table(out / COHORT, ("case", "error")).columns["case"]
        except InputError:
            raise InputError(f"{out / COHORT}: exists already, and no batch wrote it; {advice}") from None
        if other := [name for name in there if name not in known]:
            raise InputError(f"{out / COHORT}: exists already, with the other case '{other[0]}'; {advice}")
    elif (out / PAGE).exists():
        raise InputError(f"{out / PAGE}: exists already, without the table of a batch; {advice}")


def _shown_name(name: str) -> str:
    """Return a name as the table has it."""
    return escaped(name.encode("utf-8", "replace").decode("utf-8")).strip()
