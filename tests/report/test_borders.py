"""Borders in pictures without a graphics card lead through the triangles of a wall, not along them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from o3dls.arrays import Array
from o3dls.evaluation.interpolation import REACH
from o3dls.report.drawing.fields import Field
from o3dls.report.drawing.painting import _mean_around as mean_around
from o3dls.report.drawing.painting import paint_field, soften
from o3dls.report.drawing.raster import Canvas, Pixels, View
from o3dls.report.mapping.views import in_frame
from tests.borders import SLOPE, above_border, roughness
from tests.tiny import sphere

PIXELS, SIZE = 400, 50.0  # mm
EDGE = PIXELS / SIZE * 20.0 * np.pi / 15  # pixels of an edge of the ball
BALL = sphere()
ABOVE = above_border(BALL.vertices)
HEIGHTS = BALL.vertices[:, 2] - SLOPE * BALL.vertices[:, 0]  # above a line through the middle
REGIONS = Field("region", "region", "", "regions", -0.5, 19.5)
LENGTHS = Field("length", "length", "mm", "sequential", 0.0, 1.0)


def drawn(paint: Callable[[Pixels], Array]) -> Any:
    canvas = Canvas(View(in_frame("LPS").looking(), np.zeros(3), SIZE), PIXELS, PIXELS, (1, 1, 1))
    canvas.surface(BALL, paint)
    return canvas.pixels().astype(float)


def with_field(key: str, values: Array) -> Any:
    return replace(BALL, fields={key: values})


def test_the_border_of_two_regions_is_a_line_across_triangles() -> None:
    """Blue and orange: along the triangles it would be rough by a fourth of an edge."""
    picture = drawn(paint_field(with_field("region", np.where(ABOVE, 2.0, 0.0)), REGIONS))
    within = (picture < 255).any(axis=2)
    assert roughness(picture[..., 0] > picture[..., 2], within) < 0.06 * EDGE


def test_the_border_of_wall_without_a_value_is_a_line_across_triangles() -> None:
    picture = drawn(paint_field(with_field("length", np.where(ABOVE, 1.0, np.nan)), LENGTHS))
    within = (picture < 255).any(axis=2)
    assert roughness(np.ptp(picture, axis=2) > 40, within) < 0.06 * EDGE


def test_the_end_of_the_colours_is_a_line_across_triangles() -> None:
    """A height that no colour below it tells from another: half of the ball has the darkest."""
    steep = replace(LENGTHS, low=-0.01, high=0.01)
    picture = drawn(paint_field(with_field("length", HEIGHTS), steep))
    within = (picture < 255).any(axis=2)
    assert roughness(picture[..., 0] < 90, within) < 0.02 * EDGE


def test_hatching_ends_where_the_distance_does_not_at_vertices() -> None:
    """In the rows of the hatching's lines there is grey as far as the distance is above the limit."""
    remoteness = REACH + HEIGHTS
    plain = drawn(paint_field(with_field("length", np.zeros(len(ABOVE))), LENGTHS))
    hatched = drawn(paint_field(with_field("length", np.zeros(len(ABOVE))), LENGTHS, remoteness))
    changed = np.abs(plain - hatched).max(axis=2) > 20
    rows, columns = np.nonzero(changed)
    height = (PIXELS / 2 - rows - SLOPE * (columns - PIXELS / 2)) * SIZE / PIXELS  # above the line, in mm
    assert changed.any()
    assert np.quantile(height, 0.002) > -0.8
    assert height.min() < 1.5


@pytest.mark.parametrize("columns", [1, 3])
def test_shares_of_all_classes_stay_one_in_sum(columns: int) -> None:
    shares = np.eye(columns)[np.arange(len(ABOVE)) % columns]
    softened = soften(mean_around(BALL.faces, len(ABOVE)), shares)
    np.testing.assert_allclose(softened.sum(axis=1), 1.0, atol=1e-12)
