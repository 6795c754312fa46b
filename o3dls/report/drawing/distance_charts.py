"""Distribution of distances: share of points within a distance, and how many lie at each."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...arrays import Array
from ..markup import Html, join, tag
from ..section import Section
from ..subject import HEADLINE, SETS, Subject
from .charts import Axis, Series, axis_over, grouped, line_chart

BINS = 24
MOST = 400  # corners of a curve


def spread_section(subject: Subject) -> Section | None:
    """Draw curves and histograms of the headline set and of the other sets of points that were not fitted."""
    sets = [group for group in HEADLINE if len(subject.last.measured(group)[1]) > 1]
    if not sets:
        return None
    shown = [group for group in sets if group != "fitted"][:2] or sets
    return Section(
        "spread", "Distribution of distances", join(*(_draw_pair(subject, group) for group in shown))
    )


def _draw_pair(subject: Subject, group: str) -> Html:
    names = dict.fromkeys([next(iter(subject.results)), *subject.shown])  # with the start, to show the gain
    found = [
        (name, subject.style(name), subject.results[name].measured(group, subject.last)[1]) for name in names
    ]
    found = [one for one in found if len(one[2])]
    reach = float(np.percentile(np.concatenate([gaps for _, _, gaps in found]), 99.5))
    x = Axis(f"distance, {subject.unit}", 0.0, max(reach, 1e-9))
    within = [Series(name, style, *cumulative(gaps, reach)) for name, style, gaps in found]
    counts = [Series(name, style, *histogram(gaps, reach)) for name, style, gaps in found]
    return join(
        tag("h3", f"{SETS[group].capitalize()}, {len(found[0][2])} points"),
        grouped(
            line_chart(
                "Share of points within a distance",
                within,
                x,
                Axis("share of points", 0.0, 1.0),
                np.linspace(0, x.high, 11),
            ),
            line_chart(
                "Number of points at a distance",
                counts,
                x,
                axis_over("points", [s.y for s in counts]),
                (np.arange(BINS) + 0.5) * reach / BINS,  # the middles of the bins
            ),
        ),
        beyond({name: int((gaps > reach).sum()) for name, _, gaps in found}, f"{reach:.2f} {subject.unit}"),
    )


def beyond(counts: Mapping[str, int], reach: str) -> Html | None:
    """Say how many points lie outside the charts."""
    said = ", ".join(f"{count} of {name}" for name, count in counts.items() if count)
    return (
        tag("p", f"Points farther than {reach}, where the charts end: {said}.", class_="soft")
        if said
        else None
    )


def cumulative(gaps: Array, reach: float) -> tuple[Array, Array]:
    """Return corners of the empirical distribution as far as the reach, thinned where there are many."""
    share = np.linspace(0, 1, min(len(gaps), MOST))
    at = np.quantile(gaps, share)
    inside = at <= reach
    return np.r_[0.0, at[inside], reach], np.r_[0.0, share[inside], np.interp(reach, at, share)]


def histogram(gaps: Array, reach: float) -> tuple[Array, Array]:
    """Return the outline of a histogram of the distances as far as the reach."""
    counts, edges = np.histogram(gaps, bins=BINS, range=(0.0, reach))
    return np.repeat(edges, 2)[1:-1], np.repeat(counts, 2).astype(np.float64)
