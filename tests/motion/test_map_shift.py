"""One part of a map is shifted: which part, by what offset; and that no motion is taken for one."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import replace

import numpy as np
import pytest
from chamber import sampled
from fields import SIZE, bend, body

from o3dls.arrays import Array
from o3dls.geometry.surface import Surface
from o3dls.motion.field.observations import Data
from o3dls.motion.fit import fit_motion
from o3dls.motion.map_shift import search
from o3dls.motion.map_shift.offset_model import Offset, OffsetModel
from o3dls.motion.map_shift.search import find_map_shift
from o3dls.motion.problem import MotionProblem
from o3dls.motion.result import MotionFit
from o3dls.noise.shifted_part import MapPart, MapShift
from o3dls.settings import with_numbers

NOISE = 1.0
OFFSET = np.array([1.0, -6.0, 5.0])  # 7.9 mm


def moved_body(dimension: int = 3) -> Surface:
    """The body after a motion."""
    surface = body(dimension)
    return surface.with_vertices(surface.vertices + bend(surface, 71_191))


def fitted(points: Array, marks: Array | None = None, marks_map: Array | None = None) -> MotionFit:
    surface = body(points.shape[1])
    none = np.zeros((0, points.shape[1]))
    data = Data(
        points=points,
        group=np.zeros(len(points), dtype=np.int64),
        relative=np.ones(len(points)),
        odds=np.ones(len(points)),
        inside=np.zeros(len(points), dtype=bool),
        marks_prior=none if marks is None else marks,
        marks_map=none if marks_map is None else marks_map,
    )
    return fit_motion(surface.vertices, surface.faces, np.eye(points.shape[1] + 1), data)


def found(fit: MotionFit) -> MapShift | None:
    """The shift alone."""
    shift = find_map_shift(fit)
    return shift and shift[0]


def within(shift: MapShift, offset: Array, sds: float = 3.0) -> bool:
    """Whether an offset is the true one, by its own standard deviation: three of them hold nearly always."""
    return bool((np.abs(shift.offset - offset) < sds * shift.sd).all())


def test_points_taken_after_a_slip_are_found_with_their_offset() -> None:
    points = sampled(moved_body(), 160, 8_837, NOISE)
    points[100:] += OFFSET
    shift = found(fitted(points))
    assert shift is not None
    assert shift.part.direction is None
    # a few points on either side may be so little off the wall that they fit both
    assert abs(shift.points - 60) <= 3
    assert within(shift, OFFSET)
    assert np.linalg.norm(shift.offset - OFFSET) < 2.0 * NOISE


def test_one_side_of_a_plane_is_found_with_its_offset() -> None:
    points = sampled(moved_body(), 300, 8_839, NOISE)
    beyond = points[:, 0] > np.quantile(points[:, 0], 0.6)
    points[beyond] += OFFSET
    shift = found(fitted(points))
    assert shift is not None
    assert shift.part.direction is not None
    held = shift.part.holds(points, np.arange(300.0))
    assert (held != beyond).mean() < 0.05
    assert within(shift, OFFSET)


def test_offsets_by_a_plane_that_cannot_stand_out_take_no_rivals_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The best one in closed form is made shorter than any that may be named, or than the motion."""
    points = sampled(moved_body(), 300, 8_839, NOISE)
    points[points[:, 0] > np.quantile(points[:, 0], 0.6)] += OFFSET
    fit = fitted(points)
    offsets, settled = search.best_offsets, search._settle_offset
    tried: list[float] = []

    def with_short_one(model: OffsetModel, data: Data, taken_out: Offset | None = None) -> list[Offset]:
        best, *others = offsets(model, data, taken_out)
        short = best._replace(offset=0.14 * SIZE * best.offset / best.length)
        return [best, *others] if taken_out else [short, best, *others]

    def recorded(problem: MotionProblem, data: Data, one: Offset, alone: Future[float]) -> search.Trial:
        tried.append(one.length)
        return settled(problem, data, one, alone)

    monkeypatch.setattr(search, "best_offsets", with_short_one)
    monkeypatch.setattr(search, "_settle_offset", recorded)
    for asked, named in (({"map_shift.rivals": 1}, True), ({"map_shift.first_over_motion": 9.0}, False)):
        tried.clear()
        settings = with_numbers(fit.problem.settings, asked)
        shift = found(replace(fit, problem=replace(fit.problem, settings=settings)))
        assert (shift is not None, len(tried)) == (named, int(named))
        assert all(length > 0.15 * SIZE for length in tried)


def test_one_side_of_a_small_map_is_not_told_from_another_anatomy() -> None:
    """The same step in 120 points, fewer than are asked; with the limit below them it is found."""
    points = sampled(moved_body(), 120, 8_839, NOISE)
    points[points[:, 0] > np.quantile(points[:, 0], 0.6)] += OFFSET
    fit = fitted(points)
    assert found(fit) is None
    asked = with_numbers(fit.problem.settings, {"map_shift.least_points": 100})
    shift = found(replace(fit, problem=replace(fit.problem, settings=asked)))
    assert shift is not None
    assert shift.part.direction is not None


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", [8_861, 8_863, 8_867])
def test_a_motion_is_no_shifted_part(dimension: int, seed: int) -> None:
    assert found(fitted(sampled(moved_body(dimension), 160, seed, NOISE))) is None


def test_landmarks_tell_which_side_stayed() -> None:
    truth, prior = moved_body(), body(3)
    points = sampled(truth, 300, 8_839, NOISE)
    beyond = points[:, 0] > np.quantile(points[:, 0], 0.4)  # the larger part
    points[beyond] += OFFSET
    rows = np.linspace(0, len(prior.vertices) - 1, 6).astype(int)
    shift = found(fitted(points, prior.vertices[rows], truth.vertices[rows]))
    assert shift is not None
    assert (shift.part.holds(points, np.arange(300.0)) != beyond).mean() < 0.05
    assert within(shift, OFFSET)
    assert not shift.part.holds_marks(truth.vertices[rows]).any()


def test_of_many_points_a_part_tells_the_same() -> None:
    points = sampled(moved_body(), 700, 8_887, NOISE)
    points[400:] += OFFSET
    shift = found(fitted(points))
    assert shift is not None
    assert shift.part.direction is None
    assert abs(shift.points - 300) <= 10  # every second point was asked
    assert within(shift, OFFSET)


def test_the_other_side_is_the_same_shift() -> None:
    rng = np.random.default_rng(8_893)
    points, order = rng.normal(size=(50, 3)), np.arange(50.0)
    marks = np.arange(50) % 10 == 0
    part = MapPart(np.array([1.0, 0.0, 0.0]), 0.2, "part")
    shift = MapShift(part, OFFSET, np.ones(3), 20.0, int(part.holds(points, order).sum()), 50)
    one = shift.without(points, order, marks)
    other = shift.other_side().without(points, order, marks)
    np.testing.assert_allclose(other - one, np.broadcast_to(OFFSET, (50, 3)))
    assert shift.points + shift.other_side().points == 50


@pytest.mark.parametrize("landmarks", ["stay", "move"])
def test_landmarks_go_along_or_not(landmarks: str) -> None:
    points = np.zeros((4, 3))
    marks = np.array([False, False, False, True])
    part = MapPart(None, 1.5, landmarks)  # type: ignore[arg-type]
    shift = MapShift(part, OFFSET, np.ones(3), 20.0, 1, 3)
    moved = shift.without(points, np.arange(4.0), marks)
    np.testing.assert_array_equal(moved[:3], [np.zeros(3), np.zeros(3), -OFFSET])
    np.testing.assert_array_equal(moved[3], -OFFSET if landmarks == "move" else np.zeros(3))


def test_the_sentence_names_points_offset_and_direction() -> None:
    shift = MapShift(MapPart(None, 124.5), np.array([0.0, 6.0, 8.0]), np.full(3, 0.5), 31.2, 125, 250)
    said = shift.sentence("mm")
    assert "125 of 250 points, those taken from point 126 of the file on" in said
    assert "10.0 mm off the others, along (0.00, 0.60, 0.80)" in said
    assert "offset (0.0, 6.0, 8.0) ± 0.5 mm" in said
    plane = replace(shift, part=MapPart(np.array([1.0, 0.0, 0.0]), -5.04))
    assert "beyond the plane (1.00, 0.00, 0.00)·x = -5.0 mm" in plane.sentence("mm")


def test_a_shift_that_is_no_longer_than_motions_are_is_not_named() -> None:
    points = sampled(moved_body(), 160, 8_837, NOISE)
    points[100:] += 0.1 * SIZE * OFFSET / np.linalg.norm(OFFSET)
    shift = found(fitted(points))
    assert shift is None or np.linalg.norm(shift.offset) > 0.15 * SIZE
