"""Real surfaces that move: by as much as asked, without folds, the same for the same seed; and what is
written of them. A made atrium stands for the real one.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from data_synth import Mapping, cross, family, shapes
from data_synth.alignment import alongside, common_places
from data_synth.atrium import anatomy
from data_synth.families import FAMILIES, LEFT, moved, remains
from data_synth.meshing import mesh
from data_synth.motion import turn
from data_synth.pose import matrix, similarity_of, under
from data_synth.wall import crosses, far_places, flipped, read_wall, ways
from o3dls import Case, InputError, Surface, read_case, write_surface
from o3dls.evaluation.distances import distances
from o3dls.evaluation.validity import validity

SEED = 61_487
COARSE = 3.0  # mm between vertices: fast
EVEN = Mapping(points=400, clustered=False)


def made(seed: int) -> Surface:
    body = anatomy(np.random.default_rng(seed))
    return mesh(body.shape, (-50, -45, -42), (50, 45, 48), COARSE)


@pytest.fixture(scope="module")
def rest() -> Surface:
    return made(SEED)


@pytest.mark.parametrize("strength", [1.0, 2.0])
@pytest.mark.parametrize("name", FAMILIES)
def test_a_family_moves_by_as_much_as_asked_and_does_not_fold(
    name: str, strength: float, rest: Surface
) -> None:
    found = moved(rest, name, np.random.default_rng(SEED), strength)
    left = remains(rest, found.vertices)
    assert 0.95 * strength * LEFT[0] < left < 1.05 * strength * LEFT[1]
    # by another measure: the wall is that far from where the best similarity of the vertices puts it
    posed = rest.transformed(similarity_of(rest.vertices, found.vertices))
    away = np.sqrt((distances(posed.vertices, found) ** 2).mean())
    assert 0.7 * left < away < 1.5 * left
    assert flipped(rest, found.vertices) == 0
    assert validity(found, rest)["self_intersections"] == 0


@pytest.mark.parametrize("name", FAMILIES)
def test_a_family_is_drawn_by_its_seed_alone(name: str, rest: Surface) -> None:
    one, again, other = (moved(rest, name, np.random.default_rng(seed)) for seed in (SEED, SEED, SEED + 1))
    assert np.array_equal(one.vertices, again.vertices)
    assert np.abs(one.vertices - other.vertices).max() > 1.0


def test_a_similarity_leaves_nothing(rest: Surface) -> None:
    pose = matrix(1.07 * turn(np.random.default_rng(SEED), 0.4), np.array([5.0, -3.0, 11.0]))
    assert remains(rest, under(pose, rest.vertices)) < 1e-6


def test_a_family_that_there_is_not(rest: Surface) -> None:
    with pytest.raises(InputError, match="no family of motion 'flw'"):
        moved(rest, "flw", np.random.default_rng(SEED))


def test_the_case_of_a_family_starts_from_landmarks(rest: Surface) -> None:
    case = family(rest, SEED, how=EVEN)
    assert case.init is None
    names, prior, marks = case.landmark_pairs()
    assert names == ["L1", "L2", "L3", "L4"]
    assert distances(prior, rest).max() < 1e-3
    start = under(similarity_of(prior, marks), case.prior.vertices)
    assert np.linalg.norm(start - surface(case).vertices, axis=1).mean() < 8.0
    at, to = case.truth.correspondence
    assert distances(at, case.prior).max() < 1e-9
    assert distances(to, surface(case)).max() < 1e-9
    assert not case.truth.unseen.any()
    assert len(case.truth.outliers) == 0


def test_without_landmarks_the_start_is_rough(rest: Surface) -> None:
    case = family(rest, SEED, landmarks=False, how=EVEN)
    assert not case.prior_landmarks
    assert not (case.points.type == "landmark").any()
    exact = similarity_of(case.prior.vertices, surface(case).vertices)
    off = case.init @ np.linalg.inv(exact)
    scale = np.cbrt(np.linalg.det(off[:3, :3]))
    angle = np.degrees(np.arccos((np.trace(off[:3, :3]) / scale - 1.0) / 2.0))
    assert 2.0 < angle < 14.0  # 3 to 10 and what the motion itself turns
    assert 0.85 < scale < 1.15


def surface(case: Case) -> Surface:
    assert case.truth is not None
    assert case.truth.surface is not None
    return case.truth.surface


@pytest.mark.parametrize("make", ["family", "cross"])
def test_points_are_as_asked(make: str, rest: Surface) -> None:
    how = Mapping(points=1500, noise=None, clustered=True, outliers=0.1, told=True)
    case = (
        family(rest, SEED, family="regions", how=how)
        if make == "family"
        else cross(rest, rest, SEED, how=how, near=np.eye(4))
    )
    truth, eam = case.truth, case.points.type == "eam"
    assert eam.sum() == 1500
    assert len(truth.outliers) == 150
    assert truth.unseen.mean() == pytest.approx(0.25, abs=0.03)
    away = distances(case.points.xyz, surface(case))
    sigma = case.points.numbers("sigma")
    wall = np.setdiff1d(np.flatnonzero(eam), truth.outliers)
    assert 0.5 <= sigma[wall].min() < 0.6 < 1.9 < sigma[wall].max() <= 2.0
    assert np.sqrt(((away / sigma)[wall] ** 2).mean()) == pytest.approx(1.0, abs=0.1)
    assert np.median(away[truth.outliers]) > 3.0


@pytest.mark.parametrize("make", ["family", "cross"])
def test_the_same_seed_gives_the_same_case(make: str, rest: Surface) -> None:
    def made_again(seed: int) -> Case:
        how = Mapping(points=80, outliers=0.1)
        return (
            family(rest, seed, how=how)
            if make == "family"
            else cross(rest, rest, seed, how=how, near=np.eye(4))
        )

    one, again, other = (made_again(seed) for seed in (SEED, SEED, SEED + 1))
    assert np.array_equal(one.points.xyz, again.points.xyz)
    assert np.array_equal(surface(one).vertices, surface(again).vertices)
    assert np.array_equal(one.truth.held_out, again.truth.held_out)
    assert np.array_equal(one.truth.outliers, again.truth.outliers)
    assert np.abs(one.points.xyz - other.points.xyz).max() > 1.0


def test_noise_and_number_leave_the_motion_alone(rest: Surface) -> None:
    one, other = (
        family(rest, SEED, family="piston", how=how)
        for how in (EVEN, Mapping(points=50, noise=2.0, outliers=0.05))
    )
    assert np.array_equal(surface(one).vertices, surface(other).vertices)
    assert one.prior_landmarks["L3"] == pytest.approx(other.prior_landmarks["L3"])


def test_far_places_are_far(rest: Surface) -> None:
    places = far_places(rest, 4)
    apart = ways(rest, places)[:, places] + np.diag(np.full(4, np.inf))
    assert apart.min() > 30.0


def test_another_pose_of_one_anatomy_is_found_by_its_shape(rest: Surface) -> None:
    pose = matrix(1.1 * turn(np.random.default_rng(SEED), 2.0), np.array([60.0, -20.0, 5.0]))
    other = rest.transformed(pose)
    found = alongside(rest, other)
    assert np.abs(under(found, rest.vertices) - other.vertices).max() < 0.5
    ours, theirs = common_places(rest.transformed(found), other)
    assert np.linalg.norm(ours - theirs, axis=1).max() < 0.5
    assert (np.linalg.norm(theirs[:, None] - theirs, axis=2) + np.diag(np.full(4, np.inf))).min() > 8.0


def test_a_crossed_case_starts_near_the_other_anatomy(rest: Surface) -> None:
    other = made(SEED + 1)
    near = alongside(rest, other)
    marked = cross(rest, other, SEED, how=EVEN, near=near)
    _, prior, marks = marked.landmark_pairs()
    rough = cross(rest, other, SEED, landmarks=False, how=EVEN, near=near)
    assert np.array_equal(surface(marked).vertices, surface(rough).vertices)
    for pose, most in ((similarity_of(prior, marks), 5.0), (rough.init, 10.0)):
        posed = rest.transformed(pose)
        assert distances(surface(marked).vertices, posed).mean() < most


def test_vessels_are_cut_where_they_are_long(tmp_path: Path) -> None:
    chamber = shapes.ball((0, 0, 0), 15.0)
    vein = shapes.chain([(0, 0, 0), (70, 4, 0)], [5.0, 4.0])
    write_surface(
        tmp_path / "long.ply", mesh(shapes.union(chamber, vein), (-18, -18, -18), (78, 18, 18), 2.0)
    )
    whole, cut = (read_wall(tmp_path / "long.ply", reach) for reach in (None, 1.9))
    assert whole.vertices[:, 0].max() > 70.0
    assert 25.0 < cut.vertices[:, 0].max() < 45.0
    assert cut.watertight
    assert cut.volume < whole.volume
    assert not crosses(cut).any()


def test_an_open_surface_is_no_wall(rest: Surface, tmp_path: Path) -> None:
    write_surface(tmp_path / "open.ply", Surface(rest.vertices, rest.faces[5:]))
    with pytest.raises(InputError, match=r"open\.ply: must be a closed surface"):
        read_wall(tmp_path / "open.ply")


FILES = {"manifest.txt", "case.toml", "prior.ply", "truth.ply", "points.csv", "held_out.csv", "outliers.csv"}


@pytest.mark.parametrize(
    ("arguments", "more"),
    [
        (
            ("family", "--family", "piston", "--noise", "per-point"),
            {"prior_landmarks.csv", "correspondence.csv"},
        ),
        (("family", "--no-landmarks", "--even"), {"init.csv", "correspondence.csv"}),
        (("cross", "--truth", "wall.ply", "--points", "60"), {"prior_landmarks.csv"}),
    ],
)
def test_the_commands_write_case_folders(
    arguments: tuple[str, ...], more: set[str], rest: Surface, tmp_path: Path
) -> None:
    write_surface(tmp_path / "wall.ply", rest)
    given = [str(tmp_path / "wall.ply") if a == "wall.ply" else a for a in arguments]
    command = [
        sys.executable,
        "-m",
        "data_synth",
        *given,
        "--prior",
        str(tmp_path / "wall.ply"),
        str(tmp_path / "c"),
    ]
    subprocess.run([*command, "--outliers", "0.05"], cwd=ROOT, check=True, capture_output=True)
    assert {path.name for path in (tmp_path / "c").iterdir()} == FILES | more
    assert (
        read_case(tmp_path / "c").name
        == f"{arguments[0]}_"
        + ("piston_" * ("piston" in arguments) or "flow_" * (arguments[0] == "family"))
        + "7"
    )


def test_a_noise_that_is_no_length_is_refused(rest: Surface, tmp_path: Path) -> None:
    write_surface(tmp_path / "wall.ply", rest)
    command = [sys.executable, "-m", "data_synth", "family", "--prior", str(tmp_path / "wall.ply")]
    command += [str(tmp_path / "c"), "--noise", "much"]
    said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert said.returncode == 2
    assert "must be a length in mm, 0 or more, or per-point" in said.stderr
