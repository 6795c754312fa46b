"""A finished run: every estimate with its scores and its validity, how it all was made, and its folder."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any, ClassVar, Protocol

from ..arrays import Ints
from ..case import Case, Points
from ..errors import InputError, escaped
from ..estimate import Estimate
from ..evaluation.left_out import block_of
from ..evaluation.validity import faults
from ..io.atomic import staged_folder, write_file
from ..io.case_writer import write_case_files
from ..io.manifest import write_manifest
from ..io.points import write_points
from .estimate_files import write_estimate, write_rows
from .record import Provenance, RunRecord, checked, plain
from .tables import ScoreLine, score_html, score_rows, score_table

log = logging.getLogger("o3dls")
Record = dict[str, Any]


class Addition(Protocol):
    """An addition is a callable that adds files to the folder of a run, such as a `Writer` of a pipeline."""

    name: ClassVar[str]

    def __call__(self, run: Run, folder: Path) -> None: ...


@dataclass(frozen=True, eq=False)
class Run:
    """A run has estimates by name (`start` first), their scores by set and their validity.

    points: the case's points with a column `distance_<estimate>_mm` for each estimate, and
    `left_out_<estimate>_mm` from the cross-validation; held_out: the held-out points likewise. fitted: by
    estimate, the types of the points that it was shown (empty where the run was read from its folder).
    ends_with: the final estimate, where it is not the last. out and additions: the folder and the further
    files that `write` makes where it is told no others.
    """

    case: Case
    estimates: Mapping[str, Estimate]
    fitted: Mapping[str, tuple[str, ...]]
    scores: Mapping[str, Mapping[str, Record]]
    validity: Mapping[str, Record]
    provenance: Provenance
    points: Points
    held_out: Points | None = None
    out: Path | None = None
    additions: Sequence[Addition] = ()
    ends_with: str | None = None

    @property
    def final(self) -> str:
        """Name of the estimate that the run ends with: the last, unless left-out points rejected it."""
        return self.ends_with or list(self.estimates)[-1]

    @property
    def unit(self) -> str:
        """Unit of lengths in the names of scores and columns."""
        return self.case.units

    @cached_property
    def left_out_together(self) -> Ints:
        """The block (n,) of each `eam` point that was left out with its neighbours."""
        return block_of(self.case.points.of("eam").xyz, max(1, self.provenance.pipeline["folds"]))

    @property
    def faults(self) -> list[str]:
        """Why the final surface is not valid, one sentence each; empty where it is."""
        return self.faults_of(self.final)

    def faults_of(self, name: str) -> list[str]:
        """Return why the surface of an estimate is not valid.

        `start` is the prior in another pose, so its faults are the prior's.
        """
        reshaped = bool(self.estimates[name].facts.get("changes"))
        return faults(self.validity[name], self.validity["start"], reshaped=reshaped)

    @property
    def score_lines(self) -> list[ScoreLine]:
        """A line of the table on the screen for each estimate."""
        return [
            ScoreLine(name, self.scores[name], self.unit, not self.faults_of(name)) for name in self.estimates
        ]

    def __repr__(self) -> str:
        return f"Run({self.case.name!r}: {', '.join(self.estimates)})"

    def _repr_html_(self) -> str:
        """The table of the screen, as a notebook shows it."""
        return f"<p>{escape(str(self).partition(chr(10))[0])}</p>{score_html(self.score_lines)}"

    def __str__(self) -> str:
        return f"{escaped(self.case.name)}: mean distances in {self.unit}\n{score_table(self.score_lines)}"

    def write(self, folder: str | Path | None = None, *, force: bool = False) -> Path:
        """Write the run folder, whole or not at all.

        run.json, scores.csv, points.csv, the case, the estimates, what the writers of the pipeline make, and
        the manifest of it all.
        Raises InputError where it exists.
        """
        out = folder or self.out
        if not out:
            raise InputError(
                'the run has no folder to go to: give one to write(), or say out = "folder" in the pipeline'
            )
        self.written(out, force=force)
        return Path(out)

    def written(self, out: str | Path, *, force: bool = False) -> Run:
        """Write the run folder as `write` does, and return the run whose surfaces have the fields of their
        files. Raises InputError where the folder exists.
        """
        with staged_folder(out, force) as staged:
            return self._write_into(staged)

    def _write_into(self, folder: Path) -> Run:
        write_case_files(folder / "case", self.case)
        write_points(folder / "points.csv", self.points)
        if self.held_out:
            write_points(folder / "held_out.csv", self.held_out)
        write_rows(folder / "scores.csv", score_rows(self.scores))
        written = {
            name: write_estimate(folder / "estimates" / name, self.case, one, self.fitted.get(name, ()))
            for name, one in self.estimates.items()
        }
        run = replace(self, estimates=written)
        write_file(folder / "run.json", record(self).text())
        for addition in self.additions:
            log.info("writing %s", addition.name)
            addition(run, folder)
        write_manifest(folder)
        return run


def record(run: Run) -> RunRecord:
    """Return the content of run.json; equal inputs give equal records but for `seconds`."""
    found = run.provenance.table() | {
        "final": run.final,
        "valid": not run.faults,
        "faults": run.faults,
        "estimates": {name: _estimate_record(run, name) for name in run.estimates},
    }
    return checked(plain(found), "run.json")


def _estimate_record(run: Run, name: str) -> Record:
    e = run.estimates[name]
    return {
        **{key: getattr(e, key) for key in ("status", "converged", "seconds", "iterations")},
        "T_map_prior": e.T_map_prior,
        "scale": e.scale,
        f"sigma_{run.unit}": e.sigma,
        "warnings": [warning.record() for warning in e.warnings],
        "facts": e.facts,
        "scores": run.scores[name],
        "validity": run.validity[name],
    }
