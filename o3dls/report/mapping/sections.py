"""The sections: regions of the wall, and where to map next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...arrays import Array, Ints
from ...evaluation.interpolation import REACH
from ...evaluation.next_places import MEAN_OVER_SD, Advice
from ...evaluation.regions import word
from ..expected import FEWEST, left_out_scatter
from ..markup import Child, Html, join, millimetres, table, tag
from ..section import Section
from ..subject import SETS, Subject
from .advice import HEAD, located, shown_advice
from .wall_regions import wall_regions

MEANING = (
    "are places of the wall where one more mapping point would reduce the uncertainty most, by "
    "the posterior of the motion; each place takes those before it into account. This is an expectation from "
    "the prior, the points and their noise, not a measurement. The posterior cannot tell whether a catheter "
    "can reach a place. No place is in the mitral valve where a landmark names that, and each vein or "
    "appendage without a point has one. For research only; not advice for a procedure."
)


def next_section(subject: Subject) -> Section | None:
    """List the best places for one more point each; None where the last estimate has no joint posterior."""
    found = shown_advice(subject)
    if found is None:
        return None
    if not found.places:
        return Section("next", "Where to map next", tag("p", f"No place is proposed: {found.ended}."))
    these = "The numbers in the pictures" if subject.case.dimension == 3 else "These"
    ended = tag("p", f"There are no more: {found.ended}.") if found.ended else None
    body = join(tag("p", f"{these} {MEANING}"), _places_table(subject, found), ended)
    return Section("next", "Where to map next", body)


def _places_table(subject: Subject, found: Advice) -> Html:
    rows: list[list[Child]] = [[k + 1, *one.cells()] for k, one in enumerate(located(subject, found))]
    note = (
        f"Lengths in {subject.unit}. Errors are mean distances that the posterior expects, around the place "
        "(0.4 rms radii: 10 mm of an atrium) and over the whole wall, without and with a point there."
    )
    return tag("div", table(["", *HEAD], rows, note), class_="left")


def region_section(subject: Subject) -> Section | None:
    """Tabulate each region's share, points, distances and errors; None where regions are not known."""
    surface = subject.last.estimate.surface
    of = wall_regions(subject, surface)
    if of is None:
        return None
    unit, group = subject.unit, subject.headline
    judged = SETS[group] if group else "no points"
    head: list[Child] = [
        "region",
        "share of the area, %",
        "mapping points",
        f"mean distance, {judged}, {unit}",
        "n",
        f"expected error, {unit}",
        "left-out points, times as far off as predicted",
        "without points, %",
    ]
    note = (
        f"Of {subject.last.name}, by the patient's axes and the named places. Without points: farther than "
        f"{REACH:g} {unit} from every fitted point. Fewer than {FEWEST} points say nothing of a region."
    )
    body = table(head, _region_rows(subject, of, group), note)
    return Section("regions", "Regions of the wall", body)


def _region_rows(subject: Subject, of: Ints, group: str | None) -> list[list[Child]]:
    surface = subject.last.estimate.surface
    area = surface.vertex_areas
    tree = cKDTree(surface.vertices)
    points = of[tree.query(subject.last.run.points.of("eam").xyz)[1]]
    xyz, gaps = subject.last.measured(group) if group else (np.zeros((0, 3)), np.zeros(0))
    at = of[tree.query(xyz)[1]] if len(xyz) else np.zeros(0, dtype=np.int64)
    sd = surface.fields.get(f"sd_{subject.unit}", np.full(len(of), np.nan))
    far = surface.fields.get("prior_only", np.full(len(of), np.nan))
    rows = list[list[Child]]()
    for region in np.unique(of):
        part = of == region
        there = at == region
        scatter = left_out_scatter(subject.last, points == region)
        mean_sd = _mean_by_area(area, sd, part)
        alone = _mean_by_area(area, far, part)
        rows.append(
            [
                word(int(region)),
                f"{100 * area[part].sum() / area.sum():.1f}",
                int((points == region).sum()),
                _unless_few(int(there.sum()), float(gaps[there].mean()) if there.any() else None),
                int(there.sum()),
                millimetres(None if mean_sd is None else MEAN_OVER_SD * mean_sd),
                "–" if scatter is None else _unless_few(scatter.count, scatter.ratio),
                "–" if alone is None else f"{100 * alone:.0f}",
            ]
        )
    return rows


def _unless_few(count: int, value: float | None) -> str:
    """Write a value of a region's points, unless there are too few of them."""
    return "too few points" if 0 < count < FEWEST else millimetres(value)


def _mean_by_area(area: Array, values: Array, part: NDArray[np.bool_]) -> float | None:
    """Return the mean by area over a part, None where nothing is known of it."""
    known = part & np.isfinite(values)
    weight = area[known]
    return float(weight @ values[known] / weight.sum()) if weight.sum() > 0 else None
