"""What only one place of the wall speaks for is no shifted part of the map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from chamber import sampled
from fields import body, wall

from o3dls.arrays import Array
from o3dls.evaluation.distances import distances
from o3dls.geometry.surface import Surface
from o3dls.motion.field.observations import Data
from o3dls.motion.fit import fit_motion
from o3dls.motion.map_shift import search
from o3dls.motion.map_shift.offset_model import Offset, OffsetModel
from o3dls.motion.map_shift.search import find_map_shift
from o3dls.motion.result import MotionFit
from o3dls.noise.shifted_part import MapPart
from o3dls.settings import with_numbers

SEED = 61_357
NOISE = 1.0  # mm
BODY, VEIN = 160, 50  # points, the vein's last
SLIP = np.array([1.0, -6.0, 5.0])  # 7.9 mm
LENGTH, WIDTH = 22.0, 0.05  # of a vein: mm, and 1 less the cosine over which it fades


def veined(surface: Surface, side: float) -> Surface:
    """The body with a vein upwards on one side (1 or -1)."""
    axis = np.array([0.55 * side, 0.0, 1.0]) / np.hypot(0.55, 1.0)
    cosine = surface.vertices @ axis / np.linalg.norm(surface.vertices, axis=1)
    height = LENGTH * np.exp(-(((1.0 - cosine) / WIDTH) ** 2))
    return surface.with_vertices(surface.vertices + height[:, None] * [0.0, 0.0, 1.0])


def shifted_after(first: int, offset: Array) -> Offset:
    """An offset of the points from one on, as it is found in closed form."""
    return Offset(MapPart(None, first - 0.5), offset, np.eye(3), 100.0)


def named(monkeypatch: pytest.MonkeyPatch, fit: MotionFit, offset: Offset, **changes: float) -> bool:
    """Whether an offset, the best in closed form, is named with some settings changed."""

    def best_offsets(model: OffsetModel, data: Data, taken_out: Offset | None = None) -> list[Offset]:
        return [offset]

    monkeypatch.setattr(search, "best_offsets", best_offsets)
    settings = with_numbers(fit.problem.settings, {f"map_shift.{name}": x for name, x in changes.items()})
    return find_map_shift(replace(fit, problem=replace(fit.problem, settings=settings))) is not None


def fitted(prior: Surface, points: Array) -> MotionFit:
    noisy = points + np.random.default_rng(SEED).normal(0.0, NOISE, points.shape)
    return fit_motion(prior.vertices, prior.faces, np.eye(4), wall(noisy))


def test_a_vein_that_the_prior_lacks_is_no_shift(monkeypatch: pytest.MonkeyPatch) -> None:
    """An offset lays its points on another vein, and explains them far better than a motion does."""
    plain = body(3, 4)
    prior = veined(plain, 1.0)
    truth = veined(prior, -1.0)
    points = sampled(truth, 2000, SEED)
    beyond = distances(points, prior) > 3.0 * NOISE
    points = np.vstack([points[~beyond][:BODY], points[beyond][:VEIN]])
    from_one_vein_to_the_other = tip(truth, prior) - tip(prior, plain)
    offset = shifted_after(BODY, from_one_vein_to_the_other)
    fit = fitted(prior, points)
    assert not named(monkeypatch, fit, offset)
    assert named(monkeypatch, fit, offset, shared=-1.0)  # nothing else stands against it


def tip(surface: Surface, without: Surface) -> Array:
    """The vertex that is farthest from a surface without it."""
    return surface.vertices[np.argmax(distances(surface.vertices, without))]


def test_a_slip_is_a_shift_without_any_one_place(monkeypatch: pytest.MonkeyPatch) -> None:
    prior = veined(body(3, 4), 1.0)
    points = sampled(prior, BODY + VEIN, SEED)
    first = len(points) // 2
    points[first:] += SLIP
    assert named(monkeypatch, fitted(prior, points), shifted_after(first, SLIP))
