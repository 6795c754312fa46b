"""What a reconstruction has found: the field and the points that it follows."""

from __future__ import annotations

from dataclasses import dataclass

from ...arrays import Array
from ...noise.contact import Contact
from .equations import Oriented
from .moved_prior import MovedPrior
from .splines import SplineField


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A reconstruction has a field g on the moved prior, the points that it follows, their noise, how likely
    (n,) each touches, and by how many nats it predicts points better than the moved prior alone; rms radius
    of the prior, distance between points, widths of the field's lattices; points (k, 3) that are known to be
    inside; the mixture of points on the wall and off it; whether the prior is a template.
    """

    prior: MovedPrior
    field: SplineField
    wall: Oriented
    sigma: float
    weights: Array
    gain: float
    radius: float
    between: float
    lengths: list[float]
    inside: Array
    contact: Contact
    template: bool = False
