"""Numbers with their intervals: measured on the surface itself, and on each of its samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array
from ...motion.wall.samples import SurfaceSamples
from .numbers import Parts, Quantity, measure_surface, measure_surfaces, slopes

LEVEL = 0.95


@dataclass(frozen=True)
class Measure:
    """A measure is a quantity with its value on the surface alone (naive), and the mean of its values on the
    samples with the interval that holds 95 % of them.
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
    """Measure a surface and its samples. Parameters as of `draw_numbers`."""
    naive = measure_surface(samples.surface, parts, None, values)
    drawn = draw_numbers(samples, parts, values)
    return [summarise(quantity, naive[quantity], values) for quantity, values in drawn.items()]


def draw_numbers(samples: SurfaceSamples, parts: Parts, values: Array | None = None) -> dict[Quantity, Array]:
    """Return what is measured on each of k samples of a surface: (k,) for each quantity.

    values (n,): a field of the map on the surface, NaN where it is not known. It stays in the map: a vertex
    that lies elsewhere in a sample has the value of there, by the field's slope along the wall.
    """
    surface = samples.surface
    there = None if values is None else values + _shifts_along(samples, slopes(surface, values))
    return measure_surfaces(surface, samples.vertices, parts, samples.exists, there)


def _shifts_along(samples: SurfaceSamples, slope: Array) -> Array:
    """Return by how much (k, n) a field of a slope (n, 3) differs where the samples have the vertices."""
    moved = np.einsum("knd,nd->kn", samples.vertices, slope)
    return np.asarray(moved - (samples.surface.vertices * slope).sum(axis=1))


def summarise(quantity: Quantity, naive: float, drawn: Array) -> Measure:
    """Return the measure of a number on the surface, and of those (k,) on its samples."""
    if not np.isfinite(drawn).all():  # nothing of a region is mapped
        return Measure(quantity, naive, np.nan, np.nan, np.nan)
    low, high = np.quantile(drawn, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
    return Measure(quantity, naive, float(drawn.mean()), float(low), float(high))
