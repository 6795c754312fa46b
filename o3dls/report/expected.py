"""The error that the posterior expects of a surface, and whether it is the error that was made."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..evaluation.next_places import MEAN_OVER_SD
from ..geometry.surface import Surface
from .subject import Subject
from .surfaces.display import TRUTH

DUE = (0.68, 0.95)  # share of normal errors within one and two standard deviations
# errors of neighbours go together: a wall has some twenty independent ones, whose share within one standard
# deviation scatters by .1; twice that is off
OFF = 0.2


@dataclass(frozen=True)
class Expected:
    """This is the mean distance that the posterior expects between surface and wall: on all of it, and apart
    on the wall near fitted points and on that without points (None where there is no such wall).
    """

    all: float
    mapped: float | None
    prior_only: float | None


def expected_error(subject: Subject) -> Expected | None:
    """Return the expected error of the last estimate in the case's unit; None where it has no posterior."""
    return expected_of(subject.last.estimate.surface, subject.unit)


def expected_of(surface: Surface, unit: str) -> Expected | None:
    """Return the expected error of a surface, by its fields `sd_<unit>` and `prior_only`; else None."""
    sd = surface.fields.get(f"sd_{unit}")
    far = surface.fields.get("prior_only")
    if sd is None or far is None:
        return None
    error = _expected_distance(surface, sd, unit)
    everywhere = np.ones(len(sd), dtype=bool)
    means = [_mean_over_part(surface, error, part) for part in (everywhere, far == 0, far > 0)]
    return None if means[0] is None else Expected(means[0], *means[1:])


def _expected_distance(surface: Surface, sd: Array, unit: str) -> Array:
    """Return the distance (n,) that is expected from each vertex to the wall: by the deviation where there is
    wall; as far as there may be none, the way to the next point, which lies on some.
    """
    missing = absence(surface)
    gap = surface.fields.get(f"distance_to_nearest_point_{unit}", np.zeros(len(sd)))
    return np.asarray((1.0 - missing) * MEAN_OVER_SD * sd + missing * gap)


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
    """Return the share of the last surface's vertices whose distance to the true surface is within one and
    within two predicted standard deviations; None without truth or posterior.
    """
    fields = subject.surfaces[subject.last.name].fields
    sd, error = fields.get(f"sd_{subject.unit}"), fields.get(f"{TRUTH}_{subject.unit}")
    if sd is None or error is None:
        return None
    return float((error <= sd).mean()), float((error <= 2 * sd).mean())
