"""Scores as tables: the rows of scores.csv and the short table for the screen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

Scores = Mapping[str, Mapping[str, Any]]  # by set

SCREEN = {  # heading: set, key without its unit
    "fitted": ("fitted", "mean"),
    "left out": ("cross_validated", "mean"),
    "ablation": ("ablation", "mean"),
    "held out": ("held_out", "mean"),
    "unseen": ("held_out_unseen", "mean"),
    "landmarks": ("landmarks", "mean"),
    "to truth": ("truth", "assd"),
    "hd95": ("truth", "hd95"),
    "dice": ("truth", "dice"),
}


@dataclass(frozen=True)
class ScoreLine:
    """This is one line of a table on the screen: an estimate's scores by set, in a unit, and whether it is
    valid.
    """

    label: str
    scores: Scores
    unit: str
    valid: bool


def score_rows(scores: Mapping[str, Scores]) -> list[dict[str, Any]]:
    """Return one row per estimate and set, with the columns of every set."""
    rows = [
        {"estimate": name, "set": group, **record}
        for name, sets in scores.items()
        for group, record in sets.items()
    ]
    columns = dict.fromkeys(key for row in rows for key in row)
    return [{key: row.get(key) for key in columns} for row in rows]


def score_table(lines: Sequence[ScoreLine]) -> str:
    """Return mean distances side by side, in aligned columns; sets that no line has are left out."""
    rows = _score_cells(lines)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    aligned = [[first.ljust(widths[0]), *map(str.rjust, rest, widths[1:])] for first, *rest in rows]
    return "\n".join("  ".join(row) for row in aligned)


def score_html(lines: Sequence[ScoreLine]) -> str:
    """Return the same as a table of HTML."""
    head, *rows = _score_cells(lines)
    above = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    below = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{above}</tr></thead><tbody>{below}</tbody></table>"


def _score_cells(lines: Sequence[ScoreLine]) -> list[list[str]]:
    """Return the cells of the table on the screen, headings first."""
    shown = [heading for heading, (group, _) in SCREEN.items() if any(group in line.scores for line in lines)]
    rows = [["", *shown, "valid"]]
    return rows + [[line.label, *_format_cells(line, shown), "yes" if line.valid else "no"] for line in lines]


def _format_cells(line: ScoreLine, shown: list[str]) -> Iterator[str]:
    for heading in shown:
        group, key = SCREEN[heading]
        record = line.scores.get(group, {})
        value = record.get(key, record.get(f"{key}_{line.unit}"))
        yield "-" if value is None else f"{value:.3f}" if key == "dice" else f"{value:.2f}"
