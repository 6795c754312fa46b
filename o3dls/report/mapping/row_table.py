"""Rows of numbers with their intervals, as text and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from ...arrays import Array
from ...evaluation.measures.intervals import LEVEL

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


def interval_of(drawn: Array) -> tuple[float, float]:
    """Return what 95 % of numbers (k,) lie in."""
    low, high = np.quantile(drawn, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
    return float(low), float(high)


def _show(value: str | float) -> str:
    if isinstance(value, str):
        return value
    return "-" if np.isnan(value) else f"{value:.1f}" if abs(value) >= 10.0 else f"{value:.2f}"
