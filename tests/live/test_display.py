"""What pages see of an estimate: the prior with few faces, moved as the estimate moves it."""

from __future__ import annotations

import base64
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from o3dls.arrays import Array
from o3dls.case import Case, Points
from o3dls.errors import InputError
from o3dls.estimate import Estimate
from o3dls.geometry.similarity import similarity
from o3dls.io.case_reader import read_case
from o3dls.live.display import FACES, Display, landmarks
from o3dls.resources import demo_case
from tests.finished import Bulge
from tests.tiny import sphere

POSE = similarity(np.eye(3), np.array([100.0, -50.0, 20.0]))
CODE = 0.5 / 65535  # of the box: positions travel in 16 bits


def case_with(points: Array, marks: dict[str, Array] | None = None) -> Case:
    marks = marks or {}
    xyz = np.vstack([points, *marks.values()])
    kind = np.array(["eam"] * len(points) + ["landmark"] * len(marks))
    names = np.array([""] * len(points) + list(marks))
    prior = sphere(rings=60)
    return Case("ball", prior, Points(xyz, kind, {"name": names}), {"LSPV": np.array([0.0, 20.0, 0.0])})


def bulged(case: Case) -> Estimate:
    motion = Bulge(POSE, 3.0)
    surface = replace(
        case.prior,
        vertices=motion(case.prior.vertices),
        fields={"sd_mm": case.prior.vertices[:, 0] + 25.0},
    )
    return Estimate(surface, POSE, "fitted", motion=motion, sigma=0.5)


def positions(text: str, box: dict[str, list[float]]) -> Array:
    codes = np.frombuffer(base64.b64decode(text), dtype="<u2").reshape(-1, 3)
    return np.asarray(box["low"]) + codes / 65535 * np.asarray(box["size"])


def values(field: dict[str, Any]) -> Array:
    codes = np.frombuffer(base64.b64decode(field["data"]), dtype="<u2")
    return np.where(codes == 65535, np.nan, field["low"] + codes / 65534 * (field["high"] - field["low"]))


POINTS = np.array([[120.0, -50.0, 20.0], [100.0, -30.0, 20.0]])


def test_a_large_prior_is_drawn_with_few_faces_and_moves_as_the_estimate() -> None:
    case = case_with(POINTS)
    assert len(case.prior.faces) > FACES
    display = Display(case.prior)
    started = display.scene(case, bulged(case))
    moved = display.surface(case, bulged(case), after=2)
    faces = len(base64.b64decode(started["scene"]["arrays"][started["scene"]["meshes"][0]["faces"]])) // 6
    assert 0.9 * FACES < faces <= FACES
    rest = positions(started["scene"]["prior"]["positions"], started["scene"]["prior"]["box"])
    expected = Bulge(POSE, 3.0)(rest)
    edge = 2.0  # mm: a vertex lies between the prior's, beside whose chord its own motion takes it
    slack = 3.0 / 20.0 * edge + 2 * CODE * 40.0 + 0.02  # the bulge's slope over an edge, and the flat faces
    assert np.abs(positions(moved["positions"], moved["box"]) - expected).max() < slack
    assert moved["of"] == started["id"]
    assert moved["after"] == 2


def test_the_fields_are_those_that_tell_what_is_known() -> None:
    case = case_with(POINTS)
    display = Display(case.prior)
    started = display.scene(case, bulged(case))
    keys = [field["key"] for field in started["scene"]["fields"]]
    assert keys[:2] == ["sd_mm", "distance_to_nearest_point_mm"]
    moved = display.surface(case, bulged(case), after=2)
    at = positions(moved["positions"], moved["box"])
    gaps = np.linalg.norm(at[:, None] - POINTS, axis=2).min(axis=1)
    assert np.allclose(values(moved["fields"]["distance_to_nearest_point_mm"]), gaps, atol=0.005)
    rest = positions(started["scene"]["prior"]["positions"], started["scene"]["prior"]["box"])
    assert np.allclose(values(moved["fields"]["sd_mm"]), rest[:, 0] + 25.0, atol=0.1)  # linear over faces


def test_without_points_no_distance_is_claimed() -> None:
    case = case_with(np.zeros((0, 3)))
    moved = Display(case.prior).surface(case, bulged(case), after=0)
    assert np.isnan(values(moved["fields"]["distance_to_nearest_point_mm"])).all()


def test_before_a_pose_the_prior_stands_in_its_own_frame_and_says_so() -> None:
    case = case_with(np.zeros((0, 3)))
    found = Display(case.prior).scene(case, None)
    assert found["posed"] is False
    mesh = found["scene"]["meshes"][0]
    shown = positions(found["scene"]["arrays"][mesh["positions"]], found["scene"]["box"])
    rest = positions(found["scene"]["prior"]["positions"], found["scene"]["prior"]["box"])
    assert np.abs(shown - rest).max() < 4 * CODE * 40.0


def test_before_a_pose_nothing_of_the_map_tells_what_is_where_on_the_prior() -> None:
    marks = {"RSPV": np.array([500.0, 0.0, 0.0]), "LSPV": np.array([600.0, 0.0, 0.0])}
    case = replace(case_with(POINTS, marks), frame="LPS")
    found = Display(case.prior).scene(case, None)["scene"]
    assert found["landmarks"] == []
    assert "prior" in found["viewsBy"]
    assert max(np.abs(found["box"]["low"])) < 25.0  # the box of the prior alone


def test_a_new_scene_has_a_new_name() -> None:
    case = case_with(POINTS)
    display = Display(case.prior)
    assert display.scene(case, None)["id"] != display.scene(case, bulged(case))["id"]


def test_a_surface_with_other_faces_is_refused() -> None:
    case = case_with(POINTS)
    other = replace(bulged(case), surface=sphere(rings=10))
    with pytest.raises(InputError, match="other faces than the prior"):
        Display(case.prior).surface(case, other, after=1)


def test_landmarks_say_which_side_has_them() -> None:
    case = case_with(POINTS, {"RSPV": np.array([1.0, 2.0, 3.0])})
    before = landmarks(case, None)
    assert before[0] == {"name": "LSPV", "prior": True, "map": False, "at": [0.0, 20.0, 0.0]}
    assert before[1] == {"name": "RSPV", "prior": False, "map": True, "at": None}
    after = {one["name"]: one["at"] for one in landmarks(case, bulged(case))}
    assert np.allclose(after["LSPV"], [100.0, -30.0, 20.0])
    assert after["RSPV"] == [1.0, 2.0, 3.0]


def test_a_landmark_of_both_sides_stands_where_it_was_marked() -> None:
    case = case_with(POINTS, {"LSPV": np.array([101.0, -29.0, 20.0])})
    assert landmarks(case, bulged(case)) == [
        {"name": "LSPV", "prior": True, "map": True, "at": [101.0, -29.0, 20.0]}
    ]


def test_the_first_picture_waits_for_nothing_that_takes_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page is blank until it has come: neither compiled loops nor the libraries of meshes are needed."""

    def refused(*_: object, **__: object) -> None:
        raise AssertionError("the first picture needs none of it")

    monkeypatch.setattr("o3dls.live.display.ClosestPoint", refused)
    monkeypatch.setattr("o3dls.report.surfaces.display.reduced", refused)
    case = read_case(demo_case())  # as many faces as an atrium has
    assert Display(case.prior).scene(case, None)["posed"] is False
