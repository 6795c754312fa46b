"""Regions of the wall: sides by the patient's axes, openings by their landmarks."""

from __future__ import annotations

import numpy as np
import pytest

from o3dls.arrays import Array
from o3dls.evaluation.regions import REGIONS, regions, unvisited, valve_of, word
from o3dls.geometry.similarity import apply, similarity
from o3dls.geometry.surface import Surface
from tests.chamber import APPENDAGE, VEINS, chamber, tips
from tests.tiny import sphere

AXES = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, 1]])  # of LPS: left, front, up
FAR = {
    "LSPV": np.array([90.0, 0, 0]),
    "RSPV": np.array([-90.0, 0, 0]),
}  # off the surface, so that it has sides


def names(of: Array | None) -> list[str]:
    assert of is not None
    return [REGIONS[int(k)] for k in of]


@pytest.mark.parametrize(
    ("way", "side"),
    [
        ((1, 0, 0), "lateral"),
        ((-1, 0, 0), "septal"),
        ((0, -1, 0), "anterior"),
        ((0, 1, 0), "posterior"),
        ((0, 0, 1), "roof"),
        ((0, 0, -1), "floor"),
    ],
)
def test_a_ball_has_six_sides(way: tuple[int, int, int], side: str) -> None:
    ball = sphere()
    found = names(regions(ball, AXES, FAR))
    assert found[int((ball.vertices @ np.array(way)).argmax())] == side
    assert set(found) == set(REGIONS[:6])


def test_a_flat_chamber_has_sides_of_a_flat_chamber() -> None:
    """What is near in mm is far in a direction in which the chamber is thin."""
    ball = sphere()
    flat = ball.with_vertices(ball.vertices * [1.5, 0.5, 1.0])
    pairs = zip(names(regions(flat, AXES, FAR)), names(regions(ball, AXES, FAR)), strict=True)
    # areas weigh the broad sides of a flat chamber more, which moves borders a little
    assert np.mean([a == b for a, b in pairs]) > 0.8


def test_openings_are_where_their_landmarks_are() -> None:
    surface = chamber()
    marks = {name: 0.75 * at for name, at in tips(surface).items()}  # the ostium, before the tip
    marks["Left atrial appendage"] = 18.0 * np.array(APPENDAGE)
    found = names(regions(surface, AXES, marks))
    for name, at in tips(surface).items():
        assert found[int(np.linalg.norm(surface.vertices - at, axis=1).argmin())] == name
    assert found[int((surface.vertices @ np.array(APPENDAGE)).argmax())] == "LAA"
    assert {"roof", "posterior", "floor", "anterior"} < set(found)


def test_regions_turn_with_the_patient() -> None:
    surface, marks = chamber(20), tips(chamber(20))
    T = similarity(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([30.0, -8, 5]))
    moved = {name: apply(T, at[None])[0] for name, at in marks.items()}
    turned = regions(surface.transformed(T), AXES @ T[:3, :3].T, moved)
    assert names(turned) == names(regions(surface, AXES, marks))


@pytest.mark.parametrize("kept", [(), ("LSPV", "LIPV"), ("RSPV",)])
def test_without_veins_of_both_sides_nothing_says_that_it_is_a_left_atrium(kept: tuple[str, ...]) -> None:
    surface = chamber(20)
    marks = {name: at for name, at in tips(surface).items() if name in kept}
    assert regions(surface, AXES, marks | {"apex": np.zeros(3)}) is None


def test_regions_have_words() -> None:
    assert [word(REGIONS.index(name)) for name in ("roof", "LSPV", "LAA", "MA")] == [
        "roof",
        "ostium LSPV",
        "appendage",
        "mitral annulus",
    ]


def test_a_bent_vein_is_one_part_wherever_its_landmark_is() -> None:
    """The landmark at the tip or at the ostium; the cone of it alone reaches neither other end."""
    surface, axis = bent_vein()
    tip = surface.vertices[int(surface.vertices[:, 2].argmax())]
    others = {"LIPV": np.array([60.0, 30, -40]), "RIPV": np.array([-60.0, 30, -40])}
    for at in (tip, axis):
        found = np.array(names(regions(surface, AXES, others | {"RSPV": at})))
        vein = (surface.vertices[:, 2] > 12.0) & (surface.vertices[:, 0] < -26.0)
        assert vein.sum() > 30
        assert set(found[vein]) == {"RSPV"}
        assert (found == "RSPV").mean() < 0.5


def test_a_tube_that_no_landmark_names_is_no_side_of_the_chamber() -> None:
    surface, _ = bent_vein()
    marks = {"LIPV": np.array([60.0, 30, -40]), "RIPV": np.array([-60.0, 30, -40])}
    found = np.array(names(regions(surface, AXES, marks)))
    assert found[int(surface.vertices[:, 2].argmax())] == "tube"
    assert set(found) == {*REGIONS[:6], "tube"}


def test_the_valve_is_where_its_landmark_is_and_no_vein_is_taken_for_it() -> None:
    surface = chamber()
    at = np.array([0.0, -18.0, 0.0])
    valve = valve_of(surface, {"mitral valve": at})
    assert valve.any()
    assert np.linalg.norm(surface.vertices[valve] - at, axis=1).max() < 20.0
    assert not valve_of(surface, {"LSPV": at}).any()


def test_a_vein_without_a_point_is_unvisited() -> None:
    surface, marks = chamber(), tips(chamber())
    seen = surface.vertices[(surface.vertices @ np.array(VEINS["LSPV"])) < 10.0]
    parts = unvisited(surface, marks, seen)
    at = int(np.linalg.norm(surface.vertices - marks["LSPV"], axis=1).argmin())
    assert [bool(part[at]) for part in parts] == [True]
    assert unvisited(surface, marks, surface.vertices) == []


def bent_vein() -> tuple[Surface, Array]:
    """A ball with a long tube that leaves it to the right and turns upwards, and where the tube begins."""
    ball = sphere(20.0, 60)
    x, y, z = ball.vertices.T
    way = np.clip((-x - 18.0) / 2.0, 0.0, 1.0) * (np.hypot(y, z) < 9.0)
    along = 30.0 * way**2
    return ball.with_vertices(
        np.column_stack([x - np.minimum(along, 15.0), y, z + np.maximum(along - 10.0, 0.0)])
    ), np.array([-22.0, 0, 0])
