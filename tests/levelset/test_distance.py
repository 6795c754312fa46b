"""Signed distance on a band: exact, right in sign, even in what it costs; and what a mesh must be for it."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import circle, round_distance, torus, torus_distance
from tiny import sphere

from o3dls.errors import InputError
from o3dls.geometry.closest_point import ClosestPoint
from o3dls.geometry.surface import Surface, outline
from o3dls.levelset.grid.distance import filled_distance, signed_distance

FLOAT32 = 2e-6  # rounding of distances of a few spacings kept in single precision


@pytest.mark.parametrize("surface", [circle(count=60), sphere(), torus()], ids=["2D", "sphere", "torus"])
def test_scatter_is_the_closest_point_of_all_faces(surface: Surface) -> None:
    field = signed_distance(surface.vertices, surface.faces, 1.0, 3.0)
    gap = ClosestPoint(surface.vertices, surface.faces).distance(field.band.positions)
    np.testing.assert_allclose(np.abs(field.phi), gap, atol=FLOAT32)
    corners = surface.vertices[surface.faces[field.face[:50]]]
    for point, corner, gap in zip(field.band.positions, corners, np.abs(field.phi), strict=False):
        single = Surface(corner, np.arange(surface.dimension)[None])
        assert ClosestPoint(single.vertices, single.faces).distance(point[None])[0] == pytest.approx(
            gap, abs=FLOAT32
        )


@pytest.mark.parametrize("spacing", [0.7, 1.0])
def test_band_holds_every_node_within_its_width_and_none_beyond(spacing: float) -> None:
    surface = torus()
    width = 2.5
    band = signed_distance(surface.vertices, surface.faces, spacing, width).band
    every = np.indices(band.shape).reshape(3, -1).T
    near = ClosestPoint(surface.vertices, surface.faces).distance((every + band.low) * spacing) <= width
    assert (band.keys == np.flatnonzero(near)).all()
    assert (band.find(every[near]) == np.arange(len(band))).all()
    assert (band.find(every[~near]) == -1).all()


@pytest.mark.parametrize(
    ("surface", "exact"), [(circle(), round_distance()), (torus(), torus_distance())], ids=["circle", "torus"]
)
def test_sign_and_value_against_the_analytic_shape(surface: Surface, exact) -> None:  # type: ignore[no-untyped-def]
    field = signed_distance(surface.vertices, surface.faces, 0.8, 2.4)
    chord = 0.05 if surface.dimension == 3 else 1e-4  # how far the facets lie inside the curved shape
    np.testing.assert_allclose(field.phi, exact(field.band.positions), atol=chord)


def test_error_of_a_faceted_sphere_is_of_second_order() -> None:
    errors = []
    for rings in (12, 24, 48):
        ball = sphere(rings=rings)
        field = signed_distance(ball.vertices, ball.faces, 1.0, 2.0)
        errors.append(np.abs(field.phi - round_distance()(field.band.positions)).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 1.7).all(), orders


def test_overlapping_parts_are_united_and_lattice_aligned_faces_are_counted_once() -> None:
    cube = np.array([[x, y, z] for x in (0, 4) for y in (0, 4) for z in (0, 4)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    assert Surface(cube, faces).volume == pytest.approx(64.0)
    both = np.vstack([cube, cube + np.array([2.0, 1.0, 1.0])])
    field = signed_distance(both, np.vstack([faces, faces + 8]), 1.0, 1.9)
    p = field.band.positions
    inside = ((p > 0) & (p < 4)).all(axis=1) | ((p > [2, 1, 1]) & (p < [6, 5, 5])).all(axis=1)
    clear = np.abs(field.phi) > 0.0  # a node on a face has no side
    assert ((field.phi < 0.0) == inside)[clear].all()


@pytest.mark.parametrize("surface", [circle(count=60), torus()], ids=["2D", "3D"])
def test_a_part_turned_inside_out_stays(surface: Surface) -> None:
    """A pinched surface winds round its far end the other way: what lies there is as much inside as
    before.
    """
    turned = Surface(surface.vertices, surface.faces[:, ::-1])
    as_it_was, found = (signed_distance(s.vertices, s.faces, 1.0, 3.0) for s in (surface, turned))
    np.testing.assert_allclose(found.phi, as_it_was.phi, atol=FLOAT32)
    assert (signed_distance(turned.vertices, turned.faces, 1.0, 3.0, inverted=False).phi >= 0.0).all()


def test_filled_distance_agrees_with_the_band_and_holds_the_whole_inside() -> None:
    surface = torus()
    full, band = (
        filled_distance(surface.vertices, surface.faces, 0.9, 2),
        signed_distance(surface.vertices, surface.faces, 0.9, 1.8),
    )
    rows = full.band.find(band.band.nodes + (band.band.low - full.band.low))
    assert (rows[band.phi < 0.0] >= 0).all()
    np.testing.assert_allclose(full.phi[rows[rows >= 0]], band.phi[rows >= 0], atol=FLOAT32)
    assert (full.phi < 0.0).sum() * 0.9**3 == pytest.approx(surface.volume, rel=0.01)


@pytest.mark.parametrize("dimension", [2, 3])
def test_nodes_grow_with_the_surface_not_with_the_box(dimension: int) -> None:
    surface = torus() if dimension == 3 else circle(count=400)
    counts = [
        len(signed_distance(surface.vertices, surface.faces, h, 3.0 * h).band) for h in (1.0, 0.5, 0.25)
    ]
    growth = np.array(counts[1:]) / counts[:-1]
    assert (growth < 1.1 * 2 ** (dimension - 1)).all(), growth


def test_shift_by_whole_spacings_and_quarter_turn_carry_the_field_along() -> None:
    surface = sphere(11.3)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    field = signed_distance(surface.vertices, surface.faces, 1.0, 3.0)
    moved = surface.vertices @ turn.T + [3.0, -7.0, 12.0]
    other = signed_distance(moved, surface.faces, 1.0, 3.0)
    there = np.round(field.band.positions @ turn.T + [3.0, -7.0, 12.0]).astype(int) - other.band.low
    rows = other.band.find(there)
    assert len(field.band) == len(other.band)
    np.testing.assert_allclose(other.phi[rows], field.phi, atol=FLOAT32)


def test_open_surfaces_are_refused_with_the_remedy() -> None:
    ball = sphere()
    with pytest.raises(InputError, match=r"open.*must be closed, cap its holes"):
        signed_distance(ball.vertices, ball.faces[:-40], 1.0, 3.0)
    line = outline(np.array([[0.0, 0.0], [9.5, 0.2], [4.1, 7.3]]))
    with pytest.raises(InputError, match="open"):
        signed_distance(line.vertices, line.faces[:-1], 1.0, 3.0)


def test_equal_inputs_give_equal_fields() -> None:
    surface = torus()
    first, second = (signed_distance(surface.vertices, surface.faces, 0.9, 2.7) for _ in range(2))
    assert (first.phi == second.phi).all()
    assert (first.face == second.face).all()
