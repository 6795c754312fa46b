"""Which columns of a table are the coordinates of points, where the headings do not say so."""

from __future__ import annotations

from collections.abc import Sequence

from ...columns import meaning_of
from ...errors import Answer
from ..text import number

MOST_ANSWERS = 6


def axis_answers(axes: Sequence[str], header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[Answer]:
    """Return which neighbouring columns of numbers may be the axes, for a table whose headings do not say."""
    columns = [[row[k] for row in rows] for k in range(len(header))]
    free = [meaning_of(name) is None and not set(",=") & set(name) for name in header]
    measured = [one and _is_measured(cells) for one, cells in zip(free, columns, strict=True)]
    starts = [k for k in range(len(header) - len(axes) + 1) if all(measured[k : k + len(axes)])]
    found = [header[k : k + len(axes)] for k in starts[:MOST_ANSWERS]]
    return [
        Answer(
            f"{', '.join(axes)} are {', '.join(names)}",
            {"columns": ",".join(map("{}={}".format, axes, names))},
        )
        for names in found
    ]


def _is_measured(cells: Sequence[str]) -> bool:
    """Return whether cells are numbers, and not those of the rows."""
    try:
        values = [number(cell) for cell in cells]
    except ValueError:
        return False
    counts = [value - k for k, value in enumerate(values, 1)]
    return any(count not in (0.0, -1.0) for count in counts)
