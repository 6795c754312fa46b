"""The stage: where points ask for nothing the surface stays, a folded prior is repaired, in 2D and 3D."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from shapes import ball_with_tube, circle, meshed, round_distance, sampled
from starts import started

from o3dls.adapters.self_intersections import self_intersections
from o3dls.arrays import Array
from o3dls.case import Points
from o3dls.errors import InputError, PipelineError, SolverError
from o3dls.evaluation.distances import distances
from o3dls.geometry.components import components_and_euler
from o3dls.geometry.surface import Surface
from o3dls.levelset.grid.isosurface import zero_set
from o3dls.run_warning import RunWarning
from o3dls.stages.level_set import LevelSet
from o3dls.stages.level_set_checks import check_mesh
from o3dls.stages.level_set_data import given_points
from o3dls.stages.level_set_data import meshed as of_lattice

SEED = 264_575


@pytest.mark.parametrize("prior", [circle(20.0, 300), meshed(ball_with_tube, 34.0)], ids=["2D", "3D"])
def test_nothing_to_add_leaves_the_surface_where_it_is(prior: Surface) -> None:
    case, start = started(prior, sampled(prior, 300, 1.0, SEED), 1.0)
    found = LevelSet()(case, start)
    flat = "outlines in the plane are not reconstructed"
    why = flat if prior.dimension == 2 else "the points ask for no other wall"
    assert found.status.startswith(f"the moved prior stays: {why}")
    assert found.motion is start.motion
    assert found.fit is start.fit
    assert found.weights is start.weights
    np.testing.assert_array_equal(found.surface.vertices, prior.vertices)
    np.testing.assert_array_equal(found.surface.faces, prior.faces)
    assert found.sigma == pytest.approx(1.0)
    assert found.T_map_prior is start.T_map_prior
    assert (found.surface.fields["correction_mm"] == 0.0).all()
    assert found.surface.fields["sd_mm"] == pytest.approx(1.0)
    assert found.facts["changes"] == []
    assert found.facts["meshing_shift_max"] == 0.0
    assert found.phi.band.spacing == 1.0
    outline = Surface(*zero_set(found.phi.band, found.phi.phi))
    assert distances(outline.vertices, prior).max() < 0.3


@pytest.fixture
def anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Priors are taken for such as cut through themselves beyond what can be relaxed."""
    monkeypatch.setattr("o3dls.levelset.repair.relaxed_in_place", lambda *_: None)


@pytest.mark.usefixtures("anew")
def test_a_wall_whose_topology_the_lattice_changed_is_meshed_by_a_finer_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Walls that a lattice of 1 mm joins have shapes of patients: here it is told to give a torus."""
    prior = meshed(ball_with_tube, 34.0)
    case, start = started(prior, sampled(prior, 300, 1.0, SEED), 1.0)
    plain = LevelSet()(case, start)
    torus = trimesh.creation.torus(16.0, 5.0)
    spacings = []

    def joined(reached: Any, spacing: float, *how: Any) -> Any:
        spacings.append(spacing)
        reached, mesh = of_lattice(reached, spacing, *how)
        wrong = replace(mesh, surface=Surface(torus.vertices, torus.faces))
        return reached, wrong if spacing == 1.0 else mesh

    with monkeypatch.context() as told:
        told.setattr("o3dls.stages.level_set.meshed", joined)
        found = LevelSet()(case, start)
    assert spacings == [1.0, 0.5]
    assert found.phi.band.spacing == 0.5
    assert found.warnings == ()
    assert components_and_euler(found.surface.vertices, found.surface.faces) == (1, 2)
    assert len(found.surface.faces) == pytest.approx(len(plain.surface.faces), rel=0.1)
    assert distances(found.surface.vertices, prior).max() < 0.3


def test_a_motion_that_has_not_converged_leaves_a_level_set_that_has_not() -> None:
    prior = meshed(round_distance(16.0), 20.0)
    case, start = started(prior, sampled(prior, 100, 0.8, SEED), 0.8)
    stood, moved = (
        LevelSet()(case, replace(start, fit=replace(start.fit, converged=still))) for still in (True, False)
    )
    assert stood.converged
    assert not moved.converged
    assert moved.status.startswith("the motion had not converged; the moved prior stays")


def test_a_prior_of_two_pieces_keeps_both() -> None:
    large, small = meshed(round_distance(16.0), 20.0), meshed(round_distance(8.0), 12.0)
    beside = small.vertices + np.array([40.0, 0.0, 0.0])
    prior = Surface(
        np.vstack([large.vertices, beside]), np.vstack([large.faces, small.faces + len(large.vertices)])
    )
    case, start = started(prior, sampled(prior, 300, 0.5, SEED), 0.5)
    found = LevelSet()(case, start)
    assert components_and_euler(found.surface.vertices, found.surface.faces) == (2, 4)
    assert distances(beside, found.surface).mean() < 0.1
    assert found.warnings == ()


def test_a_small_second_piece_is_no_dust() -> None:
    large, small = meshed(round_distance(20.0), 24.0), meshed(round_distance(4.0), 6.0)
    beside = small.vertices + np.array([40.0, 0.0, 0.0])
    prior = Surface(
        np.vstack([large.vertices, beside]), np.vstack([large.faces, small.faces + len(large.vertices)])
    )
    found = LevelSet()(*started(prior, sampled(prior, 300, 0.5, SEED), 0.5))
    assert components_and_euler(found.surface.vertices, found.surface.faces) == (2, 4)
    assert distances(beside, found.surface).mean() < 0.1


def flanged(points: Array) -> Array:
    """A ball of 6 mm with a flange 5 mm wide and .6 mm thick, between two planes of the lattice."""
    flange = np.maximum(np.abs(points[:, 2] - 0.5) - 0.3, np.linalg.norm(points[:, :2], axis=1) - 11.0)
    return np.minimum(round_distance(6.0)(points), flange)


def test_a_valid_part_too_thin_for_the_lattice_stays() -> None:
    prior = meshed(flanged, 12.0, 0.3)
    found = LevelSet()(*started(prior, sampled(prior, 100, 0.5, SEED), 0.5))
    np.testing.assert_array_equal(found.surface.vertices, prior.vertices)
    assert found.warnings == ()


@pytest.mark.usefixtures("anew")
def test_a_part_too_thin_for_the_lattice_does_not_go_without_a_word() -> None:
    prior = meshed(flanged, 12.0, 0.3)
    case, start = started(prior, sampled(prior, 100, 0.5, SEED), 0.5)
    coarse = LevelSet()(case, start)
    fine = LevelSet(spacing=0.4)(case, start)
    (warning,) = coarse.warnings
    assert warning.code == "parts-lost"
    assert re.match(r"parts of the moved prior, up to [45](\.\d)? mm from the mesh", warning.sentence)
    assert fine.warnings == ()
    assert distances(prior.vertices, fine.surface).max() < 0.5


def test_an_outline_that_crosses_itself_is_not_handed_out() -> None:
    prior = circle(20.0, 300)
    vertices = prior.vertices.copy()
    swapped = np.argsort(np.abs(np.arctan2(vertices[:, 1], vertices[:, 0])))[:2]
    # two neighbours in each other's place: the line crosses itself
    vertices[swapped] = 0.98 * vertices[swapped[::-1]]
    crossed = prior.with_vertices(vertices)
    assert self_intersections(crossed) > 0
    case, start = started(crossed, sampled(prior, 300, 1.0, SEED), 1.0, fitted=False)
    estimate = LevelSet()(case, start)
    found, phi = estimate.surface, estimate.phi
    assert self_intersections(found) == 0
    assert estimate.warnings == ()
    outline_of_phi = Surface(*zero_set(phi.band, phi.phi))
    assert distances(found.vertices, outline_of_phi).max() < 0.5
    # what was drawn stays, only its order changes
    np.testing.assert_array_equal(found.vertices, crossed.vertices)
    assert found.volume == pytest.approx(prior.volume, rel=0.01)


def test_what_a_pose_leaves_is_reconstructed() -> None:
    """Without a motion before it, the level set alone brings the wall to the points."""
    prior = meshed(round_distance(20.0), 24.0)
    truth = prior.with_vertices(prior.vertices * [1.12, 0.95, 1.0])
    case, start = started(prior, sampled(truth, 1000, 0.4, SEED), 0.4, fitted=False)
    found = LevelSet()(case, start)
    assert "reconstructed" in found.status
    assert distances(truth.vertices, found.surface).mean() < 0.3 * distances(truth.vertices, prior).mean()
    assert np.abs(found.surface.fields["correction_mm"]).max() > 1.0
    assert len(found.weights) == 1000


@pytest.mark.parametrize("fitted", [True, False])
def test_points_known_to_be_inside_are_not_on_the_wall(fitted: bool) -> None:
    prior = meshed(round_distance(20.0), 24.0)
    case, start = started(prior, sampled(prior, 100, 1.0, SEED), 1.0, fitted=fitted)
    if not fitted:
        deep = np.vstack([case.points.xyz, sampled(meshed(round_distance(6.0), 8.0), 10, 1.0, SEED)])
        case = replace(case, points=Points(deep, np.array(["eam"] * 100 + ["inside"] * 10)))
    given = given_points(case, start)
    assert len(given.believed.points) == len(given.believed.weights) == 100
    assert len(given.believed.inside.points) == (0 if fitted else 10)
    assert len(given.of_mapping(given.believed.weights)) == 100
    assert np.median(given.believed.noise) == pytest.approx(1.0, rel=0.2)


@pytest.mark.usefixtures("anew")
def test_halved_spacing_is_no_worse() -> None:
    prior = meshed(ball_with_tube, 34.0, 0.5)
    case, start = started(prior, sampled(prior, 100, 1.0, SEED), 1.0)
    errors = [distances(prior.vertices, LevelSet(spacing=h)(case, start).surface).mean() for h in (2.0, 1.0)]
    assert errors[1] < 0.5 * errors[0]


def test_phi_is_a_distance_where_walls_were_made_whole_too(monkeypatch: pytest.MonkeyPatch) -> None:
    prior = meshed(round_distance(14.0), 18.0)
    case, start = started(prior, sampled(prior, 100, 0.5, SEED), 0.5, fitted=False)
    reached = LevelSet()._moved_prior(case, start.surface, 1.0, asked=True)
    repaired = RunWarning("self-intersection-repaired", "islands were removed")
    stretched = replace(reached.phi, phi=3.0 * reached.phi.phi)
    cut = replace(reached, phi=stretched, warnings=(repaired,), valid=False)
    monkeypatch.setattr(LevelSet, "_moved_prior", lambda *_, **__: cut)
    found = LevelSet()(case, start)
    assert found.warnings == cut.warnings
    np.testing.assert_allclose(found.phi.phi, round_distance(14.0)(found.phi.band.positions), atol=0.1)


@pytest.mark.parametrize("push", [[2.5, 0.0, -0.8], [5.0, 0.0, -2.5]], ids=["relaxed", "repaired"])
def test_folded_prior_comes_out_without_folds(push: list[float]) -> None:
    from o3dls.evaluation.validity import validity

    ball = meshed(round_distance(14.0), 18.0)
    pole = ball.vertices[:, 2] > 13.0
    folded = ball.with_vertices(ball.vertices + np.where(pole[:, None], push, 0.0))
    assert validity(folded, ball)["self_intersections"] > 0
    case, start = started(folded, sampled(ball, 200, 1.0, SEED), 1.0)
    found = validity(LevelSet()(case, start).surface, ball)
    assert (found["components"], found["euler"], found["self_intersections"]) == (1, 2, 0)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"spacing": 0.0}, r"level_set.spacing = 0.0 mm: must be a number within \[0.001, inf\) mm"),
        ({"keep": 1.5}, r"level_set.keep = 1.5: must be a number within \(0, 1\]"),
        ({"area": 5.0}, "level_set.*area"),
    ],
)
def test_parameters_are_checked(given: dict[str, float], said: str) -> None:
    with pytest.raises(PipelineError, match=said):
        LevelSet(**given)


def test_no_surface_at_all_is_an_error() -> None:
    """A prior thinner than the lattice encloses nothing."""
    prior = meshed(round_distance(16.0), 20.0)
    thin = prior.with_vertices(prior.vertices * [1.0, 1.0, 1e-4] + [0.0, 0.0, 0.5])
    case, start = started(thin, sampled(thin, 100, 0.1, SEED), 0.1)
    with pytest.raises(SolverError, match="the surface shrank to nothing"):
        LevelSet()(case, start)


@pytest.mark.parametrize(
    ("factor", "said"),
    [(0.04, "take at most 0.21 mm, or check that its lengths are in mm"), (200.0, "take at least 9.3 mm")],
)
def test_lengths_that_are_not_in_mm_are_refused(factor: float, said: str) -> None:
    """Inches, and what fills the memory."""
    prior = meshed(round_distance(16.0), 20.0)
    scaled = prior.with_vertices(factor * prior.vertices)
    case, start = started(scaled, sampled(scaled, 100, 0.1, SEED), 0.1)
    with pytest.raises(InputError, match=said):
        LevelSet()(case, start)


@pytest.mark.usefixtures("anew")
def test_a_mesh_that_is_no_likeness_of_its_level_set_is_an_error() -> None:
    prior = meshed(round_distance(16.0), 20.0)
    case, start = started(prior, sampled(prior, 100, 0.1, SEED), 0.1)
    with pytest.raises(SolverError, match=r"encloses \d+% less .* keep above 1e-09 may help"):
        LevelSet(keep=1e-9)(case, start)


def test_points_of_the_wall_are_needed() -> None:
    prior = circle(20.0, 300)
    case, start = started(prior, sampled(prior, 100, 1.0, SEED), 1.0)
    case = replace(case, points=replace(case.points, type=np.full(100, "inside")))
    with pytest.raises(InputError, match="level_set: case case has no points of type eam"):
        LevelSet()(case, start)


def test_equal_inputs_give_equal_surfaces() -> None:
    prior = meshed(round_distance(16.0), 20.0)
    case, start = started(prior, sampled(prior, 200, 1.0, SEED), 1.0)
    first, second = (LevelSet()(case, start) for _ in range(2))
    assert (first.surface.vertices == second.surface.vertices).all()
    assert first.facts == second.facts


def test_a_surface_that_shrinks_to_nothing_is_an_error() -> None:
    tiny = meshed(round_distance(1.0), 2.0, 0.25)
    with pytest.raises(SolverError, match="level_set: the surface shrank to nothing"):
        check_mesh(tiny, tiny, 1.0, 0.5, "mm")


@pytest.mark.parametrize(("factor", "said"), [(1.1, "33% more"), (0.9, "27% less")])
def test_a_mesh_that_encloses_far_more_or_less_than_its_wall_is_an_error(factor: float, said: str) -> None:
    wall = meshed(round_distance(14.0), 18.0)
    check_mesh(wall.with_vertices(1.05 * wall.vertices), wall, 1.0, 0.5, "mm")
    with pytest.raises(SolverError, match=said):
        check_mesh(wall.with_vertices(factor * wall.vertices), wall, 1.0, 0.5, "mm")
