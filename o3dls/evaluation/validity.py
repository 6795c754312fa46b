"""Is an estimate a surface that one can use: closed, in one piece, without folds, and how its volume compares
with the prior's.
"""

from __future__ import annotations

import numpy as np

from ..adapters.self_intersections import self_intersections
from ..arrays import Ints
from ..geometry.flipped_faces import flipped
from ..geometry.surface import Surface

Record = dict[str, bool | int | float | None]
SHAPE = ("watertight", "components", "euler", "self_intersections", "flipped_faces")  # the same in any pose


def validity(surface: Surface, prior: Surface, unit: str = "mm", posed: Record | None = None) -> Record:
    """Return `{watertight, components, euler, self_intersections, flipped_faces, volume_ml, volume_change}`
    of a surface.

    volume_change is (volume - volume of the prior as it was given) / volume of the prior, so it holds the
    scale of the motion too. In 2D the enclosed area, `area_mm2` or `area_px2`, stands for the volume. Open
    surfaces enclose nothing: None. What does not depend on the pose is taken from `posed`, where that was
    found of the same surface in another one.
    """
    size = surface.volume if surface.watertight else None
    before = prior.volume if prior.watertight else None
    amount, name = (1e-3, "volume_ml") if surface.dimension == 3 else (1.0, f"area_{unit}2")
    shape = {key: posed[key] for key in SHAPE} if posed else _judge_shape(surface)
    return {
        **shape,
        name: None if size is None else size * amount,
        "volume_change": None if size is None or not before else size / before - 1.0,
    }


def _judge_shape(surface: Surface) -> Record:
    return {
        "watertight": surface.watertight,
        "components": components(surface),
        "euler": euler(surface),
        "self_intersections": self_intersections(surface),
        "flipped_faces": flipped_faces(surface),
    }


def faults(found: Record, prior: Record, *, reshaped: bool = False) -> list[str]:
    """Return why a surface is not valid, one sentence each; what the prior itself brings is not held against
    the result, nor handles that points have asked for where it was `reshaped`.
    """
    said = []
    if prior["watertight"] and not found["watertight"]:
        said.append("the surface is not watertight")
    for key, words in (
        ("components", "components"),
        ("self_intersections", "self-intersecting faces"),
        ("flipped_faces", "flipped faces"),
    ):
        if (found[key] or 0) > (prior[key] or 0):
            said.append(f"the surface has {found[key]} {words}, the prior {prior[key]}")
    if not reshaped and handles(found) > handles(prior):
        said.append(f"the surface has {handles(found)} handles or tunnels, the prior {handles(prior)}")
    if (found["volume_change"] or 0.0) <= -1.0:
        said.append("the surface is inside out")
    return said


def handles(found: Record) -> int:
    """Return the number of handles of a closed surface; an open one's borders cannot be told from them, and
    an outline has none.
    """
    closed = found["watertight"] and "volume_ml" in found
    return int((found["components"] or 0) - (found["euler"] or 0) / 2) if closed else 0


def components(surface: Surface) -> int:
    """Return the number of pieces that hang together by shared vertices."""
    from ..geometry.components import component_labels

    return len(np.unique(component_labels(len(surface.vertices), surface.faces)[surface.faces[:, 0]]))


def euler(surface: Surface) -> int:
    """Return the Euler number: vertices - edges + faces in 3D (2 for a sphere), vertices - segments in 2D (0
    for closed loops).
    """
    used = len(np.unique(surface.faces))
    return (
        used - len(surface.faces)
        if surface.dimension == 2
        else used - len(_unique_edges(surface)) + len(surface.faces)
    )


def flipped_faces(surface: Surface) -> int:
    """Return faces that look against the mean direction of the surface at their own corners, as folded-over
    faces do.
    """
    return int(flipped(surface).sum())


def _unique_edges(surface: Surface) -> Ints:
    """Return the undirected edges (k, 2), each once."""
    f = surface.faces
    pairs = f if surface.dimension == 2 else np.vstack([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
    low, high = np.sort(pairs, axis=1).T
    most = int(f.max()) + 1
    return np.column_stack(np.divmod(np.unique(low * most + high), most))  # one number sorts faster than two
