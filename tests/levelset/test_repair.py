"""The level set of a moved prior: it comes back, and a wall is neither split nor merged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import circle, meshed, round_distance

from o3dls.adapters.meshing import isosurface
from o3dls.adapters.self_intersections import crossing
from o3dls.arrays import Array, Ints
from o3dls.evaluation.distances import distances
from o3dls.geometry.components import components_and_euler
from o3dls.geometry.flipped_faces import flipped
from o3dls.geometry.surface import Surface
from o3dls.levelset.grid.distance import SignedDistance, signed_distance
from o3dls.levelset.grid.isosurface import zero_set
from o3dls.levelset.repair import Mesher, Repair, relaxed_in_place, whole_level_set
from o3dls.levelset.settings import LatticeSettings
from o3dls.run_warning import RunWarning

SEED = 223_606


REPAIR = Repair(1.0, (1, 2), crossing, LatticeSettings(), isosurface)


def run(surface: Surface, mesh: Mesher = isosurface) -> tuple[SignedDistance, tuple[RunWarning, ...]]:
    return whole_level_set(surface, 1.0, "mm", mesh=mesh, crossing=crossing)


@pytest.mark.parametrize(
    "surface", [circle(count=300), meshed(round_distance(20.0), 24.0, 2.0)], ids=["2D", "3D"]
)
def test_a_surface_that_is_whole_gives_its_signed_distance(surface: Surface) -> None:
    phi, warnings = run(surface)
    psi = signed_distance(surface.vertices, surface.faces, 1.0, 3.0)
    assert (phi.phi == psi.phi).all()
    assert warnings == ()


def test_where_two_vertices_were_pushed_through_each_other_the_surface_is_relaxed_and_nowhere_else() -> None:
    ball = meshed(round_distance(20.0), 24.0, 1.0)
    pushed = int(ball.vertices[:, 2].argmax())
    vertices = ball.vertices.copy()
    beside = int(np.linalg.norm(vertices - vertices[pushed] - [0.8, 0.0, 0.0], axis=1).argmin())
    vertices[pushed] += [1.6, 0.0, -0.6]
    vertices[beside] -= [0.0, 0.0, 1.0]
    found = relaxed_in_place(ball.with_vertices(vertices), 0, 2.0, "mm", crossing)
    assert crossing(ball.with_vertices(vertices)).any()
    assert found is not None
    surface, (warning,) = found
    assert not crossing(surface).any()
    assert not flipped(surface).any()
    moved = (surface.vertices != vertices).any(axis=1)
    assert 1 <= moved.sum() < 60
    assert distances(vertices[moved], ball.with_vertices(vertices)).max() < 2.0
    assert warning.sentence.startswith("the moved prior intersects itself: ")
    assert warning.sentence.endswith(" mm")


def test_faces_that_a_motion_flipped_over_are_relaxed_and_those_of_the_prior_stay() -> None:
    ball = meshed(round_distance(20.0), 24.0, 1.0)
    vertices = ball.vertices.copy()
    vertices[int(ball.vertices[:, 2].argmax())] += [1.2, 0.0, 0.0]
    folded = ball.with_vertices(vertices)
    flips = int(flipped(folded).sum())
    assert flips > 0
    surface, warnings = relaxed_in_place(folded, 0, 2.0, "mm", lambda s: np.zeros(len(s.faces), dtype=bool))
    assert not flipped(surface).any()
    assert warnings == ()
    assert 1 <= (surface.vertices != vertices).any(axis=1).sum() < 30
    same, _ = relaxed_in_place(folded, flips, 2.0, "mm", lambda s: np.zeros(len(s.faces), dtype=bool))
    assert same is folded


def test_a_surface_without_crossings_stays_as_it_is() -> None:
    ball = meshed(round_distance(20.0), 24.0, 2.0)
    assert relaxed_in_place(ball, 0, 2.0, "mm", crossing) == (ball, ())


def test_walls_that_pass_through_each_other_are_not_relaxed_apart() -> None:
    """Two balls of one mesh that overlap by a third of their size."""
    ball = meshed(round_distance(12.0), 16.0, 1.0)
    both = Surface(
        np.vstack([ball.vertices, ball.vertices + np.array([16.0, 0.0, 0.0])]),
        np.vstack([ball.faces, ball.faces + len(ball.vertices)]),
    )
    assert relaxed_in_place(both, 0, 2.0, "mm", crossing) is None


def test_two_walls_closer_than_the_lattice_are_not_merged_into_a_handle() -> None:
    """A bent tube whose end comes within a fifth of a spacing of the body: the lattice cannot see the gap."""

    def hook(points: Array) -> Array:
        q = points - [18.0, 0.0, 0.0]
        arc = np.hypot(np.hypot(q[:, 0], q[:, 1]) - 9.0, q[:, 2]) - 3.0
        open_end = (q[:, 0] < 1.0) & (q[:, 1] < 0.0)
        return np.minimum(round_distance(16.0)(points), np.where(open_end, 3.0, arc))

    prior = meshed(hook, 34.0, 0.5)
    assert components_and_euler(prior.vertices, prior.faces) == (1, 2)
    phi, _ = run(prior)
    assert components_and_euler(*zero_set(phi.band, phi.phi)) == (1, 2)


def test_a_tube_that_was_bent_until_its_ends_have_merged_is_cut_where_they_have() -> None:
    """No gap is there to be closed, nothing is inside out: as the level set it is a ring."""

    def straight(at: Array) -> Array:
        along = np.abs(at[:, 0] - np.clip(at[:, 0], -35.0, 35.0))
        return np.linalg.norm(np.column_stack([along, at[:, 1:]]), axis=1) - 4.0

    tube = meshed(straight, 44.0)
    angle, r = tube.vertices[:, 0] / 12.0, 12.0 - tube.vertices[:, 1]
    bent = tube.with_vertices(np.column_stack([r * np.cos(angle), r * np.sin(angle), tube.vertices[:, 2]]))
    united = REPAIR.united(bent)
    assert components_and_euler(*isosurface(united)) == (1, 0)
    phi, warnings = run(bent)
    assert [one.sentence for one in warnings] == [
        "the moved prior intersects itself: merged walls were cut apart"
    ]
    mesh = isosurface(phi)
    assert components_and_euler(*mesh) == (1, 2)
    ring = Surface(*isosurface(united))
    changed = mesh[0][distances(mesh[0], ring) > 1e-6]
    assert 0 < len(changed) < 0.1 * len(mesh[0])
    assert changed[:, 0].max() < 0.0
    assert np.abs(changed[:, 1]).max() < 4.0  # the ends overlap by 1.3 mm on either side


def test_a_prior_that_overlaps_itself_is_united_in_one_piece() -> None:
    ball = meshed(round_distance(10.0), 12.0)
    x = ball.vertices[:, 0]
    waist = 1.0 - 1.3 * np.exp(-((x / 2.0) ** 2))
    squeezed = ball.with_vertices(ball.vertices * np.column_stack([np.ones_like(x), waist, np.ones_like(x)]))
    phi, _ = run(squeezed)
    vertices, faces = zero_set(phi.band, phi.phi)
    assert components_and_euler(vertices, faces)[0] == 1
    # both sides of the waist are there
    np.testing.assert_allclose([vertices[:, 0].min(), vertices[:, 0].max()], [-10.0, 10.0], atol=0.1)


def test_walls_of_a_thin_part_that_passed_through_each_other_stay_one_part() -> None:
    """A ball whose front has gone through its back on one side: what lies beyond where they cross hangs on a
    line of no thickness.
    """
    ball = meshed(round_distance(10.0), 12.0)
    x, y, z = ball.vertices.T
    # between nodes
    through = ball.with_vertices(np.column_stack([x, y * (1.0 - 0.14 * np.maximum(x + 2.0, 0.0)) + 0.5, z]))
    assert ((through.vertices[x > 8.0, 1] - 0.5) * y[x > 8.0] <= 0.0).all()  # inside out
    plain = signed_distance(through.vertices, through.faces, 1.0, 3.0)
    joined = REPAIR._join_walls(through)
    found = signed_distance(joined.vertices, joined.faces, 1.0, 3.0)
    assert components_and_euler(*isosurface(plain)) != (1, 2)
    assert components_and_euler(*isosurface(found)) == (1, 2)
    far = joined.vertices[joined.vertices[:, 0] < 2.0]  # they cross where x is 5.1
    np.testing.assert_allclose(distances(far, Surface(*zero_set(plain.band, plain.phi))), 0.0, atol=1e-6)
    assert joined.vertices[:, 0].max() == pytest.approx(10.0, abs=0.5)


@pytest.mark.parametrize(
    ("handled", "said"),
    [
        (2, "gaps narrower than 2 mm were closed"),
        (3, "islands were removed"),
        (4, "gaps narrower than 1 mm were closed, islands were removed"),
        (8, "islands and inverted parts were removed"),
    ],
)
def test_it_is_the_mesh_that_has_to_be_whole(
    handled: int, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the first meshes have a handle that the level set has not, gaps are closed and pieces left out
    until there is none.
    """
    monkeypatch.setattr(  # meshes of what is closed have none
        "o3dls.levelset.repair.Repair", lambda *given: replace(Repair(*given), mesh=isosurface)
    )
    ball = meshed(round_distance(10.0), 12.0)
    seen: list[SignedDistance] = []

    def handled_first(phi: SignedDistance) -> tuple[Array, Ints]:
        from shapes import torus

        seen.append(phi)
        return (torus().vertices, torus().faces) if len(seen) <= handled else isosurface(phi)

    phi, (warning,) = run(ball, mesh=handled_first)
    assert phi is seen[-1]
    assert warning.code == "self-intersection-repaired"
    assert warning.sentence == f"the moved prior intersects itself: {said}"


def test_topology_counts_pieces_and_handles() -> None:
    from shapes import torus

    ring = torus()
    assert components_and_euler(ring.vertices, ring.faces) == (1, 0)
    pair = Surface(
        np.vstack([ring.vertices, ring.vertices + 100.0]),
        np.vstack([ring.faces, ring.faces + len(ring.vertices)]),
    )
    assert components_and_euler(pair.vertices, pair.faces) == (2, 0)
    round_line = circle(count=50)
    assert components_and_euler(round_line.vertices, round_line.faces) == (1, 0)


def test_closing_gaps_leaves_the_rest_where_it_is() -> None:
    ball = meshed(round_distance(16.0), 20.0)
    shut = REPAIR.closed(signed_distance(ball.vertices, ball.faces, 1.0, 5.0), 2.0)
    np.testing.assert_allclose(np.linalg.norm(zero_set(shut.band, shut.phi)[0], axis=1), 16.0, atol=0.1)
