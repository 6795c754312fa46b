"""A real atrium with enhanced wall, whose voltages follow the enhancement by a line that is known.

The ratio of the wall to the blood, as late enhancement shows it, belongs to the prior's wall. A map of the
moved wall measures at each site ln(voltage) = ln(0.5) + slope * (ratio - half) + what varies besides: the
value is that of the place where the catheter truly was.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from o3dls import Case, Surface

from . import wall
from .family import beaten
from .mapping import Mapping
from .redo import CHANGED, VOLTAGE, inside_of, map_wall, rough_field
from .shapes import Array

RATIO = "image_ratio"  # field of the prior
HEALTHY, VARIES = 0.9, (12.0, 0.08)  # of healthy wall; mm, and the sd of what varies over them
SCARS, RADIUS, MORE, RIM = (4, 8), (4.0, 13.0), (0.3, 0.7), 1.0  # patches; mm; how much they shine; mm
SLOPES, HALF = (-3.5, -1.5), (0.95, 1.25)  # ln(mV) for 1 of the ratio; the ratio of wall with 0.5 mV
LOW = 0.5  # mV
PATCHY = (2.5, 0.2)  # mm, and sd of ln(mV), that the ratio does not explain
VALUE_NOISE = (0.3, 0.0)


@dataclass(frozen=True, eq=False)
class Scarred:
    """A scarred case has the true slope of ln(mV) on the ratio, and the ratio at which there is 0.5 mV."""

    case: Case
    slope: float
    half: float


def scarred(prior: Surface, seed: int, *, family: str = "flow", how: Mapping | None = None) -> Scarred:
    """The case of a seed: the prior has the field `image_ratio`, the points the columns `bipolar` and
    `image_ratio_true`; the truth has moved by a motion of the family. Far ends are marked, no point lies
    inside.
    """
    image, line, beat, catheter = np.random.default_rng((seed, 33_029)).spawn(4)
    ratio = _enhanced(image, prior)
    slope, half = float(line.uniform(*SLOPES)), float(line.uniform(*HALF))
    level = np.log(LOW) + slope * (ratio - half) + rough_field(line, prior, *PATCHY)
    after = beaten(prior, family, 1.0, *beat.spawn(2)).wall
    truth = replace(after, fields={VOLTAGE: np.exp(level), CHANGED: np.zeros(len(level)), RATIO: ratio})
    own = replace(prior, fields={RATIO: ratio})
    case = map_wall(catheter, own, truth, how or Mapping(), f"scarred_{seed}", VALUE_NOISE)
    said = f"{case.notes}, slope {slope:.4f} ln(mV), {LOW:g} mV at a ratio of {half:.4f}"
    return Scarred(replace(case, notes=said), slope, half)


def _enhanced(rng: np.random.Generator, surface: Surface) -> Array:
    """A field of ratios (n,): smooth, with patches of enhanced wall."""
    found = HEALTHY + rough_field(rng, surface, *VARIES)
    for middle in rng.integers(len(found), size=rng.integers(*SCARS)):
        away = wall.ways(surface, np.array([middle]))[0]
        found += rng.uniform(*MORE) * inside_of(away - rng.uniform(*RADIUS), RIM)
    return np.asarray(found)
