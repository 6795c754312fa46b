"""Rows of numbers with their intervals: as text, as JSON, and in a folder with the surface they are of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...arrays import Array
from ...evaluation.measures.intervals import LEVEL
from ...geometry.surface import Surface
from ...io.atomic import staged_folder, write_file
from ...io.surfaces import write_surface
from ...io.table import write_table
from ...runs.folder import check_not_of_a_run

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def lay_out_rows(columns: Sequence[str], rows: Sequence[DataclassInstance]) -> list[str]:
    """Return lines of a table with a head; a number that is not known is a dash."""
    cells = [list(columns), *([_show(getattr(row, name)) for name in columns] for row in rows)]
    width = [max(len(row[k]) for row in cells) for k in range(len(columns))]
    return ["  ".join(cell.ljust(w) for cell, w in zip(row, width, strict=True)).rstrip() for row in cells]


def record_rows(rows: Sequence[DataclassInstance]) -> list[dict[str, Any]]:
    """Return rows as JSON has them, a number that is not known as None."""
    return [
        {name: None if isinstance(x, float) and np.isnan(x) else x for name, x in asdict(row).items()}
        for row in rows
    ]


def write_rows(
    out: Path, name: str, rows: Sequence[DataclassInstance], text: str, surface: Surface, frame: str
) -> None:
    """Write a folder with rows as a table (NAME.csv), a text of JSON (NAME.json) and a surface in mm with its
    fields (surface.ply, surface.vtp). Raises InputError where the folder exists, or is of a run.
    """
    check_not_of_a_run(out)
    with staged_folder(out) as folder:
        columns = [one.name for one in fields(rows[0])]
        write_table(
            folder / f"{name}.csv",
            {column: np.array([getattr(row, column) for row in rows]) for column in columns},
        )
        write_file(folder / f"{name}.json", text + "\n")
        for file in ("surface.ply", "surface.vtp"):
            write_surface(folder / file, surface, space=frame, units="mm")


def interval_of(drawn: Array) -> tuple[float, float]:
    """Return what 95 % of numbers (k,) lie in."""
    low, high = np.quantile(drawn, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
    return float(low), float(high)


def _show(value: str | int | float) -> str:
    if isinstance(value, (str, int)):
        return str(value)
    return "-" if np.isnan(value) else f"{value:.1f}" if abs(value) >= 10.0 else f"{value:.2f}"
