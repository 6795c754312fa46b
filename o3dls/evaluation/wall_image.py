"""Values of a grey image on a wall: sampled along its normals, and as ratios to the blood inside of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..geometry.surface import Surface
from ..io.grey.image import GreyImage
from .distances import distances, occupancy

STEP = 0.25  # mm between samples along a normal: a fifth of the finest voxels of late enhancement
DEPTH = 5.0  # mm from the wall, at least, of what counts as blood: no enhancement shines into it there
GRID = 1.5  # mm between places in the blood
VALUE, RATIO = "image_value", "image_ratio"  # fields of a surface
SPARE = 5.0  # mm beyond a layer that are read of an image around a surface
FEWEST = 100  # places in the blood, of which a mean is taken
Take = Literal["mean", "max"]


class Sampled(Protocol):
    """A sampled image gives its values at points (..., 3), NaN where it has none."""

    def sample(self, points: Array) -> Array: ...


@dataclass(frozen=True)
class Layer:
    """A layer of the wall lies between two distances from a surface, in mm, outward positive; `take` says
    what of it a place gets: the mean, or the largest value.

    Raises InputError where the second distance is not above the first.
    """

    low: float = 0.5
    high: float = 2.0
    take: Take = "mean"

    def __post_init__(self) -> None:
        if not -50.0 <= self.low < self.high <= 50.0:
            raise InputError(
                f"layer {self.low:g} to {self.high:g} mm: must be two distances from the surface within 50 "
                "mm, the smaller one first; outward is positive"
            )

    @property
    def offsets(self) -> Array:
        """Distances (k,) at which samples are taken: the middles of steps of equal length."""
        count = max(int(np.ceil((self.high - self.low) / STEP)), 1)
        return np.asarray(self.low + (np.arange(count) + 0.5) * (self.high - self.low) / count)


@dataclass(frozen=True)
class Blood:
    """This is the blood of a chamber in the image: mean and standard deviation of its values, and how many
    places they are of.
    """

    mean: float
    sd: float
    places: int


def values_on_wall(image: GreyImage, surface: Surface, layer: Layer) -> tuple[Surface, Blood]:
    """Return a closed surface, in the frame of the image, with the values of a layer and their ratios to the
    blood as its only fields, and that blood. Raises InputError where the image cannot be read.
    """
    part = image.around(surface.vertices, max(abs(layer.low), abs(layer.high)) + SPARE)
    blood, values = blood_of(part, surface), wall_values(part, surface, layer)
    return replace(surface, fields={VALUE: values, RATIO: values / blood.mean}), blood


def wall_values(image: Sampled, surface: Surface, layer: Layer) -> Array:
    """Return the value (n,) of a layer at each vertex of a closed surface; NaN where a part of it lies
    outside of the image.
    """
    along = layer.offsets[None, :, None] * surface.vertex_normals[:, None, :]
    values = image.sample(surface.vertices[:, None, :] + along)
    return np.asarray(values.mean(axis=1) if layer.take == "mean" else values.max(axis=1))


def blood_of(image: Sampled, surface: Surface) -> Blood:
    """Return the blood inside of a closed surface, DEPTH or more from its wall. Raises InputError where there
    is too little of it, or it cannot be divided by.
    """
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    axes = [np.linspace(a, b, max(int(np.ceil((b - a) / GRID)), 2)) for a, b in zip(low, high, strict=True)]
    inside = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)[occupancy(surface, axes)]
    deep = inside[distances(inside, surface) >= DEPTH] if len(inside) else inside
    values = image.sample(deep)
    values = values[np.isfinite(values)]
    if len(values) < FEWEST:
        raise InputError(
            f"the blood inside of the prior, {DEPTH:g} mm or more from its wall, has {len(values)} places in "
            f"the image: at least {FEWEST} are needed for a ratio"
        )
    blood = Blood(float(values.mean()), float(values.std()), len(values))
    if not blood.mean > blood.sd:
        raise InputError(
            f"the blood inside of the prior has values of {blood.mean:.4g} (sd {blood.sd:.4g}): a ratio "
            "needs blood that is clearly above 0; is this the image that the prior was segmented in?"
        )
    return blood
