"""The points that a reconstruction is given."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...arrays import Array, Ints
from ...noise.contact import Contact


@dataclass(frozen=True, eq=False)
class Inside:
    """These points (k, 3) are known to be inside only, with their noise (k,)."""

    points: Array
    noise: Array


@dataclass(frozen=True, eq=False)
class Believed:
    """These are points (n, 3) as a motion left them: probabilities of contact (n,), noise (n,), factors (n,)
    on the odds of being an outlier, and the mixture; those that are known to be inside; whether the prior is
    a template, another person's heart, which may have parts that the patient lacks; the deviation of errors
    that points may share unseen; and, where errors go together, the number (n,) of the stretch of the order
    in which each was taken: points of one stretch do not tell of each other.
    """

    points: Array
    weights: Array
    noise: Array
    odds: Array
    contact: Contact
    inside: Inside = field(default_factory=lambda: Inside(np.zeros((0, 3)), np.zeros(0)))
    template: bool = False
    doubt: float = 0.0
    stretch: Ints | None = None
