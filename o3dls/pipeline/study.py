"""What a batch shall run: case folders, patterns of their names, and tables that name a pipeline for each."""

from __future__ import annotations

import glob
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ..errors import InputError, O3dlsError, did_you_mean
from ..io.table import Table, read_table
from .file import default_pipeline, read_pipeline
from .pipeline import Pipeline

TABLES = (".csv", ".tsv")
COLUMNS = ("case", "pipeline", "name")
SET = "set."  # before the name of a parameter in the head of a table


@dataclass(frozen=True, eq=False)
class Planned:
    """A planned case shall be run: it has the name of its run's folder, its own folder and the pipeline.

    trim: leave out what the case does not allow, as for the default pipeline.
    """

    name: str
    folder: Path
    pipeline: Pipeline
    trim: bool = False


def planned(folders: Iterable[Path], pipeline: Pipeline, *, trim: bool = False) -> list[Planned]:
    """Plan one pipeline for these case folders, whose names the runs have."""
    return [Planned(folder.resolve().name, folder, pipeline, trim) for folder in folders]


def read_study(
    cases: Sequence[Path], pipeline: Path | None = None, settings: Sequence[str] = ()
) -> list[Planned]:
    """Return what is to be run: each case folder, each match of a pattern such as `cases/*`, and each row of
    a table.

    A table has the columns `case` and, where wanted, `pipeline`, `name` and `set.STAGE.PARAM`; its paths are
    relative to it. The run of a row has the name of the case, with `-PIPELINE` behind it where the row names
    one. pipeline, settings: of all that name no other. Raises InputError or PipelineError.
    """
    plans = _Plans(pipeline, tuple(settings))
    found: list[Planned] = []
    for path in cases:
        if path.suffix.lower() in TABLES and not path.is_dir():
            found += _plan_rows(read_table(path, ("case",)), plans)
        elif not path.exists() and glob.has_magic(str(path)):
            found += planned(_match_folders(path), plans.own, trim=plans.trims)
        else:
            found += planned([path], plans.own, trim=plans.trims)
    return found


def shard(study: Sequence[Planned], part: int, parts: int) -> list[Planned]:
    """Return the part-th (from 1) of so many parts of a study, by the names of the runs, whatever their
    order.
    """
    return sorted(study, key=lambda one: one.name)[part - 1 :: parts]


class _Plans:
    """Pipelines are kept here by file and settings, so that each is read once."""

    def __init__(self, usual: Path | None, settings: tuple[str, ...]) -> None:
        self.usual, self.settings = usual, settings
        self.trims = usual is None
        self._read = cache(self._read_pipeline)

    @property
    def own(self) -> Pipeline:
        """The pipeline of cases that name no other."""
        return self._read(self.usual, ())

    def of(self, path: Path | None, settings: tuple[str, ...]) -> Pipeline:
        """Return the pipeline of a row of a table."""
        return self._read(path or self.usual, settings)

    def _read_pipeline(self, path: Path | None, settings: tuple[str, ...]) -> Pipeline:
        every = [*self.settings, *settings]
        return read_pipeline(path, every) if path else default_pipeline(every)


def _match_folders(pattern: Path) -> list[Path]:
    folders = [Path(name) for name in sorted(glob.glob(str(pattern), recursive=True))]
    if found := [folder for folder in folders if folder.is_dir()]:
        return found
    raise InputError(f"{pattern}: no folder has such a name; name case folders, or a table of them (.csv)")


def _plan_rows(table: Table, plans: _Plans) -> list[Planned]:
    for column in table.columns:
        if column not in COLUMNS and not column.startswith(SET):
            hint = did_you_mean(column, [*COLUMNS, f"{SET}STAGE.PARAM"])
            raise InputError(f"{table.path}: column '{column}': no such column{hint}")
    return [_plan_row(table, row, plans) for row in range(len(table))]


def _plan_row(table: Table, row: int, plans: _Plans) -> Planned:
    cells = {name: column[row] for name, column in table.columns.items() if column[row]}
    if "case" not in cells:
        raise InputError(f"{table.where(row, 'case')}: is empty; name the case folder")
    folder = table.path.parent / cells["case"]
    own = table.path.parent / cells["pipeline"] if "pipeline" in cells else None
    settings = tuple(f"{key.removeprefix(SET)}={v}" for key, v in cells.items() if key.startswith(SET))
    try:
        pipeline = plans.of(own, settings)
    except O3dlsError as error:
        raise InputError(f"{table.path}: line {table.lines[row]}: {error}") from None
    usual = folder.resolve().name + (f"-{own.stem}" if own else "")
    name = cells.get("name", usual)
    if Path(name).name != name:
        raise InputError(f"{table.where(row, 'name')}: '{name}': must be the name of a folder, not a path")
    return Planned(name, folder, pipeline, trim=plans.trims and own is None)
