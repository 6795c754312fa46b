"""The error that the posterior expects of a surface, and whether left-out points or the truth confirm it.

Whether there is wall at all is another question (field `existence`), which is not mixed in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..evaluation.next_places import MEAN_OVER_SD
from ..evaluation.statistics import BAND_68, BAND_95
from ..geometry.surface import Surface
from .subject import Result, Subject
from .surfaces.display import TRUTH

DUE = (0.68, 0.95)  # share of the errors within the two bands
# errors of neighbours go together: a wall has some twenty independent ones, whose share within the
# narrow band scatters by .1; twice that is off
OFF = 0.2
FEWEST = 10  # points of a region from which they say something of it


@dataclass(frozen=True)
class Expected:
    """This is the mean distance that the posterior expects between surface and wall: on all of it, and apart
    on the wall near fitted points and on that without points (None where there is no such wall).
    """

    all: float
    mapped: float | None
    prior_only: float | None


@dataclass(frozen=True)
class Scatter:
    """This says how far points lie from the surfaces of fits without them: how many they are, the mean
    distance, its ratio to the deviation that these fits predicted, as rms (1 where the posterior holds), and
    the chance of as large a ratio where it holds. Each point counts as far as the fit to all believes that it
    touches the wall.

    Points of a block were left out together and err together, so that a block counts as one error: with the
    belief b of each block, the ratio's square times n is as chi-square with n = (sum b)^2 / sum b^2 degrees
    of freedom.
    """

    count: int
    distance: float
    ratio: float
    chance: float


def left_out_scatter(result: Result, rows: NDArray[np.bool_] | None = None) -> Scatter | None:
    """Return the scatter of the left-out points of an estimate, or of some of its `eam` points; None where
    none was left out or no posterior predicted it.
    """
    from scipy.special import chdtrc

    points = result.run.points
    gap = points.columns.get(f"left_out_{result.key}_{result.run.unit}")
    deviation = points.columns.get(f"left_out_sd_{result.key}_{result.run.unit}")
    if gap is None or deviation is None:
        return None
    belief = _believe_points(result)
    eam = points.type == "eam"
    known = eam & np.isfinite(deviation) & (deviation > 0.0) & (belief > 0.0)
    if rows is not None:
        known[eam] &= rows
    if not known.any():
        return None
    by_block = np.bincount(result.run.left_out_together[known[eam]], belief[known])
    n = float(by_block.sum() ** 2 / (by_block**2).sum())
    squared = float(np.average((gap[known] / deviation[known]) ** 2, weights=belief[known]))
    distance = float(np.average(gap[known], weights=belief[known]))
    return Scatter(int(known.sum()), distance, float(np.sqrt(squared)), float(chdtrc(n, n * squared)))


def _believe_points(result: Result) -> Array:
    """Return the probability (n,) that each point of a run touches the wall; 1 where no stage says it."""
    found = np.ones(len(result.run.points))
    fitted = np.isin(result.run.points.type, result.fitted)
    weights = result.estimate.weights
    if weights is not None and len(weights) == fitted.sum():
        found[fitted] = weights
    return found


def expected_error(subject: Subject) -> Expected | None:
    """Return the expected error of the last estimate in the case's unit; None where it has no posterior.
    Where left-out points lie farther off than the posterior predicts, that of the mapped wall is as much
    larger.
    """
    scatter = left_out_scatter(subject.last)
    widened = max(1.0, scatter.ratio) if scatter else 1.0
    return expected_of(subject.last.estimate.surface, subject.unit, widened)


def expected_of(surface: Surface, unit: str, widened: float = 1.0) -> Expected | None:
    """Return the expected error of a surface, by its fields `sd_<unit>` and `prior_only`; else None.
    widened: factor on that of the mapped wall.
    """
    sd = surface.fields.get(f"sd_{unit}")
    far = surface.fields.get("prior_only")
    if sd is None or far is None:
        return None
    error = MEAN_OVER_SD * np.where(far == 0, widened, 1.0) * sd
    everywhere = np.ones(len(sd), dtype=bool)
    means = [_mean_over_part(surface, error, part) for part in (everywhere, far == 0, far > 0)]
    return None if means[0] is None else Expected(means[0], *means[1:])


def absence(surface: Surface) -> Array:
    """Return the probability (n,) that there is no wall at each vertex; 0 without the field `existence`."""
    there = surface.fields.get("existence")
    return np.zeros(len(surface.vertices)) if there is None else 1.0 - there


def absent_share(surface: Surface) -> float:
    """Return the share of the area that is expected not to be there."""
    return float(surface.vertex_areas @ absence(surface) / surface.vertex_areas.sum())


def _mean_over_part(surface: Surface, error: Array, part: NDArray[np.bool_]) -> float | None:
    """Return the mean error on the vertices of a part, weighted by their area."""
    area = surface.vertex_areas * (part & np.isfinite(error))
    return float(area @ np.nan_to_num(error) / area.sum()) if area.sum() > 0 else None


def shares_within(subject: Subject) -> tuple[float, float] | None:
    """Return the share of the last surface's vertices whose distance to the true surface is within the 68 %
    and the 95 % band of their deviation; None without truth or posterior.
    """
    fields = subject.surfaces[subject.last.name].fields
    sd, error = fields.get(f"sd_{subject.unit}"), fields.get(f"{TRUTH}_{subject.unit}")
    if sd is None or error is None:
        return None
    return float((error <= BAND_68 * sd).mean()), float((error <= BAND_95 * sd).mean())
