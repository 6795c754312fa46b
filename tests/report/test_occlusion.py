"""The share of the light that other wall keeps from a place."""

from __future__ import annotations

import numpy as np
import pytest

from o3dls.geometry.surface import Surface
from o3dls.report.surfaces import occlusion as module
from o3dls.report.surfaces.occlusion import occlusion
from tests.tiny import sphere


def two_balls(apart: float, rings: int) -> Surface:
    ball = sphere(10.0, rings)
    faces = np.vstack([ball.faces, ball.faces + len(ball.vertices)])
    return Surface(np.vstack([ball.vertices, ball.vertices + np.array([apart, 0, 0])]), faces)


def test_a_ball_is_lit_everywhere() -> None:
    assert occlusion(sphere(10.0, 30)).max() < 0.02


@pytest.mark.parametrize("apart", [25.0, 32.0, 40.0])
def test_a_ball_before_a_place_takes_its_view_factor(apart: float) -> None:
    """It is (r / d)^2 for a ball of radius r whose middle is at d straight ahead."""
    pair = two_balls(apart, 30)
    found = occlusion(pair)
    facing = np.argmax(np.where(pair.vertices[:, 0] < 11, pair.vertices[:, 0], -np.inf))
    assert found[facing] == pytest.approx((10.0 / (apart - 10.0)) ** 2, rel=0.15)
    away = np.argmin(pair.vertices[:, 0])
    assert found[away] < 0.02


def test_many_vertices_have_about_the_values_of_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """More than RECEIVERS are not all worked out."""
    monkeypatch.setattr(module, "RECEIVERS", 5000)
    few, many = two_balls(25.0, 30), two_balls(25.0, 40)
    assert len(many.vertices) > 5000 > len(few.vertices)
    of_few, of_many = occlusion(few), occlusion(many)
    nearest = np.argmin(((few.vertices[::20, None] - many.vertices[None]) ** 2).sum(axis=2), axis=1)
    np.testing.assert_allclose(of_many[nearest], of_few[::20], atol=0.04)
