"""Whether the error that the posterior expects can be believed: by points that fits had not seen."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ...evaluation.regions import word
from ..expected import FEWEST, Expected, Scatter, expected_error, left_out_scatter
from ..mapping.wall_regions import wall_regions
from ..subject import Subject
from ..wall_parts import MAPPED, PRIOR_ONLY
from .check import Check, count_decimals

# times as far off as predicted: left-out points of one block err together, and of fifteen blocks such a ratio
# scatters by a fifth
NARROW = 1.5
UNLIKELY = (
    0.001  # chance of the left-out points of a region where the posterior holds: of a dozen regions each
)
NAME, NO_POSTERIOR = "Expected error", "no posterior"
LIMIT = f"up to {NARROW:g} times predicted"


def check_expected_error(subject: Subject) -> Check:
    """Compare the posterior with the points that were left out. Without such points nothing supports it."""
    found = expected_error(subject)
    if found is None:
        return Check(NAME, "none", "no stage gives a posterior", NO_POSTERIOR)
    scatter = left_out_scatter(subject.last)
    mean = f"mean {found.all:.2f} {subject.unit}"
    # the number of the first screen: of two that differ, a reader cannot know which to believe
    short = f"{found.all if found.mapped is None else found.mapped:.1f} {subject.unit}"
    short = short if found.mapped is None else f"{short}, {MAPPED}"
    if scatter is None:
        said = f"{mean} by the posterior alone ({_list_parts(found, subject.unit)})"
        return Check(
            NAME, "none", f"{said}; not cross-validated: set folds = 5 to test it", f"{short}, not tested"
        )
    said = f"{mean} ({_list_parts(found, subject.unit)})"
    times = f"{scatter.ratio:.{count_decimals(scatter.ratio, (NARROW,), 2)}f}"
    ratio = f"{scatter.count} points that were left out lie {times} times as far off as predicted"
    doubts = [f"{ratio}: the posterior is too narrow"] if scatter.ratio > NARROW else []
    doubts += [
        f"do not rely on it at {_describe_region(word(region), one, subject.unit)}"
        for region, one in contradicted_regions(subject).items()
    ]
    if doubts:
        return Check(NAME, "amber", f"{said}; {'; '.join(doubts)}", f"{short}, contradicted", LIMIT)
    return Check(NAME, "good", f"{said}; {ratio}", short, LIMIT)


def at_least(subject: Subject) -> str:
    """Return what stands before the model's error of unmapped wall: where left-out points lie clearly farther
    off than the model predicts, they widen that of mapped wall alone, and the other is a lower bound.
    """
    scatter = left_out_scatter(subject.last)
    return "at least " if scatter and scatter.ratio > NARROW else ""


def _list_parts(found: Expected, unit: str) -> str:
    parts = ((MAPPED, found.mapped), (f"{PRIOR_ONLY}, by the posterior alone", found.prior_only))
    return "; ".join(f"{name}: {value:.2f} {unit}" for name, value in parts if value is not None)


def contradicted_regions(subject: Subject) -> dict[int, Scatter]:
    """Return the scatter of the left-out points of each region that they contradict, the worst first."""
    of = wall_regions(subject, subject.last.estimate.surface)
    if of is None or left_out_scatter(subject.last) is None:
        return {}
    eam = subject.last.run.points.of("eam").xyz
    region = of[cKDTree(subject.last.estimate.surface.vertices).query(eam)[1]]
    found = dict[int, Scatter]()
    for one in np.unique(region):
        scatter = left_out_scatter(subject.last, region == one)
        if scatter and scatter.count >= FEWEST and scatter.chance < UNLIKELY:
            found[int(one)] = scatter
    return dict(sorted(found.items(), key=lambda item: item[1].chance))


def _describe_region(name: str, one: Scatter, unit: str) -> str:
    """Describe how far the left-out points of a region lie off."""
    return (
        f"{name} ({one.count} left-out points: {one.distance:.1f} {unit} off, {one.ratio:.1f} times "
        "as far as predicted)"
    )
