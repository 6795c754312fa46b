"""Draw the error over the number of points from the tables of docs/accuracy_templates.md.

python tools/accuracy_picture.py        # writes docs/error_over_points.png
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE, PICTURE = DOCS / "accuracy_templates.md", DOCS / "error_over_points.png"
TITLES = (
    "even points, 1 mm of noise",
    "even points, 2 mm of noise",
    "clustered points, 1 mm of noise,\n5 % outliers; mapped wall",
)
LOOKS = {  # method: its name in the legend, colour, marker
    "`icp`": ("icp (similarity)", "#6b7280", "o"),
    "`nricp_sumner`": ("nricp_sumner", "#7c5a46", "v"),
    "thin-plate warp": ("thin-plate warp", "#c2410c", "s"),
    "pycpd": ("pycpd", "#8b3fb0", "D"),
    "T alone": ("T alone", "#c98a00", "P"),
    "screened Poisson": ("screened Poisson", "#15803d", "^"),
    "T and φ": ("T and φ (o3dls)", "#1d4ed8", "o"),
}
MILLIMETRES = (0.2, 0.3, 0.5, 1, 2, 3, 5)  # ticks: a logarithmic axis as numbers that are read at once

Lines = dict[str, list[tuple[int, float, float]]]  # by method: points, mean and standard error in mm


def numbers(page: str) -> list[Lines]:
    """The lines of the first tables of the page, of which each has a panel: mean and standard error for each
    method.
    """
    tables = re.findall(r"^\| points \| `icp` \|.*\n\|[-|]+\n(?:\|.*\n)+", page, re.MULTILINE)
    return [_lines(table) for table in tables[: len(TITLES)]]


def _lines(table: str) -> Lines:
    head, _, *rows = ([cell.strip() for cell in row.strip("|").split("|")] for row in table.splitlines())
    found: Lines = {name: [] for name in head if name in LOOKS}
    for points, *cells in rows:
        for name, cell in zip(head[1:], cells, strict=True):
            if name in found:
                mean, error = cell.strip("*").split(" ± ")
                found[name].append((int(points.replace(" ", "")), float(mean), float(error.strip("*"))))
    return found


def drawn(tables: list[Lines]) -> Figure:
    """A panel for each table, and the legend in place of a fourth; letters are legible 700 pixels wide."""
    plt.rcParams.update({"font.size": 9, "axes.titlesize": 9.5})
    figure, axes = plt.subplots(2, 2, figsize=(7.4, 6.4), sharex=True, sharey=True, layout="constrained")
    panels = axes.ravel()
    for axis, title, lines in zip(panels[:3], TITLES, tables, strict=True):
        _draw_panel(axis, title, lines)
    for axis in axes[:, 0]:
        axis.set_ylabel("mean distance from the true wall, mm")
    for axis in panels[:3]:
        axis.tick_params(labelbottom=True)
        axis.set_xlabel("points")
    panels[3].set_axis_off()
    handles, names = panels[0].get_legend_handles_labels()
    panels[3].legend(
        handles,
        names,
        loc="center",
        frameon=False,
        title="mean ± standard error of 20 pairs;\nlower is nearer",
    )
    return figure


def _draw_panel(axis: Any, title: str, lines: Lines) -> None:
    for name, (words, colour, marker) in LOOKS.items():
        points, mean, error = zip(*lines[name], strict=True)
        ours = name == "T and φ"
        axis.errorbar(
            points,
            mean,
            error,
            label=words,
            color=colour,
            marker=marker,
            lw=2.6 if ours else 1.1,
            ms=5 if ours else 4,
            capsize=2,
            zorder=3 if ours else 2,
        )
    counts = [n for n, *_ in lines["`icp`"]]
    axis.set(xscale="log", yscale="log", ylim=(0.17, 5.0))
    axis.set_title(title)
    axis.set_xticks(counts, [f"{n:,}".replace(",", " ") for n in counts])
    axis.set_yticks(MILLIMETRES)
    axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    for side in (axis.xaxis, axis.yaxis):
        side.set_minor_locator(NullLocator())
    axis.grid(alpha=0.3)


def told(tables: list[Lines]) -> str:
    """What the picture shows, as it is kept in its file: a test compares it with the page."""
    return json.dumps(tables, ensure_ascii=True)


if __name__ == "__main__":
    tables = numbers(PAGE.read_text(encoding="utf-8"))
    drawn(tables).savefig(PICTURE, dpi=170, metadata={"Description": told(tables)})
