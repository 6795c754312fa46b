"""A wall that points show is taken where other points are likelier under it, and points that may share an
error do not tell of each other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from shapes import meshed, round_distance, sampled

from o3dls.arrays import Array
from o3dls.geometry.surface import Surface
from o3dls.reconstruction.field.amplitude import amplitudes
from o3dls.reconstruction.field.equations import Oriented
from o3dls.reconstruction.field.moved_prior import MovedPrior
from o3dls.reconstruction.field.spline_fit import Scale
from o3dls.reconstruction.points.left_out import left_out_distances
from o3dls.reconstruction.points.wall_likelihood import gain_of_wall
from o3dls.reconstruction.reconstruct import oriented_by_others
from o3dls.reconstruction.settings import ReconstructionSettings

SEED, SIGMA = 141_421, 0.6
BALL = meshed(round_distance(16.0), 20.0)
SETTINGS = ReconstructionSettings()


def oriented(points: Array, surface: Surface) -> tuple[Oriented, MovedPrior, Scale]:
    """Points with normals, as a reconstruction on that prior has them before it asks for evidence."""
    count = len(points)
    prior = MovedPrior.of(surface, points, 1.0, 2.5)
    scale = Scale(16.0, float(np.sqrt(surface.area / count)), 1.0)
    wall = oriented_by_others(points, np.full(count, SIGMA), np.full(count, 0.95), prior, SETTINGS)
    return replace(wall, amplitude=amplitudes(wall, prior, scale, SETTINGS).at), prior, scale


def bulging(places: Array) -> Array:
    """Places (n, 3) of the ball, moved to a wall that is up to 2 mm farther out on one side."""
    out = 2.0 * np.exp(-((np.linalg.norm(places - [16.0, 0.0, 0.0], axis=1) / 7.0) ** 2))
    return places * (1.0 + out / np.linalg.norm(places, axis=1))[:, None]


def test_a_wall_that_is_elsewhere_is_likelier_and_one_that_follows_noise_is_not() -> None:
    points = sampled(BALL, 2000, SIGMA, SEED)
    moved = bulging(points)
    assert gain_of_wall(*_asked(moved)) > 20.0
    wall, prior, scale = oriented(points, BALL)
    follows = replace(wall, amplitude=np.full(len(points), 3.0))
    assert gain_of_wall(follows, points, prior, scale, SETTINGS) < 5.0


def _asked(points: Array) -> tuple[Oriented, Array, MovedPrior, Scale, ReconstructionSettings]:
    wall, prior, scale = oriented(points, BALL)
    return wall, points, prior, scale, SETTINGS


def test_a_crease_that_noise_rounds_is_kept() -> None:
    """Points agree on a wall that is rounder than the edge; their density does not."""
    block = meshed(lambda at: np.max(np.abs(at) - [16.0, 12.0, 8.0], axis=-1), 24.0)
    points = sampled(block, 6000, 1.5, SEED)
    count = len(points)
    prior = MovedPrior.of(block, points, 1.0, 2.5)
    scale = Scale(14.0, float(np.sqrt(block.area / count)), 1.0)
    wall = oriented_by_others(points, np.full(count, 1.5), np.full(count, 0.95), prior, SETTINGS)
    follows = replace(wall, amplitude=np.full(count, 1.0))
    assert gain_of_wall(follows, points, prior, scale, SETTINGS) < 0.0


def test_what_points_share_is_no_wall_where_they_are_known_to_share_it() -> None:
    """Each part of the ball was mapped in one go, with an offset of its own along the normal."""
    points = sampled(BALL, 1600, 0.2, SEED)
    cells = np.floor((points + 20.0) / 10.0).astype(np.int64) @ [1, 8, 64]
    stretch = np.unique(cells, return_inverse=True)[1].ravel()
    offset = np.random.default_rng(SEED).normal(size=stretch.max() + 1)[stretch]
    points = points * (1.0 + offset / np.linalg.norm(points, axis=1))[:, None]
    alone, prior, scale = oriented(points, BALL)
    told = replace(alone, stretch=stretch)
    unknown, known = (amplitudes(wall, prior, scale, SETTINGS) for wall in (alone, told))
    assert np.median(known.at) < 0.3 * np.median(unknown.at)
    assert known.gain < 0.2 * unknown.gain
    off_alone, off_told = (
        np.sqrt((left_out_distances(replace(wall, amplitude=found.at), prior, scale, SETTINGS) ** 2).mean())
        for wall, found in ((alone, unknown), (told, known))
    )
    # a part that is left out whole is not predicted by its own offset
    assert off_alone < 0.5 * offset.std() < 0.9 * offset.std() < off_told
