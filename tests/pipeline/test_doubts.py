"""Cases whose parts are in order and cannot be meant together are refused or warned of, and no others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from chamber import chamber, measured, pose

from o3dls.arrays import Array
from o3dls.case import Case, Points
from o3dls.errors import InputError
from o3dls.evaluation.projection import project
from o3dls.geometry.similarity import TURN, apply
from o3dls.geometry.surface import Surface
from o3dls.pipeline.pipeline import Pipeline
from o3dls.pipeline.start import start_estimate
from o3dls.stages.deform import Deform
from o3dls.stages.icp import ICP
from o3dls.stages.landmarks import Landmarks

PRIOR = chamber(24)
SEED = 40_213


def usual(noise: float = 1.5) -> Case:
    return measured(PRIOR, pose(30.0, 40.0), noise=noise)


def changed(case: Case, change: Callable[[Array], Array]) -> Case:
    """The case with its eam points changed, and the landmarks as they were."""
    xyz = case.points.xyz.copy()
    eam = case.points.type == "eam"
    xyz[eam] = change(xyz[eam])
    return replace(case, points=Points(xyz, case.points.type, case.points.columns))


def marked_in_the_other_frame(middle: tuple[float, float, float], degrees: float) -> Case:
    """Landmarks of the prior in RAS beside a prior in LPS whose middle is somewhere in the scanner."""
    by = np.array(middle)
    case = measured(PRIOR.with_vertices(PRIOR.vertices + by), pose(degrees, 6.0), noise=1.0)
    marks = {name: apply(TURN, at[None])[0] for name, at in case.prior_landmarks.items()}
    return replace(case, prior_landmarks=marks)


def started_in_the_other_frame(case: Case, turned: str, degrees: float) -> Case:
    """An init matrix that was right before the points, or the prior, were read in the other frame."""
    case = replace(case, init=pose(degrees, 6.0), prior_landmarks={})
    if turned == "prior":
        return replace(case, prior=case.prior.transformed(TURN))
    return changed(case, lambda xyz: apply(TURN, xyz))


def with_noisy_marks(case: Case, noise: float, rng: np.random.Generator) -> Case:
    marks = (case.points.type == "landmark")[:, None]
    xyz = case.points.xyz + marks * rng.normal(0.0, noise, case.points.xyz.shape)
    return replace(case, points=replace(case.points, xyz=xyz))


def beats_at(case: Case, place: Array) -> Case:
    """The case and 2000 beats of one contact."""
    rng = np.random.default_rng(SEED)
    points = Points(
        np.vstack([case.points.xyz, place + rng.normal(0.0, 0.4, (2000, 3))]),
        np.append(case.points.type, np.full(2000, "eam")),
        {"name": np.append(case.points.columns["name"], np.full(2000, ""))},
    )
    return replace(case, points=points)


def glued(apart: float) -> Case:
    case = usual()
    vertices = np.vstack([PRIOR.vertices, 0.8 * PRIOR.vertices + [apart, 0.0, 0.0]])
    return replace(case, prior=Surface(vertices, np.vstack([PRIOR.faces, PRIOR.faces + len(PRIOR.vertices)])))


def in_a_plane() -> Case:
    flat = np.random.default_rng(SEED).normal(0.0, 0.3, 200)
    return changed(usual(), lambda xyz: np.column_stack([xyz[:, :2], xyz[:, 2].mean() + flat]))


def one_column_in(column: int, millimetres: float) -> Case:
    case = usual()
    scale = np.where(np.arange(3) == column, 1.0 / millimetres, 1.0)
    return replace(case, points=replace(case.points, xyz=case.points.xyz * scale))


def of_another_size(factor: float) -> Case:
    """The prior and its landmarks as by a voxel size that was lost."""
    case = usual()
    prior = case.prior.with_vertices(case.prior.vertices * factor)
    marks = {name: at * factor for name, at in case.prior_landmarks.items()}
    return replace(case, prior=prior, prior_landmarks=marks)


@pytest.mark.parametrize(
    ("case", "sentence"),
    [
        *(
            (of_another_size(by), f"the prior is {by:.2g} times as large as the map")
            for by in (2.0, 0.5, 3.0)
        ),
        (glued(12.0), "components overlap: together they enclose"),
        (in_a_plane(), "lie in one plane"),
        (one_column_in(0, 10.0), "the column x of the points seems to be in cm: the landmarks fit"),
        (one_column_in(2, 25.4), "the column z of the points seems to be in in: the landmarks fit"),
        (changed(usual(), lambda xyz: apply(TURN, xyz)), "one in LPS|ones in LPS and the others in RAS"),
    ],
    ids=[
        "twice",
        "half",
        "three times",
        "a second prior through the first",
        "a plane",
        "one column in cm",
        "in inches",
        "points in RAS",
    ],
)
def test_what_cannot_be_meant_is_refused(case: Case, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Pipeline([Landmarks(), ICP()], folds=0).run(case)


def on_a_ball() -> Case:
    directions = np.random.default_rng(SEED).normal(size=(200, 3))
    ball = 22.0 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return changed(usual(), lambda xyz: xyz.mean(axis=0) + ball)


def beside_the_wall(offset: float) -> Case:
    """Points 5 mm off the wall everywhere, beside landmarks on it."""
    case = usual(0.5)
    moved = PRIOR.transformed(pose(30.0, 40.0))

    def aside(xyz: Array) -> Array:
        return xyz + offset * moved.vertex_normals[moved.faces[project(xyz, moved).face]].mean(axis=1)

    return changed(case, aside)


def anywhere(share: float) -> Case:
    rng = np.random.default_rng(SEED)

    def strewn(xyz: Array) -> Array:
        chosen = rng.random(len(xyz)) < share
        return np.where(chosen[:, None], rng.uniform(xyz.min(axis=0), xyz.max(axis=0), xyz.shape), xyz)

    return changed(usual(), strewn)


@pytest.mark.parametrize(
    ("case", "code"),
    [
        (on_a_ball(), "points-on-a-ball"),
        (beside_the_wall(5.0), "points-beside-the-wall"),
        (beside_the_wall(-5.0), "points-beside-the-wall"),
        (anywhere(0.8), "large-noise"),
    ],
    ids=["a ball", "outside", "inside", "most points anywhere"],
)
def test_what_can_hardly_be_meant_is_warned_of(case: Case, code: str) -> None:
    run = Pipeline([Landmarks(), ICP()], folds=0).run(case)
    for estimate in run.estimates.values():
        assert code in {warning.code for warning in estimate.warnings}


@pytest.mark.parametrize(
    "case",
    [usual(), usual(2.0), glued(200.0), beside_the_wall(2.0), beside_the_wall(-2.0)],
    ids=["usual", "2 mm of noise", "two chambers side by side", "a little grown", "a little shrunk"],
)
def test_what_can_be_meant_is_fitted_without_a_word(case: Case) -> None:
    run = Pipeline([Landmarks(), ICP()], folds=0).run(case)
    doubts = {"points-on-a-ball", "points-beside-the-wall", "large-noise"}
    assert not doubts & {warning.code for one in run.estimates.values() for warning in one.warnings}


@pytest.mark.parametrize(("sd", "warned"), [(0.4, True), (1.2, False)])
def test_less_noise_than_a_catheter_has_is_asked_about(sd: float, warned: bool) -> None:
    run = Pipeline([Landmarks(), ICP(), Deform()], folds=0).run(usual(sd))
    of = {name: {warning.code for warning in one.warnings} for name, one in run.estimates.items()}
    assert ("small-noise" in of["deform"]) == warned
    assert of["deform"] >= of["icp"]


def test_two_thousand_beats_of_one_contact_inside_do_not_move_the_wall() -> None:
    case = usual()
    more = beats_at(case, case.points.of("eam").xyz.mean(axis=0) + np.array([3.0, 2.0, 1.0]))
    stages = [Landmarks(), ICP(), Deform()]
    found, known = (Pipeline(stages, folds=0).run(one).estimates["deform"] for one in (more, case))
    assert "duplicate-points" in {warning.code for warning in found.warnings}
    assert np.abs(found.surface.vertices - known.surface.vertices).max() < 1.0


@pytest.mark.parametrize("seed", [1, 4])
def test_two_thousand_beats_8_mm_inside_do_not_make_the_landmarks_look_swapped(seed: int) -> None:
    rng, at = np.random.default_rng(1000 + seed), pose(30.0, 40.0, seed=seed)
    case = with_noisy_marks(measured(PRIOR, at, noise=1.5), 1.7, rng)
    moved = PRIOR.transformed(at)
    contact = int(rng.integers(len(moved.vertices)))
    more = beats_at(case, moved.vertices[contact] - 8.0 * moved.vertex_normals[contact])
    alone, found = (Landmarks()(one, start_estimate(one)).T_map_prior for one in (case, more))
    assert np.array_equal(alone, found)


@pytest.mark.parametrize("middle", [(0.0, 0.0, 0.0), (5.0, -8.0, 3.0), (40.0, -150.0, 20.0)])
@pytest.mark.parametrize("degrees", [5.0, 40.0])
def test_a_prior_and_landmarks_of_two_frames_are_refused_with_the_reason(
    middle: tuple[float, float, float], degrees: float
) -> None:
    case = marked_in_the_other_frame(middle, degrees)
    with pytest.raises(InputError, match=r"one of them in LPS and the other in RAS\? Bring the prior and"):
        Pipeline([Landmarks(), ICP()], folds=0).run(case)


@pytest.mark.parametrize("turned", ["points", "prior"])
def test_a_start_of_the_other_frame_is_doubted_with_the_reason(turned: str) -> None:
    case = started_in_the_other_frame(measured(PRIOR, pose(40.0, 6.0), noise=1.0), turned, 40.0)
    run = Pipeline([ICP()], folds=0).run(case)
    said = {one.code: one.sentence for one in run.estimates["icp"].warnings}
    assert f"are the {turned} in RAS and the rest of the case in LPS" in said["start-pose-doubtful"]


@pytest.mark.parametrize("turned", ["points", "prior"])
def test_a_start_far_off_by_the_other_frame_is_refused_with_the_reason(turned: str) -> None:
    far = PRIOR.with_vertices(PRIOR.vertices + np.array([40.0, -150.0, 20.0]))
    case = started_in_the_other_frame(measured(far, pose(5.0, 6.0), noise=1.0), turned, 5.0)
    with pytest.raises(InputError, match=f"away from the prior .* are the {turned} in RAS and the rest of"):
        Pipeline([ICP()], folds=0).run(case)


def test_a_start_that_is_wrong_otherwise_is_not_blamed_on_the_frame() -> None:
    case = replace(measured(PRIOR, pose(5.0, 6.0), noise=1.0), prior_landmarks={}, init=pose(100.0, 6.0))
    said = [one.sentence for one in Pipeline([ICP()], folds=0).run(case).estimates["icp"].warnings]
    assert any("the start may be wrong" in one for one in said)
    assert not any("RAS" in one for one in said)


@pytest.mark.parametrize("degrees", [20.0, 40.0])
def test_left_and_right_exchanged_are_not_blamed_on_the_frame(degrees: float) -> None:
    case = measured(PRIOR, pose(degrees, 8.0))
    marks = {{"L": "R", "R": "L"}[name[0]] + name[1:]: at for name, at in case.prior_landmarks.items()}
    with pytest.raises(InputError, match="seem to be swapped"):
        Pipeline([Landmarks(), ICP()], folds=0).run(replace(case, prior_landmarks=marks))


@pytest.mark.parametrize("degrees", [5.0, 40.0])
@pytest.mark.parametrize("flipped", [True, False])
def test_a_flipped_prior_is_told_though_its_landmarks_are_named_by_the_side_where_they_seem_to_be(
    degrees: float, flipped: bool
) -> None:
    case = with_noisy_marks(measured(PRIOR, pose(degrees, 8.0), noise=1.5), 2.5, np.random.default_rng(SEED))
    if flipped:
        flip = np.diag([-1.0, 1.0, 1.0, 1.0])
        marks = {
            {"L": "R", "R": "L"}[name[0]] + name[1:]: apply(flip, at[None])[0]
            for name, at in case.prior_landmarks.items()
        }
        case = replace(case, prior=PRIOR.transformed(flip), prior_landmarks=marks)
    run = Pipeline([Landmarks(), ICP()], folds=0).run(case)
    said = [one for estimate in run.estimates.values() for one in estimate.warnings]
    told = [one.sentence for one in said if one.code == "start-pose-doubtful"]
    assert bool(told) == flipped
    if flipped:
        assert "flip one axis of the prior, and correct the names of its landmarks LSPV and LIPV" in told[0]


def test_names_that_may_be_either_place_are_said_and_decide_no_pose() -> None:
    case = measured(PRIOR, pose(30.0, 8.0), noise=1.0)
    other = {"LSPV": "LUPV", "RSPV": "RUPV", "LIPV": "one", "RIPV": "two"}  # beside LIPV U would be upper
    named = np.array([other.get(name, name) for name in case.points.columns["name"]])
    points = replace(case.points, columns={**case.points.columns, "name": named})
    marks = {name: case.prior_landmarks[name] for name in ("LSPV", "RSPV")}
    case = replace(case, points=points, prior_landmarks=marks, init=pose(30.0, 8.0))
    run = Pipeline([ICP()], folds=0).run(case)
    said = [one for one in run.estimates["icp"].warnings if one.code == "landmark-names-doubtful"]
    assert "LUPV, RUPV may be upper or lower veins" in said[0].sentence
    assert not case.landmark_partners()
