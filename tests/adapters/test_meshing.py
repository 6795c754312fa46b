"""Level set to mesh: closed, outward, near the zero set by a measured amount; fields carried, pieces
chosen.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import ball_with_tube, circle, meshed, round_distance, torus

from o3dls.adapters.meshing import _clean_mesh, carry_fields, extract, isosurface
from o3dls.adapters.self_intersections import self_intersections
from o3dls.errors import SolverError
from o3dls.evaluation.distances import distances
from o3dls.evaluation.validity import validity
from o3dls.geometry.components import components_and_euler
from o3dls.geometry.flipped_faces import flipped
from o3dls.geometry.surface import Surface
from o3dls.levelset.grid.distance import SignedDistance, signed_distance
from o3dls.levelset.grid.isosurface import zero_set
from o3dls.levelset.grid.regularised import regularised


def field(surface: Surface, spacing: float = 1.0) -> SignedDistance:
    return signed_distance(surface.vertices, surface.faces, spacing, 3.0 * spacing)


@pytest.mark.parametrize("surface", [meshed(ball_with_tube, 34.0, 0.5), torus()], ids=["tube", "torus"])
def test_mesh_is_valid_and_lies_on_the_surface(surface: Surface) -> None:
    found = extract(field(surface))
    state = validity(found.surface, surface)
    assert state["watertight"]
    assert state["self_intersections"] == 0
    assert components_and_euler(found.surface.vertices, found.surface.faces) == components_and_euler(
        surface.vertices, surface.faces
    )
    assert found.surface.volume == pytest.approx(surface.volume, rel=0.01)
    assert distances(found.surface.vertices, surface).mean() < 0.02
    assert len(found.surface.faces) <= 0.51 * found.isosurface_faces


@pytest.mark.parametrize("keep", [0.25, 0.5, 0.9])
def test_as_many_faces_are_left_as_asked(keep: float) -> None:
    found = extract(field(torus()), keep=keep)
    asked = keep * found.isosurface_faces
    assert asked - 3 < len(found.surface.faces) <= asked + 1  # a collapse takes two


def test_regularising_leaves_six_tenths_of_an_isosurface() -> None:
    """As docs/method_level_set.md says."""
    surface = Surface(*isosurface(field(torus())))
    assert len(regularised(surface, 1.0).faces) / len(surface.faces) == pytest.approx(0.6, abs=0.05)


def test_a_fine_zero_set_of_another_topology_is_meshed_without_folds() -> None:
    fine = field(meshed(ball_with_tube, 34.0, 0.5))
    raw = Surface(*zero_set(fine.band, fine.phi))
    found = extract(field(torus()), raw=raw).surface
    assert components_and_euler(found.vertices, found.faces) == components_and_euler(raw.vertices, raw.faces)
    assert self_intersections(found) == 0
    assert not flipped(found).any()


def test_triangles_are_even() -> None:
    """4 sqrt(3) areas over the sum of squared edges: 1 for equal sides. An isosurface that is decimated as it
    comes has .82 in the mean.
    """
    shown = extract(field(meshed(ball_with_tube, 34.0, 0.5))).surface
    corners = shown.vertices[shown.faces]
    squares = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=(1, 2))
    quality = 4.0 * np.sqrt(3.0) * shown.face_areas / squares
    assert quality.mean() > 0.87


def test_clean_up_is_measured_and_can_be_left_out() -> None:
    phi = field(torus())
    bare = extract(phi, smoothing=0, keep=1.0)
    clean = extract(phi)
    assert bare.shift_max < 1e-6
    assert 0.0 < clean.shift_mean < 0.05
    assert clean.shift_mean < clean.shift_max
    assert len(bare.surface.faces) == bare.isosurface_faces


def test_smoothing_that_would_make_the_walls_of_a_slot_cross_is_left_out() -> None:
    def slotted(points: np.ndarray) -> np.ndarray:
        slot = np.maximum(np.abs(points[:, 2] - 0.05 * points[:, 0]) - 0.25, -4.0 - points[:, 0])
        return np.maximum(round_distance(12.0)(points), -slot)

    phi = field(meshed(slotted, 15.0, 0.25))
    assert self_intersections(_clean_mesh(Surface(*isosurface(phi)), 3, 3096)) > 0  # as it would be
    assert self_intersections(extract(phi).surface) == 0


def test_isosurface_is_of_second_order() -> None:
    errors = []
    ball = meshed(round_distance(15.0), 18.0, 0.3)
    for spacing in (3.0, 1.5, 0.75):
        errors.append(np.abs(round_distance(15.0)(isosurface(field(ball, spacing))[0])).max())
    assert (np.log2(np.array(errors[:-1]) / errors[1:]) > 1.5).all(), errors


def test_a_thin_vein_is_not_lost() -> None:
    def vein(points: np.ndarray) -> np.ndarray:
        along = np.clip(points[:, 0], 8.0, 28.0)
        tube = np.linalg.norm(points - [1.0, 0.0, 0.0] * along[:, None], axis=1) - 2.0
        return np.minimum(round_distance(16.0)(points), tube)

    surface = meshed(vein, 34.0, 0.5)
    found = extract(field(surface)).surface
    assert components_and_euler(found.vertices, found.faces) == (1, 2)
    assert found.vertices[:, 0].max() == pytest.approx(surface.vertices[:, 0].max(), abs=0.15)
    tip = surface.vertices[surface.vertices[:, 0] > 17.0]
    assert distances(tip, found).mean() < 0.08  # h^2 / 8r of a chord, twice


def test_contour_in_2d_is_the_zero_set() -> None:
    found = extract(field(circle(20.0, 400)))
    assert found.surface.watertight
    assert found.surface.volume == pytest.approx(np.pi * 400.0, rel=1e-3)
    assert (found.shift_mean, found.shift_max) == (0.0, 0.0)


def test_islands_stay_or_go() -> None:
    def two(points: np.ndarray) -> np.ndarray:
        return np.minimum(
            round_distance(8.0)(points), np.linalg.norm(points - [14.0, 0.0, 0.0], axis=1) - 3.0
        )

    phi = field(meshed(two, 20.0, 0.5))
    assert components_and_euler(*_arrays(extract(phi, islands=True).surface))[0] == 2
    assert components_and_euler(*_arrays(extract(phi, islands=False).surface))[0] == 1


def _arrays(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    return surface.vertices, surface.faces


def test_a_level_set_without_a_surface_is_an_error() -> None:
    phi = field(torus())
    with pytest.raises(SolverError, match="does not change its sign"):
        extract(SignedDistance(phi.band, np.abs(phi.phi) + 1.0, phi.face))


def test_fields_are_read_where_the_new_vertices_lie() -> None:
    source = torus()
    source = Surface(source.vertices, source.faces, {"x": source.vertices[:, 0], "place": source.vertices})
    target = extract(field(source)).surface
    carried = carry_fields(source, target)
    np.testing.assert_allclose(carried.fields["x"], target.vertices[:, 0], atol=0.1)
    np.testing.assert_allclose(carried.fields["place"], target.vertices, atol=0.1)
    assert carry_fields(torus(), target) is target


def test_labels_are_carried_as_they_are() -> None:
    source = torus()
    region = np.where(source.vertices[:, 0] > 0.3, 7.0, 1.0)
    source = Surface(source.vertices, source.faces, {"region": region, "sd_mm": 0.5 * region})
    target = extract(field(source)).surface
    carried = carry_fields(source, target).fields
    assert set(carried["region"]) == {1.0, 7.0}
    assert ((carried["region"] == 7.0) == (target.vertices[:, 0] > 0.3))[
        np.abs(target.vertices[:, 0] - 0.3) > 1.5
    ].all()
    assert len(set(carried["sd_mm"])) > 2  # .5 and 3.5: measured values have means


def test_blocks_that_meet_along_a_diagonal_stay_the_two_pieces_that_the_zero_set_has() -> None:
    """Nodes along x + y = 1 are joined in cubes and not by simplices: an isosurface makes two pieces one."""
    ball = meshed(round_distance(8.0), 10.0)
    phi = signed_distance(ball.vertices, ball.faces, 1.0, 9.0)
    x, y, z = np.round(phi.band.positions).astype(int).T
    low = (x >= -4) & (x <= 0) & (y >= 1) & (y <= 5)
    high = (x >= 1) & (x <= 5) & (y >= -4) & (y <= 0)
    phi = replace(phi, phi=np.where((low | high) & (np.abs(z) <= 2), -0.5, 0.5))
    raw = Surface(*zero_set(phi.band, phi.phi))
    assert components_and_euler(raw.vertices, raw.faces) == (2, 4)
    assert components_and_euler(*isosurface(phi)) == (1, 2)
    found = extract(phi, raw=raw)
    assert components_and_euler(found.surface.vertices, found.surface.faces) == (2, 4)
    assert validity(found.surface, raw)["self_intersections"] == 0
    assert len(found.surface.faces) < 0.3 * len(raw.faces)
    assert found.surface.volume == pytest.approx(
        raw.volume, rel=0.15
    )  # blocks of five nodes lose their edges
