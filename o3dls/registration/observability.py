"""Which motions of the surface the points determine, and how well: the spectrum of the point-to-plane
Hessian.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..geometry.similarity import rms_radius, scale_of
from ..geometry.twist import Twist
from .match import Pairs
from .metrics import point_to_plane
from .step import normal_equations, velocity

# standard deviation of a motion (rms over the surface, relative to its rms radius) from which on it is called
# weak
WEAK = 0.03
LOST = 0.05  # ... and from which on it is not determined
ROUND = 1.1  # axes of the surface that differ by less than this factor have no names
AXES = {2: ("long", "short"), 3: ("long", "middle", "short")}


@dataclass(frozen=True, eq=False)
class Direction:
    """A direction is one principal direction of uncertainty: its standard deviation as rms motion of the
    surface, and the parts of that motion: shift (d,), rotation vector (r,) in radians, log scale; `meaning`
    names the largest part.
    """

    sd: float
    relative: float
    shift: Array
    turn: Array
    log_scale: float
    meaning: str

    @property
    def weak(self) -> bool:
        return self.relative > WEAK

    def sentence(self, units: str) -> str:
        """Return what a reader should know of a weak direction."""
        how = "do not" if self.relative > LOST else "only weakly"
        return (
            f"the points {how} determine the {self.meaning}: standard deviation {self.sd:.2g} {units} over "
            f"the surface{self._amount_in_unit()}"
        )

    def _amount_in_unit(self) -> str:
        """Return the uncertainty in the motion's own unit, in words."""
        if self.meaning.startswith("rotation"):
            return f" ({np.degrees(np.linalg.norm(self.turn)):.2g} degrees)"
        return f" ({100.0 * abs(self.log_scale):.2g} %)" if self.meaning == "scale" else ""

    def record(self) -> dict[str, Any]:
        """Return a JSON-ready record, lengths in the case's unit, angles in degrees for readers."""
        return {
            "meaning": self.meaning,
            "sd": self.sd,
            "relative": self.relative,
            "shift": self.shift.tolist(),
            "turn_degrees": np.degrees(self.turn).tolist(),
            "log_scale": self.log_scale,
        }


def spectrum(
    pairs: Pairs, weights: Array, vertices: Array, T_map_prior: Array, *, scale: bool
) -> list[Direction]:
    """Return the directions, least certain first, for independent residuals of the size found; `vertices` (n,
    d) in the prior frame.
    """
    d = vertices.shape[1]
    linear = T_map_prior[:-1, :-1]
    centre = linear @ vertices.mean(axis=0) + T_map_prior[:-1, -1]
    radius = scale_of(T_map_prior) * rms_radius(vertices)
    parts = Twist(d, scale=scale)
    factors = point_to_plane(pairs)
    hessian, _ = normal_equations(factors, weights, velocity(factors, parts, centre))
    noise = np.sqrt(weights @ factors.residuals**2 / max(weights.sum() - len(hessian), 1.0))
    units = np.ones(parts.size)
    units[d:] /= radius
    values, vectors = np.linalg.eigh(hessian * np.outer(units, units))
    lengths, axes = _principal_axes(vertices @ linear.T)
    found = []
    for value, vector in zip(values, vectors.T, strict=True):
        # beyond its own size a motion has no meaning
        sd = float(min(noise / np.sqrt(max(value, 1e-300)), radius))
        twist = sd * units * vector
        log_scale = float(twist[-1]) if scale else 0.0
        found.append(
            Direction(
                sd,
                sd / radius,
                twist[:d],
                twist[parts.turn],
                log_scale,
                _name_direction(vector, parts, axes, lengths),
            )
        )
    return found


def _principal_axes(vertices: Array) -> tuple[Array, Array]:
    """Return the lengths (d,) and unit axes (d, d rows) of the surface, longest first."""
    values, vectors = np.linalg.eigh(np.cov(vertices.T))
    return np.sqrt(values[::-1]), vectors.T[::-1]


def _name_direction(vector: Array, parts: Twist, axes: Array, lengths: Array) -> str:
    """Name the largest part of a direction (in units of surface motion): shift along, rotation about an axis,
    or scale.
    """
    shift = vector[: parts.d]
    turn = vector[parts.turn]
    sizes = {
        "shift": float(shift @ shift),
        "rotation": float(turn @ turn),
        "scale": float(vector[-1] ** 2) if parts.scale else 0.0,
    }
    kind = max(sizes, key=lambda part: sizes[part])
    if kind == "scale":
        return "scale"
    if kind == "rotation" and parts.d == 2:
        return "rotation"
    return (
        f"{kind} {'along' if kind == 'shift' else 'about'} "
        f"{_axis_name(shift if kind == 'shift' else turn, axes, lengths)}"
    )


def _axis_name(vector: Array, axes: Array, lengths: Array) -> str:
    """Return `the long axis` where the vector lies within 30 degrees of an axis that is longer or shorter
    than the others, else its coordinates.
    """
    unit = vector / np.linalg.norm(vector)
    along = np.abs(axes @ unit)
    best = int(np.argmax(along))
    others = np.delete(lengths, best)
    distinct = bool((np.maximum(others / lengths[best], lengths[best] / others) > ROUND).all())
    if along[best] > np.cos(np.pi / 6.0) and distinct:
        return f"the {AXES[len(axes)][best]} axis"
    unit = unit * (1.0 if unit[np.argmax(np.abs(unit))] > 0.0 else -1.0)
    return "(" + ", ".join(f"{x:.2f}" for x in unit) + ")"
