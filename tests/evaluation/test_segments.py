"""Openings of an atrium are found and named, its wall is divided, and places have coordinates."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from o3dls.arrays import Array
from o3dls.errors import InputError
from o3dls.evaluation.segments.coordinates import AtrialCoordinates, carry_field, find_coordinates
from o3dls.evaluation.segments.division import SEGMENTS, VALVE, Division, divide
from o3dls.evaluation.segments.flattening import flatten
from o3dls.evaluation.segments.naming import TEMPLATE, VALVE_NORMAL
from o3dls.evaluation.segments.openings import Openings, find_openings
from o3dls.evaluation.segments.tubes import CREASED
from o3dls.evaluation.wall_graph import cut_apart
from o3dls.geometry.similarity import apply
from o3dls.geometry.surface import Surface
from tests.chamber import pose
from tests.shapes import meshed
from tests.tiny import sphere

LPS = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, 1]])  # left, front, up
OPENINGS = ("LSPV", "LIPV", "RSPV", "RIPV", "LAA")


def outward(name: str) -> Array:
    """Where an opening is, from the middle, in LPS."""
    way = np.array(TEMPLATE.get(name, VALVE_NORMAL)) @ LPS
    return way / np.linalg.norm(way)


@lru_cache
def atrium(stretch: float = 1.0) -> Surface:
    """A ball with five tubes and a flat valve, some 7 000 triangles."""
    ball = sphere(1.0, 60)
    radius = 22.0 * np.ones(len(ball.vertices))
    for name in OPENINGS:
        radius += 16.0 * np.exp(-(((1.0 - ball.vertices @ outward(name)) / 0.035) ** 2))
    height = ball.vertices @ outward("MA")
    radius = np.minimum(radius, 17.0 / np.maximum(height, 0.1))
    return ball.with_vertices(ball.vertices * radius[:, None] * [1.2 * stretch, 1.0, 1.0])


@lru_cache
def divided(stretch: float = 1.0) -> tuple[Openings, Division, AtrialCoordinates]:
    surface = atrium(stretch)
    openings = find_openings(surface, axes=LPS)
    division = divide(surface, openings)
    return openings, division, find_coordinates(surface, openings, division)


def middles() -> dict[int, Array]:
    surface, segment = atrium(), divided()[1].segment
    return {k: surface.vertices[segment == k].mean(axis=0) @ LPS.T for k in SEGMENTS}


def dice(surface: Surface, a: Array, b: Array) -> list[float]:
    area = surface.vertex_areas
    return [2 * area @ ((a == k) & (b == k)) / (area @ (a == k) + area @ (b == k)) for k in SEGMENTS]


@pytest.mark.parametrize("degrees", [0.0, 70.0, 175.0])
def test_openings_are_named_however_the_atrium_lies(degrees: float) -> None:
    T = pose(degrees, 30.0)
    openings = find_openings(atrium().transformed(T))
    assert sorted(openings.tubes) == sorted(OPENINGS)
    for name, at in openings.landmarks().items():
        way = apply(np.linalg.inv(T), at[None])[0]
        assert way @ outward(name) > 0.85 * np.linalg.norm(way), name
    turned = LPS @ T[:3, :3].T
    assert np.trace(openings.axes @ turned.T) > 2.8  # within 26 degrees


def test_a_landmark_names_its_tube() -> None:
    found = find_openings(atrium(), {"left superior pulmonary vein": 30.0 * outward("LIPV")}, LPS)
    assert found.tubes["LSPV"].mouth @ outward("LIPV") > 0.9 * np.linalg.norm(found.tubes["LSPV"].mouth)


def test_a_vein_that_was_cut_where_it_begins_is_where_its_landmark_is() -> None:
    at = 22.0 * np.array([0.7, 0.5, -0.65])
    marks = divided()[0].landmarks()
    found = find_openings(atrium(), marks | {"LIPV": at}, LPS)
    nearest = np.linalg.norm(atrium().vertices - at, axis=1).argmin()
    assert found.tubes["LIPV"].inside[nearest]
    assert not np.any([tube.inside[nearest] for tube in divided()[0].tubes.values()])


def test_tubes_that_touch_are_parted_where_they_do() -> None:
    """The far end of a long tube is nearer to the mouth of a short one, which touches it in its middle."""

    def distance(points: Array) -> Array:
        height = np.clip(points[:, 2], -14.0, 14.0)
        long = np.linalg.norm(points - height[:, None] * [0.0, 0.0, 1.0], axis=1) - 4.0
        along = np.clip(points[:, 0], 7.5, 12.0)
        short = np.linalg.norm(points - along[:, None] * [1.0, 0.0, 0.0], axis=1) - 4.0
        return np.minimum(long, short)

    surface = meshed(distance, 20.0)
    at = surface.vertices
    first, cost = cut_apart(surface, np.ones(len(at), dtype=bool), at[:, 2] < -15.0, at[:, 0] > 14.0)
    assert cost < CREASED
    true = np.hypot(at[:, 0], at[:, 1]) < 4.2
    assert first[at[:, 2] > 8.0].all()
    assert (first == true)[surface.vertices[:, 0] < 3.0].all()
    assert (first != true).mean() < 0.02


def test_no_crease_parts_the_ends_of_one_tube() -> None:
    """A bent tube, as a vein whose tip touches the chamber: the cheapest cut is across it, somewhere."""

    def distance(points: Array) -> Array:
        angle = np.arctan2(np.maximum(points[:, 2], 0.0), points[:, 0])  # its ends are at z = 0
        middle = 14.0 * np.column_stack([np.cos(angle), np.zeros(len(angle)), np.sin(angle)])
        return np.asarray(np.linalg.norm(points - middle, axis=1) - 5.0)

    surface = meshed(distance, 22.0)
    low = surface.vertices[:, 2] < 0.0
    right = surface.vertices[:, 0] > 0.0
    _, cost = cut_apart(surface, np.ones(len(low), dtype=bool), low & right, low & ~right)
    assert cost > CREASED


def test_what_has_no_veins_is_no_atrium() -> None:
    with pytest.raises(InputError, match="no pulmonary veins were found on both sides"):
        find_openings(sphere(25.0, 30))


def test_segments_lie_where_anatomy_has_them() -> None:
    at = middles()
    left, front, up = np.array([at[k] for k in SEGMENTS]).T
    assert left.argmax() in (1, 5)
    assert left.argmin() == 2
    assert left[6] > left[[3, 4, 7, 8]].max()  # lateral
    assert left[8] < left[[3, 4, 6, 7]].min()  # septal
    assert front[3] < front[4]  # dome behind the anterior wall
    assert up[7] == up[3:].min()  # inferior
    assert up[3] > up[7]


def test_every_vertex_has_a_segment_and_all_segments_are_there() -> None:
    assert set(divided()[1].segment.tolist()) == set(SEGMENTS)


def test_segments_stay_when_landmarks_move_by_two_millimetres() -> None:
    openings, division, _ = divided()
    rng = np.random.default_rng(61_205)
    moved = {name: at + rng.normal(0, 2 / np.sqrt(3), 3) for name, at in openings.landmarks().items()}
    again = divide(atrium(), find_openings(atrium(), moved, LPS)).segment
    assert min(dice(atrium(), division.segment, again)) > 0.93


def test_placed_letters_are_followed() -> None:
    openings, division, _ = divided()
    lower = division.places["E"] + [0.0, 0.0, -8.0]
    again = divide(atrium(), openings, {"E": lower})
    assert np.linalg.norm(again.places["E"] - lower) < np.linalg.norm(division.places["E"] - lower)
    assert (again.segment == 8).sum() != (division.segment == 8).sum()


def test_coordinates_lead_back_to_each_place() -> None:
    found = divided()[2]
    assert ((found.sheet < 0) <= (divided()[1].segment == VALVE)).all()  # none in the valve
    known = found.sheet >= 0
    back = found.places(found.alpha, found.beta, found.sheet)
    assert np.abs(back - atrium().vertices)[known].max() < 1e-6
    for field in (found.alpha[known], found.beta[known]):
        assert field.min() >= -1e-12
        assert field.max() <= 1.0 + 1e-12


def test_alpha_goes_to_the_left_and_beta_to_the_front() -> None:
    found, segment = divided()[2], divided()[1].segment
    alpha, beta = ({k: field[segment == k].mean() for k in SEGMENTS} for field in (found.alpha, found.beta))
    assert alpha[8] < 0.4 < 0.6 < alpha[6]
    assert beta[7] < beta[3] < beta[4]


def test_a_field_is_carried_to_another_heart() -> None:
    source, target = divided()[2], divided(1.15)[2]
    way = source.surface.vertices / np.linalg.norm(source.surface.vertices, axis=1)[:, None]
    carried = carry_field(way, source, target)
    known = np.isfinite(carried).all(axis=1)
    assert (known == (target.sheet >= 0)).all()
    # the same vertices lie in the same directions but for the stretch
    assert np.median((carried * way).sum(axis=1)[known]) > 0.98
    np.testing.assert_allclose(
        carry_field(way, source, source)[source.sheet >= 0], way[source.sheet >= 0], atol=1e-9
    )


def test_a_sheet_that_the_other_heart_lacks_has_no_values() -> None:
    source, target = divided()[2], divided(1.15)[2]
    without = AtrialCoordinates(source.surface, source.alpha, source.beta, source.sheet, {0: source.flat[0]})
    carried = carry_field(np.ones(len(source.alpha)), without, target)
    assert np.isnan(carried[target.sheet == 5]).all()
    np.testing.assert_allclose(carried[target.sheet == 0], 1.0)


def torus(around: int = 24, across: int = 12) -> Surface:
    u, v = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = 2 * np.pi * u / around, 2 * np.pi * v / across
    at = np.stack([(3 + np.cos(b)) * np.cos(a), (3 + np.cos(b)) * np.sin(a), np.sin(b)], axis=-1)
    one, right = u * across + v, (u + 1) % around * across + v
    up, both = u * across + (v + 1) % across, (u + 1) % around * across + (v + 1) % across
    faces = np.concatenate([np.stack([one, right, both], -1), np.stack([one, both, up], -1)])
    return Surface(at.reshape(-1, 3), faces.reshape(-1, 3))


def test_a_handle_is_cut_open_and_lies_flat() -> None:
    surface = torus()
    middle = surface.vertices[surface.faces].mean(axis=1)
    kept = surface.faces[np.linalg.norm(middle - [4, 0, 0], axis=1) > 1.0]
    rim = [(np.array([4.0, y, 0.0]), angle) for y, angle in ((1.0, 0.0), (-1.0, np.pi))]
    flat = flatten(surface, kept, rim, np.zeros(len(surface.vertices)))
    a, b, c = np.moveaxis(flat.places[flat.faces], 1, 0)
    areas = np.linalg.det(np.stack([b - a, c - a], axis=1))
    assert (areas > 0).all() or (areas < 0).all()
    np.testing.assert_array_equal(np.sort(flat.origin[flat.faces], axis=1), np.sort(kept, axis=1))
