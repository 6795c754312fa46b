"""Numbers with their intervals: measured on the surface itself, and on each of its samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numba import njit

from ...arrays import Array
from ...motion.wall.samples import SurfaceSamples
from ...parallel import by_rows
from .numbers import Parts, Quantity, measure_surface, measure_surfaces, slopes

LEVEL = 0.95
# times that intervals are wider than what samples spread: these take amplitudes, feet and outliers as known,
# and are too much alike where the motion strains the wall; la_60 to la_79 of benchmarks.measures asked for
# it, but for sections of tubes, which depend on few vertices, and for volumes of a patient's own wall, which
# no strain along the wall changes
WIDER, SECTION, VOLUME = 1.3, "section", "volume"


@dataclass(frozen=True)
class Measure:
    """A measure is a quantity with its value on the surface alone (naive), and the mean and the 95 % interval
    of what it may be by the samples.
    """

    quantity: Quantity
    naive: float
    mean: float
    low: float
    high: float

    def record(self) -> dict[str, str | float]:
        """Return the measure as JSON has it."""
        numbers = {"naive": self.naive, "mean": self.mean, "low": self.low, "high": self.high}
        return {**self.quantity._asdict(), **numbers}


def measure_samples(samples: SurfaceSamples, parts: Parts, values: Array | None = None) -> list[Measure]:
    """Measure a surface and its samples. Parameters as of `sample_numbers`."""
    naive = measure_surface(samples.surface, parts, None, values)
    drawn = draw_numbers(samples, parts, naive, values)
    return [summarise(quantity, naive[quantity], numbers) for quantity, numbers in drawn.items()]


def draw_numbers(
    samples: SurfaceSamples, parts: Parts, naive: Mapping[Quantity, float], values: Array | None = None
) -> dict[Quantity, Array]:
    """Return what the numbers of a surface may be, (k,) each, by its k samples: what lies beside their mean
    is added to the naive number, `WIDER` times but for sections and volumes of a patient's own wall, and what
    is absent in a sample is taken off.

    A sample is as rough as the errors are, and so its walls and ways are longer than those of the surface.
    """
    there = _move_values(samples, values)
    whole, present = measure_surfaces(samples.surface, samples.vertices, parts, there, samples.exists)
    found = dict[Quantity, Array]()
    for quantity, numbers in whole.items():
        most = 100.0 if quantity.unit == "%" else np.inf
        plain = quantity.what.startswith(SECTION) or (quantity.what == VOLUME and not parts.template)
        wider = 1.0 if plain else WIDER
        found[quantity] = np.clip(naive[quantity] + wider * (numbers - numbers.mean()), 0.0, most)
    for quantity, numbers in present.items():
        found[quantity] += numbers - whole[quantity]
    return found


def sample_numbers(
    samples: SurfaceSamples, parts: Parts, values: Array | None = None
) -> dict[Quantity, Array]:
    """Return what is measured on each of k samples of a surface, (k,) for each quantity, as if all of the
    wall existed.

    values (n,): a field of the map on the surface, NaN where it is not known. It stays in the map: a vertex
    that lies elsewhere in a sample has the value of there, by the field's slope along the wall.
    """
    return measure_surfaces(samples.surface, samples.vertices, parts, _move_values(samples, values))[0]


def _move_values(samples: SurfaceSamples, values: Array | None) -> Array | None:
    """Return the values (k, n) of the map where the samples have the vertices."""
    if values is None:
        return None
    surface, found = samples.surface, np.empty(samples.exists.shape)
    rows = found, samples.vertices
    by_rows(_fill_moved, 1, rows, surface.vertices, slopes(surface, values), values)
    return found


@njit(cache=True, nogil=True)
def _fill_moved(found, moved, vertices, slope, values):  # type: ignore[no-untyped-def]
    """Fill in values (k, n) of a field of a slope (n, 3) at moved vertices (k, n, 3)."""
    for k in range(len(found)):
        for v in range(len(vertices)):
            found[k, v] = values[v]
            for a in range(3):
                found[k, v] += (moved[k, v, a] - vertices[v, a]) * slope[v, a]


def summarise(quantity: Quantity, naive: float, drawn: Array) -> Measure:
    """Return the measure of a number on the surface, by what it may be (k,)."""
    if not np.isfinite(drawn).all():  # nothing of a region is mapped
        return Measure(quantity, naive, np.nan, np.nan, np.nan)
    low, high = np.quantile(drawn, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
    return Measure(quantity, naive, float(drawn.mean()), float(low), float(high))
