"""A jar of 60 x 60 x 80 mm: a body of revolution with a lip; the prior is the jar bent as a whole, as a shaky
hand drew it.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.interpolate import PchipInterpolator

from o3dls import Case, Points, Surface, Truth

from . import sampling, shapes
from .meshing import mesh
from .motion import bend, then, wobble
from .shapes import Shape

# radius, z
WALL = np.array(
    [[12.0, 8], [16, 14], [20, 24], [21, 33], [19, 43], [13, 52], [9, 58], [9, 62], [11, 67], [14, 71]]
)
ROUNDING = 1.5
SPACING = 1.5
BENT_OVER, SHAKEN_OVER = 60.0, 8.0  # mm


def shape() -> Shape:
    """The jar as a signed distance, its axis at x = y = 30."""
    z = np.linspace(WALL[0, 1], WALL[-1, 1], 40)
    side = np.column_stack([PchipInterpolator(WALL[:, 1], WALL[:, 0])(z), z])
    outline = shapes.polygon(np.vstack([side, side[::-1] * [-1.0, 1.0]]))
    return shapes.move(shapes.revolve(shapes.grow(outline, ROUNDING)), (30.0, 30.0, 0.0))


@cache
def truth_surface() -> Surface:
    """The jar as a mesh, the same for every seed."""
    return mesh(shape(), (2, 2, 2), (58, 58, 78), SPACING)


def jar(
    seed: int = 7, *, percent: float = 6.0, points: int = 282, bent: float = 2.0, shake: float = 0.3
) -> Case:
    """The case of a seed; percent: noise per axis in percent of the points' standard deviation.

    bent: how far (rms, mm) the prior is off once it lies as well as it can; shake: sd per axis (mm) of the
    hand that drew it.
    """
    scribe, hand = np.random.default_rng((seed, 2203)).spawn(2)
    truth = truth_surface()
    drawn = then(bend(scribe, truth.vertices, bent, BENT_OVER), wobble(scribe, shake, SHAKEN_OVER, 3))
    xyz = sampling.sites(hand, truth, points).xyz
    noise = percent / 100.0 * float(np.sqrt(xyz.var(axis=0).mean()))
    xyz = np.round(xyz + noise * hand.normal(size=xyz.shape), 3)
    return Case(
        name=f"jar_{seed}",
        prior=truth.with_vertices(drawn(truth.vertices)),
        points=Points(xyz, np.repeat(["eam"], points)),
        notes=f"synthetic jar: seed {seed}, noise {noise:.3f} mm ({percent:g} %)",
        truth=Truth(truth, sampling.sites(hand, truth, 4000).xyz),
    )
