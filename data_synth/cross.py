"""One person's atrium as the prior of another's."""

from __future__ import annotations

import numpy as np

from o3dls import Case, Surface

from . import pose, wall
from .alignment import alongside, common_places
from .mapping import Mapping, case_of, mapped
from .shapes import Array

NAMES = ("L1", "L2", "L3", "L4")


def cross(
    prior: Surface,
    truth: Surface,
    seed: int = 7,
    *,
    landmarks: bool = True,
    how: Mapping | None = None,
    near: Array | None = None,
) -> Case:
    """The case of a seed: `prior` in its own frame and size, points on `truth` in a mapping system's frame.

    The two are brought near each other by shape (`alignment.alongside`, or the similarity `near` (4, 4) that
    it gave before). The start is what a lab has: with landmarks, four places that both have
    (`alignment.common_places`), marked in the map within 2 mm; without them, the rigid part of that pose, off
    by 3 to 10 degrees and 3 to 10 mm. In both, the size is the prior's own.
    """
    how = how or Mapping()
    scanner, catheter = np.random.default_rng((seed, 5851)).spawn(2)
    near = alongside(prior, truth) if near is None else near
    rigid = pose.frame(scanner)
    ours, theirs = _marks(prior, truth, near, rigid)
    mapped_wall = truth.with_vertices(pose.under(rigid, truth.vertices))
    found = mapped(catheter, mapped_wall, how, theirs if landmarks else {})
    onto = rigid @ _rigid_part(near, wall.body(prior)[0])
    off = pose.rough(scanner, mapped_wall.vertices.mean(axis=0))
    size = float(np.cbrt(np.linalg.det(near[:3, :3])))
    said = f"one atrium as the prior of another: seed {seed}, best scale {size:.3f}; {how}"
    return case_of(f"cross_{seed}", prior, found, ours if landmarks else off @ onto, said)


def _marks(
    prior: Surface, truth: Surface, near: Array, rigid: Array
) -> tuple[dict[str, Array], dict[str, Array]]:
    """The common places (3,) by name, in the prior's frame and in the map's."""
    ours, theirs = common_places(prior.with_vertices(pose.under(near, prior.vertices)), truth)
    back = np.asarray(np.linalg.inv(near), dtype=np.float64)
    sides = np.round(pose.under(back, ours), 3), pose.under(rigid, theirs)
    one, other = (dict(zip(NAMES, at, strict=True)) for at in sides)
    return one, other


def _rigid_part(near: Array, about: Array) -> Array:
    """A similarity without its scale, that takes a place (3,) to where the similarity does."""
    turned = near[:3, :3] / np.cbrt(np.linalg.det(near[:3, :3]))
    return pose.matrix(turned, pose.under(near, about[None])[0] - turned @ about)
