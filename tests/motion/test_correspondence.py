"""Likely feet against what is known: the closest point without noise, the bias of noise round a ball, no say
between two walls.
"""

import numpy as np
import pytest
import trimesh
from fields import SIZE, body, spots

from o3dls.arrays import Array
from o3dls.geometry.closest_point import ClosestPoint
from o3dls.geometry.differential import vertex_normals
from o3dls.geometry.similarity import apply, similarity
from o3dls.geometry.surface import Surface, outline
from o3dls.motion.correspondence import likely_feet
from o3dls.motion.field.covariance import Places
from o3dls.motion.field.observations import Feet

DIMENSIONS = pytest.mark.parametrize("dimension", [2, 3])


def feet_on(moved: Surface, points: Array, sd: float, rest: Surface | None = None) -> Feet:
    rest = rest or moved
    tree = ClosestPoint(moved.vertices, moved.faces)
    normals = vertex_normals(rest.vertices, rest.faces)
    return likely_feet(tree, points, np.full(len(points), sd), Places(rest.vertices, normals))


def ball(dimension: int, radius: float) -> Surface:
    if dimension == 2:
        t = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
        return outline(radius * np.column_stack([np.cos(t), np.sin(t)]))
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    return Surface(sphere.vertices, sphere.faces)


@DIMENSIONS
def test_without_noise_feet_are_closest_points(dimension: int) -> None:
    surface = body(dimension)
    on, face, bary = spots(surface, 60, 3)
    normals = vertex_normals(surface.vertices, surface.faces)
    n = (normals[surface.faces[face]] * bary[:, :, None]).sum(axis=1)
    points = on + 0.05 * SIZE * n
    feet = feet_on(surface, points, 1e-4 * SIZE)
    foot = ClosestPoint(surface.vertices, surface.faces).query(points)[2]
    assert np.median(np.linalg.norm(feet.at - foot, axis=1)) < 1e-5 * SIZE  # where no edge is equally near
    # faces meet at edges at up to a few degrees
    np.testing.assert_allclose(np.linalg.norm(feet.normals, axis=1), 1.0, atol=0.02)
    np.testing.assert_allclose(feet.along, 1.0, atol=1e-9)  # the surface is in its reference pose


@DIMENSIONS
def test_points_round_a_ball_need_no_correction(dimension: int) -> None:
    """Isotropic noise s carries points outwards by s^2 (d - 1) / 2R in the mean: there the likely foot sees
    no distance.
    """
    radius, sd = 10.0, 1.5
    outwards = 0.5 * sd**2 * (dimension - 1) / radius
    directions = np.random.default_rng(5).normal(size=(40, dimension))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    feet = feet_on(ball(dimension, radius), (radius + outwards) * directions, sd)
    # the surface is in its reference pose, so the residual is the distance itself; REACH leaves 5 % of the
    # elements out
    distance = feet.residual
    np.testing.assert_allclose(distance, 0.0, atol=0.25 * outwards)


def test_a_point_between_two_walls_says_nothing() -> None:
    """On the axis of a tube the walls' normals cancel; near a wall that wall alone speaks."""
    tube = trimesh.creation.cylinder(radius=5.0, height=60.0, sections=128).subdivide_to_size(2.0)
    surface = Surface(tube.vertices, tube.faces)
    feet = feet_on(surface, np.array([[0.0, 0.0, 0.0], [4.5, 0.0, 0.0]]), 1.0)
    assert np.linalg.norm(feet.normals[0]) < 0.1
    np.testing.assert_allclose(feet.normals[1], [1.0, 0.0, 0.0], atol=0.05)


@DIMENSIONS
def test_the_frame_does_not_matter(dimension: int) -> None:
    """Surface, reference pose and points turned, shifted and scaled together: the same feet, turned, shifted
    and scaled.
    """
    moved = body(dimension)
    rest = moved.with_vertices(0.9 * moved.vertices + 1.0)
    points = spots(moved, 30, 8)[0] * 1.04
    angle = 0.7
    turn = np.eye(dimension)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    frame = similarity(turn, np.full(dimension, 3.0), 2.0)
    here = feet_on(moved, points, 1.0, rest)
    there = feet_on(moved.transformed(frame), apply(frame, points), 2.0, rest.transformed(frame))
    # of the noise of 1: boxes of the tree do not turn, so other faces are seen by their common centre
    close = 0.05
    np.testing.assert_allclose(there.at, apply(frame, here.at), atol=2.0 * close)
    np.testing.assert_allclose(there.normals, here.normals @ turn.T, atol=close)
    np.testing.assert_allclose(there.residual, 2.0 * here.residual, atol=2.0 * close)
    np.testing.assert_allclose(there.along, here.along, atol=close)


def test_a_point_far_off_a_sharp_edge_still_has_a_foot() -> None:
    """Seen from 6000 times the noise, every face's centre is less likely than a number can say: the closest
    face speaks for all.
    """
    box = trimesh.creation.box((0.1, 0.1, 0.1)).subdivide_to_size(0.012)
    feet = feet_on(Surface(box.vertices, box.faces), np.array([[60.0, 60.0, 60.0]]), 0.01)
    assert np.linalg.norm(feet.at[0] - 0.05) < 0.012
    np.testing.assert_allclose(feet.residual[0], feet.normals[0] @ (60.0 - feet.at[0]), rtol=1e-9)
