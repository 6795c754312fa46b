"""Validity: each count on a surface made to have it, and a prior's own faults not held against its result."""

from __future__ import annotations

import numpy as np
import pytest
from tiny import sphere

from o3dls.adapters.self_intersections import self_intersections
from o3dls.evaluation.validity import components, euler, faults, flipped_faces, validity
from o3dls.geometry.surface import Surface, outline
from o3dls.io.images.wall import mask_surface

CLEAN = {"watertight": True, "components": 1, "euler": 2, "self_intersections": 0, "flipped_faces": 0}


def torus(n: int = 24) -> Surface:
    u = np.linspace(0, 2 * np.pi, n, endpoint=False)
    a, b = np.meshgrid(u, u, indexing="ij")
    vertices = np.stack(
        [(15 + 5 * np.cos(b)) * np.cos(a), (15 + 5 * np.cos(b)) * np.sin(a), 5 * np.sin(b)], -1
    ).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    p, q, r, s = (((i + di) % n * n + (j + dj) % n).ravel() for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return Surface(vertices, np.vstack([np.column_stack([p, q, r]), np.column_stack([p, r, s])]))


def together(*parts: Surface) -> Surface:
    starts = np.cumsum([0, *(len(p.vertices) for p in parts)])
    faces = np.vstack([p.faces + s for p, s in zip(parts, starts, strict=False)])
    return Surface(np.vstack([p.vertices for p in parts]), faces)


def test_a_sphere_is_valid_and_has_its_volume() -> None:
    ball = sphere(20.0, 40)
    found = validity(ball, sphere(10.0, 40))
    assert list(found) == [*CLEAN, "volume_ml", "volume_change"]
    assert found.items() >= (CLEAN | {"euler": 2}).items()
    assert found["volume_ml"] == pytest.approx(4 / 3 * np.pi * 8.0, rel=0.01)
    assert found["volume_change"] == pytest.approx(7.0)


def test_a_surface_in_another_pose_keeps_its_shape_and_gets_a_volume_of_its_own() -> None:
    ball = sphere(20.0, 40)
    known = validity(ball, ball) | {"self_intersections": 5}  # what only the first can have said
    larger = ball.with_vertices(2.0 * ball.vertices)
    found = validity(larger, ball, posed=known)
    assert found["self_intersections"] == 5
    assert found["volume_change"] == pytest.approx(7.0)


def test_euler_number_and_components_count_handles_and_pieces() -> None:
    assert torus().watertight
    assert euler(torus()) == 0
    pair = together(sphere(), sphere().with_vertices(sphere().vertices + 100.0))
    assert (components(pair), euler(pair)) == (2, 4)
    assert euler(Surface(sphere().vertices, sphere().faces[1:])) == 1
    # a vertex without a face
    assert components(Surface(np.vstack([sphere().vertices, [[99.0, 0, 0]]]), sphere().faces)) == 1


def test_overlapping_spheres_intersect_and_separate_ones_do_not() -> None:
    near, far = (together(sphere(), sphere().with_vertices(sphere().vertices + gap)) for gap in (10.0, 100.0))
    assert self_intersections(near) > 0
    assert self_intersections(far) == 0


def test_a_face_that_is_folded_over_counts_as_flipped() -> None:
    ball = sphere()
    pulled = ball.vertices.copy()
    pulled[200] += 1.5 * (pulled[201] - pulled[200])  # past its neighbour
    assert flipped_faces(ball) == 0
    assert flipped_faces(ball.with_vertices(pulled)) > 0


def test_outlines_are_judged_by_the_same_words() -> None:
    square = np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]])
    bow_tie = Surface(square[[0, 1, 3, 2]], outline(square).faces)
    assert validity(outline(square), outline(square), "px") == CLEAN | {
        "euler": 0,
        "area_px2": 16.0,
        "volume_change": 0.0,
    }
    assert self_intersections(bow_tie) == 2


def test_an_open_surface_encloses_nothing() -> None:
    found = validity(Surface(sphere().vertices, sphere().faces[1:]), sphere())
    assert (found["watertight"], found["volume_ml"], found["volume_change"]) == (False, None, None)


def test_faults_name_what_the_result_has_and_the_prior_has_not() -> None:
    good = validity(sphere(), sphere())
    assert faults(good, good) == []
    assert faults(good | {"self_intersections": 4}, good) == [
        "the surface has 4 self-intersecting faces, the prior 0"
    ]
    assert faults(good | {"self_intersections": 4}, good | {"self_intersections": 4}) == []
    assert faults(good | {"watertight": False, "components": 3}, good) == [
        "the surface is not watertight",
        "the surface has 3 components, the prior 1",
    ]
    assert faults(good | {"volume_change": -2.0}, good) == ["the surface is inside out"]


def test_handles_that_the_prior_has_not_are_a_fault_unless_points_asked_for_them() -> None:
    ball, ring = validity(sphere(), sphere()), validity(torus(), torus())
    assert faults(ring, ball) == ["the surface has 1 handles or tunnels, the prior 0"]
    assert faults(ring, ball, reshaped=True) == faults(ring, ring) == faults(ball, ring) == []
    assert faults(ball | {"components": 2, "euler": 4}, ball) == ["the surface has 2 components, the prior 1"]


def test_faces_side_by_side_in_one_plane_do_not_cross_however_they_are_turned() -> None:
    """The slanting sides of a label volume's surface."""
    octahedron = mask_surface(np.abs(np.indices((24, 24, 24)) - 11.5).sum(axis=0) < 10.0, np.eye(4))
    for seed in range(6):
        turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
        assert self_intersections(octahedron.with_vertices(octahedron.vertices @ turn + 50.0)) == 0
