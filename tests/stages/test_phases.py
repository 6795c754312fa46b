"""Stage `phases`: points of a phase between two known ones are found there, whatever the meshes, and the pose
stays what it is.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fields import body, spots

from o3dls import (
    Case,
    Deform,
    Estimate,
    InputError,
    Phases,
    Pipeline,
    PipelineError,
    Points,
    Surface,
    read_case,
    read_pipeline,
    write_case,
)
from o3dls.evaluation.distances import distances, moved, sample
from o3dls.geometry.closest_point import ClosestPoint
from o3dls.geometry.similarity import apply, similarity
from o3dls.geometry.twist import Twist
from o3dls.motion.settings import TemplateSettings
from o3dls.motion.template import Template, _Points, locate, template
from o3dls.plugins.catalogue import sheet

NOISE = 0.3


def ball(stretch: float) -> Surface:
    """An ellipsoid of 30 mm that has grown along x and thinned along y."""
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=3, radius=30.0)
    return Surface(np.asarray(mesh.vertices) * [stretch, 1.0 / stretch, 1.0], np.asarray(mesh.faces))


WHOLE = TemplateSettings(variance=1.0)
STRETCHES = (1.0, 1.06, 1.12, 1.18, 1.24)


def case(at: float, *, mesh_again: bool = False) -> Case:
    """Points of a stretch; the phases as meshes of their own where asked."""
    prior, *others = (ball(s) for s in STRETCHES)
    if mesh_again:
        others = [Surface(o.vertices, np.roll(o.faces, 1, axis=0)) for o in others]
    rng = np.random.default_rng(77041)
    points = sample(ball(at), 150) + NOISE * rng.normal(size=(150, 3))
    return Case("beating", prior, Points(points, np.repeat(["eam"], 150)), phases=tuple(others))


def fitted(of: Case) -> Estimate:
    return Pipeline([Phases()], folds=0).fit(of)["phases"]


@pytest.mark.parametrize("mesh_again", [False, True])
def test_a_phase_between_known_ones_is_found(mesh_again: bool) -> None:
    found = fitted(case(1.15, mesh_again=mesh_again))
    assert found.facts["phase"] == pytest.approx(2.5, abs=0.3)
    assert distances(sample(ball(1.15), 3000), found.surface).mean() < 0.5 * NOISE
    assert found.converged, found.status


def test_the_motion_leads_from_the_prior_to_the_surface() -> None:
    given = case(1.15)
    found = fitted(given)
    assert np.abs(moved(found, given.prior.vertices) - found.surface.vertices).max() < 0.2
    sd = found.motion.sd(given.prior.vertices[:10], found.surface.vertex_normals[:10])  # type: ignore[union-attr]
    assert (sd > 0.0).all()


def test_landmarks_go_along_with_the_phase() -> None:
    """Vertices are told apart by landmarks: those of the prior's own phase would pull the found one back."""
    missed = []
    for marked in (False, True):
        of = case(1.15)
        few = of.points.select(np.arange(20))
        stretch = ball(1.15).vertices - ball(STRETCHES[0]).vertices
        at = [int(np.argmax(of.prior.vertices @ way)) for way in (*np.eye(3), *-np.eye(3))]
        names = [f"m{k}" for k in range(len(at))]
        xyz = np.vstack([few.xyz, (of.prior.vertices + stretch)[at]])
        points = Points(
            xyz, np.array(["eam"] * 20 + ["landmark"] * len(at)), {"name": np.array([""] * 20 + names)}
        )
        marks = dict(zip(names, of.prior.vertices[at], strict=True))
        given = (
            replace(of, points=points, prior_landmarks=marks, init=np.eye(4))
            if marked
            else replace(of, points=few)
        )
        start = Estimate(of.prior, np.eye(4), "as it stands")
        missed.append(
            np.linalg.norm(
                Phases()(given, start).surface.vertices - of.prior.vertices - stretch, axis=1
            ).mean()
        )
    assert missed[1] < 0.3 * missed[0]  # measured: .09; .70 with the landmarks of the prior's own phase


def test_a_turned_map_turns_the_result() -> None:
    given = case(1.15)
    turn = similarity(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([5.0, 7.0, -3.0]))
    there = replace(given, points=replace(given.points, xyz=apply(turn, given.points.xyz)), init=turn)
    assert np.allclose(fitted(there).surface.vertices, apply(turn, fitted(given).surface.vertices), atol=0.02)


def test_points_of_a_known_phase_are_placed_on_it() -> None:
    assert fitted(case(STRETCHES[3])).facts["phase"] == pytest.approx(3.0, abs=0.3)


def test_the_template_holds_every_phase_that_it_was_made_of() -> None:
    surfaces = [ball(s) for s in STRETCHES]
    model = template(
        surfaces[0].vertices, surfaces[0].faces, [(s.vertices, s.faces) for s in surfaces[1:]], WHOLE
    )
    for surface, c in zip(surfaces, model.coefficients, strict=True):
        assert np.allclose(model.shape(c), surface.vertices, atol=1e-6)
    assert [model.between(c) for c in model.coefficients] == pytest.approx(range(5))


def test_without_phases_the_stage_says_what_is_missing() -> None:
    alone = replace(case(1.1), phases=())
    with pytest.raises(InputError, match="phases/"):
        Pipeline([Phases()], folds=0).run(alone)


def test_phases_are_kept_in_the_case_folder(tmp_path: Path) -> None:
    given = case(1.1)
    write_case(tmp_path / "case", given)
    again = read_case(tmp_path / "case")
    assert len(again.phases) == len(STRETCHES) - 1
    assert np.allclose(again.phases[-1].vertices, given.phases[-1].vertices, atol=1e-5)
    assert any(name.startswith("phases") or name.startswith("01") for name in again.files)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_small_motion_of_the_pose_is_made_seen_and_read_back_alike(dimension: int) -> None:
    """What it does along the normals is linear in it, and it is what two poses differ by."""
    surface = body(dimension)
    rng = np.random.default_rng(5)
    twist = Twist(dimension)
    middle = surface.vertices.mean(axis=0)
    normals = surface.vertex_normals
    change = 1e-5 * rng.normal(size=twist.size)
    made = twist.motion(change, middle)
    along = ((apply(made, surface.vertices) - surface.vertices) * normals).sum(axis=1)
    np.testing.assert_allclose(
        along, np.einsum("nd,ndk->nk", normals, twist.tangent(surface.vertices, middle)) @ change, atol=1e-8
    )
    model = Template(
        surface.vertices, np.zeros((1, *surface.vertices.shape)), np.zeros((2, 1)), surface.faces, WHOLE
    )
    start = similarity(np.linalg.qr(rng.normal(size=(dimension, dimension)))[0], np.full(dimension, 9.0))
    problem = _Points(model, surface.vertices, ClosestPoint(surface.vertices, surface.faces), start)
    np.testing.assert_allclose(problem.off(made @ start, apply(made, middle[None])[0]), change, atol=1e-8)


def test_a_pose_that_is_sure_stays_however_far_the_points_are() -> None:
    prior, *others = (ball(s) for s in STRETCHES[:3])
    model = template(prior.vertices, prior.faces, [(o.vertices, o.faces) for o in others], WHOLE)
    points = spots(others[0], 150, 5)[0] + [3.0, 0.0, 0.0]
    free, held = (
        locate(replace(model, settings=replace(WHOLE, pose_sd=sd)), np.eye(4), points) for sd in (10.0, 0.02)
    )
    assert free.pose[0, 3] == pytest.approx(3.0, abs=0.3)
    assert abs(held.pose[0, 3]) < 0.3


@pytest.mark.parametrize("seed", range(4))
def test_few_noisy_points_do_not_lead_off_the_way_through_the_phases(seed: int) -> None:
    rng = np.random.default_rng(3)
    prior, *others = (ball(s) for s in STRETCHES)
    vertices = [surface.vertices * [1.0, 1.0, 1.0 + 0.02 * rng.normal()] for surface in (prior, *others)]
    model = template(vertices[0], prior.faces, [(moved, prior.faces) for moved in vertices[1:]], WHOLE)
    points = spots(Surface(vertices[2], prior.faces), 12, seed)[0] + 1.5 * np.random.default_rng(seed).normal(
        size=(12, 3)
    )
    found = locate(replace(model, settings=replace(WHOLE, pose_sd=0.5)), np.eye(4), points)
    assert (np.abs(found.c - model.at(model.between(found.c))) / model.aside).max() < 2.0


def test_the_parameters_of_deform_are_a_table(tmp_path: Path) -> None:
    """The same from TOML and from Python, with mistakes named by where they stand."""
    file = tmp_path / "phases.toml"
    file.write_text('[[stage]]\nuse = "phases"\n[stage.deform]\nodds = 2.0\nablation = "fit"\n')
    wanted = Phases(deform=Deform(odds=2.0, ablation="fit"))
    assert read_pipeline(file).stages == (wanted,)
    assert wanted.fits == ("eam", "inside", "ablation")
    assert read_pipeline(file, ["phases.deform.odds=3"]).stages[0] == Phases(
        deform=Deform(odds=3.0, ablation="fit")
    )
    file.write_text('[[stage]]\nuse = "phases"\n[stage.deform]\namplitude_log_sd = -1.0\nas = "x"\nodd = 1\n')
    with pytest.raises(PipelineError) as error:
        read_pipeline(file)
    told = "; ".join(error.value.args)
    assert "phases.deform.amplitude_log_sd = -1.0: must be a number within (0, inf)" in told
    assert "phases.deform.odd: no such parameter: did you mean 'odds'?" in told


def test_a_deform_inside_phases_has_no_place_in_a_pipeline() -> None:
    with pytest.raises(PipelineError, match=r"phases.deform.as: no such parameter"):
        Phases(deform=Deform(as_="moved"))
    assert "as" not in Phases().record()["deform"]
    assert "deform.after" not in sheet("phases")
    assert "deform.odds = 0.0 nats" in sheet("phases")


def test_the_parameters_of_deform_are_used() -> None:
    of = case(1.15)
    start = Estimate(of.prior, np.eye(4), "as it stands")
    held = Phases(deform=Deform(odds=1e6))(of, start)
    assert held.facts["motion_probability"] < 0.01
