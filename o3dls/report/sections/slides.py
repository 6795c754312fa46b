"""Pictures for slides: a set of PNG files and one page of PDF with the verdict, the surfaces and the
numbers.
"""

from __future__ import annotations

import io
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...io.atomic import write_file
from ..checks import checks
from ..drawing.caption import caption, made
from ..drawing.fields import colours_of, point_field
from ..drawing.figures import (
    INK,
    WHOLE,
    draw_bar,
    draw_caption,
    draw_pictures,
    drawable,
    pictures_png,
    plain_figure,
    png,
    shrunk,
    side_by_side,
)
from ..grading.check import WORDS, doubtful, worst_grade
from ..grading.remarks import remarks
from ..mapping.views import orientation
from ..palette import GREY, LIGHT
from ..subject import SETS, Subject
from ..verdict import verdict
from .outlines import named_outlines
from .scores import SEEN, mean_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NOTICE = "Research use only. Not for clinical use."
DASHES: tuple[Any, ...] = ("-", (0, (7, 3)), (0, (2, 3)), (0, (9, 3, 2, 3)), (0, (4, 2)), (0, (1, 4)))
MOST_COLUMNS, MOST_ROWS, HEAD_LINES, LETTERS = 7, 7, 3, 12
VERDICT_LINES, TEXT_LINES = 4, 6  # the verdict has at most so many lines, and verdict and remarks together


def write_slides(subject: Subject, folder: Path, pdf: Path) -> None:
    """Write figures/*.png into a folder beside the one-page PDF, and that."""
    summary, page = _draw_summary(subject)
    pictures = {"summary.png": summary, "distances.png": _distances_png(subject), **_surface_pngs(subject)}
    for name, data in pictures.items():
        write_file(folder / name, data, within=pdf.parent)
    write_file(pdf, page, within=pdf.parent)


def _surface_pngs(subject: Subject) -> dict[str, bytes]:
    """Draw the estimates side by side from the front and from behind; in 2D as outlines."""
    if subject.case.dimension == 2:
        with side_by_side(subject) as figure:
            _draw_surfaces(figure, subject, WHOLE)
            draw_caption(figure, caption(subject))
            return {"outlines.png": png(figure)}
    views = ("ap", "pa") if orientation(subject).patient else ("side_1", "side_2")
    pictures = (pictures_png(subject), pictures_png(subject, behind=True))
    return {f"surfaces_{view}.png": data for view, data in zip(views, pictures, strict=True)}


def _draw_surfaces(figure: Figure, subject: Subject, box: tuple[float, float, float, float]) -> None:
    if subject.case.dimension == 3:
        draw_pictures(figure, subject, box)
        return
    left, bottom, width, height = box
    each = width / len(subject.shown)
    first: Axes | None = None
    for k, name in enumerate(subject.shown):
        at = (left + k * each, bottom + 0.25 * height, each * 0.96, height * 0.66)
        axes = figure.add_axes(at, sharex=first, sharey=first)  # one frame, so that pictures compare
        first = first or axes
        _draw_outlines(axes, subject, name)
        shrunk(axes.set_title(drawable(name), fontsize=11, parse_math=False), axes.bbox.width)
    draw_bar(
        figure,
        point_field(subject),
        (left + 0.54 * width, bottom + 0.11 * height, 0.42 * width, 0.03 * height),
        [subject.results[name].point_distances for name in subject.shown],
    )


def _draw_outlines(axes: Axes, subject: Subject, name: str) -> None:
    """Draw one estimate in 2D: the outlines with their names, the points in the colours of their distance."""
    for label, _, surface in named_outlines(subject, name):
        colour = {"truth": INK, "prior": LIGHT[GREY]}.get(label, LIGHT[subject.style(name) % len(LIGHT)])
        x, y = surface.vertices[surface.faces].T
        line, *_ = axes.plot(x, y, color=colour, lw=1.4)
        line.set_label(drawable(label))
    points = subject.results[name].run.points.of("eam")
    gaps = points.columns[f"distance_{subject.results[name].key}_{subject.unit}"]
    x, y = points.xyz.T
    colours = colours_of(gaps, point_field(subject))
    axes.scatter(x, y, s=16, c=colours, edgecolors=INK, linewidths=0.4, zorder=3)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3)


def _draw_summary(subject: Subject) -> tuple[bytes, bytes]:
    """Draw one page, A4 across, as PNG and as PDF: verdict, remarks, surfaces, table and curve."""
    buffer = io.BytesIO()
    with plain_figure(11.69, 8.27) as figure:
        title = figure.text(
            0.04,
            0.955,
            drawable(subject.case.name, 80),
            fontsize=17,
            weight="bold",
            va="top",
            parse_math=False,
        )
        shrunk(title, 0.92 * figure.bbox.width)
        said = _wrap_text(f"{graded(subject)} {verdict(subject)}", 125, VERDICT_LINES)
        figure.text(0.04, 0.905, "\n".join(said), fontsize=11, va="top", linespacing=1.35, parse_math=False)
        under = 0.895 - 0.025 * len(said)
        doubts = _write_remarks(subject, TEXT_LINES - len(said))
        figure.text(
            0.04, under, doubts, fontsize=8.5, va="top", color="#7a5200", linespacing=1.3, parse_math=False
        )
        _draw_surfaces(figure, subject, (0.03, 0.3, 0.94, 0.46))
        _draw_table(figure, subject, (0.04, 0.05, 0.58, 0.22))
        _draw_curve(figure.add_axes((0.68, 0.1, 0.28, 0.17)), subject)
        draw_caption(figure, f"{caption(subject)} · {NOTICE}")
        figure.savefig(
            buffer,
            format="pdf",
            dpi=200,
            metadata={"CreationDate": None, "Creator": "o3dls", "Producer": "o3dls"},
        )
        return png(figure, 140), buffer.getvalue()


def graded(subject: Subject) -> str:
    """Return the worst grade of the checks as a word, and which checks have it."""
    found = checks(subject)
    said = "; ".join(f"{one.name}: {one.short or one.said}" for one in doubtful(found))
    return f"{WORDS[worst_grade(found)]}: {said or 'no check found a problem'}."


def _write_remarks(subject: Subject, most: int) -> str:
    """Write the first lines of the remarks, and whether there are more."""
    lines = [line for one in remarks(subject) for line in _wrap_text(one.sentence, 150)]
    return "\n".join(lines if len(lines) <= most else [*lines[: most - 1], "and more in the report"])


def _distances_png(subject: Subject) -> bytes:
    with plain_figure(6.4, 4.2) as figure:
        _draw_curve(figure.add_axes((0.12, 0.16, 0.84, 0.74)), subject)
        draw_caption(figure, f"{subject.case.name} · {made(subject)}")
        return png(figure, 150)


def _draw_curve(axes: Axes, subject: Subject) -> None:
    """Draw the share of points within a distance, on the headline set of points."""
    group = subject.headline
    names = dict.fromkeys([next(iter(subject.results)), *subject.shown])  # with the start, to show the gain
    gaps = {name: subject.results[name].measured(group, subject.last)[1] for name in names} if group else {}
    gaps = {name: np.sort(values) for name, values in gaps.items() if len(values)}
    for name, values in gaps.items():
        k = subject.style(name) % len(LIGHT)
        axes.plot(
            values,
            np.linspace(0, 1, len(values)),
            color=LIGHT[k],
            linestyle=DASHES[k],
            lw=1.8,
            label=drawable(name),
        )
    if gaps:
        axes.set(xlim=(0, float(np.percentile(np.concatenate(list(gaps.values())), 99))), ylim=(0, 1))
        axes.legend(frameon=False, fontsize=8, loc="lower right")
        axes.set_title(f"{SETS[group or 'fitted']}: share of points within a distance", fontsize=9)
    axes.set_xlabel(f"distance, {subject.unit}")
    axes.grid(color="#dde1e6", lw=0.7)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_table(figure: Figure, subject: Subject, box: tuple[float, float, float, float]) -> None:
    """Draw the table of mean distances; the sets that were fitted stand last."""
    sets, rows = mean_table(subject)
    if len(sets) > MOST_COLUMNS:
        sets = [*sets[: MOST_COLUMNS - 1], sets[-1]]
        rows = [(name, [*cells[: MOST_COLUMNS - 1], cells[-1]]) for name, cells in rows]
    axes = figure.add_axes(box)
    axes.set_axis_off()
    heads = [
        textwrap.fill(SETS[group] + " (used in the fit)" * (group in SEEN), LETTERS, break_long_words=False)
        for group in sets
    ]
    cells = [[drawable(name), *values] for name, values in rows[-MOST_ROWS:]]
    letters = np.array([max(len(row[0]) for row in cells), *[LETTERS] * len(heads)])
    drawn = axes.table(
        cells,
        colLabels=[f"mean, {subject.unit}", *heads],
        colWidths=(letters / letters.sum()).tolist(),
        loc="upper left",
        cellLoc="right",
        edges="horizontal",
    )
    drawn.auto_set_font_size(False)
    drawn.scale(1, 1.25)
    for (row, column), cell in drawn.get_celld().items():
        cell.set_edgecolor("#c9ced6")
        cell.set_height(cell.get_height() * (HEAD_LINES * 0.75 if row == 0 else 1.0))
        cell.get_text().set_parse_math(False)
        cell.get_text().set_fontsize(7 if row == 0 else 8)  # the longest word of a head fills its column
        if column == 0:
            cell.get_text().set_horizontalalignment("left")
            cell.PAD = 0.03
            shrunk(cell.get_text(), (1 - 2 * cell.PAD) * cell.get_width() * axes.bbox.width)


def _wrap_text(text: str, width: int, most: int | None = None) -> list[str]:
    return textwrap.wrap(drawable(text, 2000), width, max_lines=most, placeholder=" …")
