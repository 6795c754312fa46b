"""Thin parts of the prior that points speak against, and where they are cut off."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..arrays import Array
from ..geometry.closest_point import ClosestPoint
from ..geometry.surface import Surface
from ..levelset.grid.distance import SignedDistance, filled_distance
from ..levelset.grid.isosurface import zero_set
from ..levelset.grid.operators import linked
from .change import Change, body_radius
from .observation import Measured
from .settings import CutSettings
from .wall import Wall


def removals(wall: Wall, measured: Measured, settings: CutSettings) -> Iterator[Change]:
    """Yield cuts of thin parts of the prior that points speak against, each at the height over the body that
    gains most.
    """
    deep = _are_deep(measured, settings)
    if deep.sum() >= settings.witnesses:
        for part in parts(wall.surface, settings.balls, settings):
            if part.near(measured.points[deep]) >= settings.witnesses:
                yield from _find_cut(part, measured, settings)


def _are_deep(measured: Measured, settings: CutSettings) -> NDArray[np.bool_]:
    """Say which points (n,) are so far inside that they may tell against a part."""
    return np.asarray(
        (measured.distance < -settings.deep * measured.likelihood.sigma) & ~measured.likelihood.one_sided
    )


@dataclass(frozen=True, eq=False)
class Part:
    """A thin part has a `core` (n,), one of all that are `thin` (n,): `outside` (n,) is the distance of the
    lattice nodes from the body opened by a ball.
    """

    field: SignedDistance
    opened: ClosestPoint
    ball: float
    outside: Array
    thin: NDArray[np.bool_]
    core: NDArray[np.bool_]

    def near(self, points: Array) -> int:
        """Return how many points (k, d) inside the prior the part may have a say about."""
        reach = self.ball + self.field.band.spacing
        return int(
            np.isfinite(
                cKDTree(self.field.band.positions[self.core]).query(points, distance_upper_bound=reach)[0]
            ).sum()
        )

    def share(self) -> Array:
        """Return 1 at the nodes (n,) in the part, less over the radius of the ball around it until it is 0,
        and negative values where the part has no say: in other parts and far away. A node outside the prior
        follows the closest node inside.
        """
        inner = np.flatnonzero(self.field.phi < 0.0)
        positions = self.field.band.positions
        gap = np.asarray(cKDTree(positions[self.core]).query(positions, distance_upper_bound=self.ball)[0])
        near = np.flatnonzero(gap < np.inf)
        nearest = inner[cKDTree(positions[inner]).query(positions[near])[1]]
        share = np.full(len(positions), -1.0)
        share[near] = np.where(
            self.core[nearest], 1.0, np.where(self.thin[nearest], -1.0, 1.0 - gap[near] / self.ball)
        )
        return share


def parts(surface: Surface, balls: tuple[float, ...], settings: CutSettings) -> Iterator[Part]:
    """Yield parts that balls of several sizes cannot enter: what opening the body by a ball takes away
    (veins, appendage, handles).
    """
    radius = body_radius(surface)
    step = radius / settings.lattice
    field = filled_distance(surface.vertices, surface.faces, step, 2)
    for ball in (share * radius for share in balls):
        vertices, faces = zero_set(field.band, field.phi + ball)  # centres of the balls that fit
        if len(faces) == 0:
            continue
        opened = ClosestPoint(vertices, faces)
        outside = _distance_from_opened(opened, field.band.positions, field.phi, ball)
        thin = (field.phi < 0.0) & (outside > 0.5 * step)
        label = linked(field.band, thin)
        for piece in range(label.max() + 1):
            core = label == piece
            if outside[core].max() >= settings.sticks_out * radius:
                yield Part(field, opened, ball, outside, thin, core)


def _distance_from_opened(opened: ClosestPoint, positions: Array, phi: Array, ball: float) -> Array:
    """Return the signed distance from the opened body: that of the centres of fitting balls, less the ball's
    radius. Deep inside it is the old distance.
    """
    outside = phi.copy()
    shallow = phi >= -ball
    outside[shallow] = opened.distance(positions[shallow]) - ball
    return outside


def _find_cut(part: Part, measured: Measured, settings: CutSettings) -> Iterator[Change]:
    """Yield the part cut off at its best height above the opened body, if points show a wall there."""
    likelihood = measured.likelihood
    distance = measured.distance
    band = part.field.band
    sigma = float(np.median(likelihood.sigma))
    node = cKDTree(band.positions).query(measured.points)[1]
    shares = part.share()
    share = shares[node]
    outside = _distance_from_opened(part.opened, measured.points, part.field.phi[node], part.ball)
    before = likelihood.loss(distance - measured.bias)
    best = np.zeros(len(distance))
    height = 0.0
    for trial in np.arange(-part.ball, part.outside[part.core].max() - sigma, settings.trial_step * sigma):
        above = outside - _cut_level(trial, share)
        gain = np.where(share > 0.0, before - likelihood.loss(np.maximum(distance, above)), 0.0)
        if gain.sum() > best.sum():
            best = gain
            height = float(trial)
    witnesses = int((best > settings.telling).sum())
    deep = _are_deep(measured, settings) & (share > 0.0)
    near = (
        np.abs(np.maximum(distance, outside - _cut_level(height, share))[deep])
        < settings.deep * likelihood.sigma[deep]
    )
    if witnesses < settings.witnesses or near.sum() < settings.witnesses:
        return
    above = np.where(shares > 0.0, part.outside - _cut_level(height, shares), -band.spacing)
    lost = part.core & (above > 0.0)
    region = zero_set(*band.whole(-above, band.spacing))
    yield Change(
        True,
        region,
        float(best.sum()),
        0.0,
        0.0,
        witnesses,
        measured.points[deep],
        band.positions[lost].mean(axis=0),
    )


def _cut_level(height: float, share: Array) -> Array:
    """Return where the cut runs over the part: at its height, but where it cuts into the body, it rises to
    the body's wall around the part.
    """
    return height * share if height < 0.0 else np.full(len(share), height)
