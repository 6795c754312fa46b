"""The synthetic cases are what they say: distances are distances, noise and unseen areas are as asked, truth
is truth.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from conftest import ROOT

from data_synth import atrium, jar, motion, patient, roughened, shapes, star
from data_synth.atrium import anatomy, heartbeat
from data_synth.jar import shape as jar_shape
from data_synth.meshing import mesh
from data_synth.sampling import activation, patches, sites
from data_synth.shapes import Array, Shape
from data_synth.star import shape as star_shape
from o3dls import ICP, Case, Landmarks, Pipeline, Surface, read_case
from o3dls.evaluation.distances import distances
from o3dls.evaluation.validity import validity
from o3dls.geometry.similarity import fit_similarity
from o3dls.resources import demo_case

SEED = 50311
EXACT: dict[str, tuple[Shape, int]] = {
    "ball": (shapes.ball((1.0, -2.0, 3.0), 5.0), 3),
    "half space": (shapes.half_space((0.6, 0.0, 0.8), 2.0), 3),
    "ellipsoid": (shapes.ellipsoid((6.0, 3.0, 4.0)), 3),
    "round cone": (shapes.round_cone((-3.0, 0.0, 1.0), (4.0, 2.0, 0.0), 3.0, 1.5), 3),
    "star": (shapes.move(star_shape(), (-100.0, -96.0)), 2),
    "jar": (shapes.move(jar_shape(), (-30.0, -30.0, -40.0)), 3),
}
SIZE = {"star": 100.0, "jar": 45.0}


@pytest.fixture(scope="module")
def case() -> Case:
    return atrium(SEED, noise=1.3, unseen=0.2, outliers=0.06, points=400)


def cloud(dimension: int, size: float, n: int = 2000) -> Array:
    return np.random.default_rng(SEED).uniform(-size, size, (n, dimension))


@pytest.mark.parametrize("name", EXACT)
def test_the_gradient_of_a_distance_has_length_one(name: str) -> None:
    """But for the medial axis, where the foot point jumps: a few of the random points may lie there."""
    shape, dimension = EXACT[name]
    length = np.linalg.norm(shapes.gradient(shape, cloud(dimension, SIZE.get(name, 8.0)), 1e-4), axis=1)
    assert np.mean(np.abs(length - 1.0) < 1e-4) > 0.99


@pytest.mark.parametrize("name", EXACT)
def test_a_step_by_the_distance_ends_on_the_surface(name: str) -> None:
    shape, dimension = EXACT[name]
    points = cloud(dimension, SIZE.get(name, 8.0))
    foot = points - shape(points)[:, None] * shapes.gradient(shape, points, 1e-4)
    assert np.quantile(np.abs(shape(foot)), 0.99) < 1e-3


def test_negative_inside() -> None:
    on_axes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 5.0], [7.0, 0.0, 0.0]])
    assert shapes.ellipsoid((6.0, 3.0, 4.0))(on_axes) == pytest.approx([-3.0, 1.0, 1.0], abs=1e-6)
    centre, above_the_tip = star_shape()(np.array([[100.0, 96.0], [100.0, 190.0]]))
    assert centre < 0.0
    assert above_the_tip == pytest.approx(14.0)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_polygon_may_run_in_either_direction(direction: int) -> None:
    square = shapes.polygon(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])[::direction])
    assert square(np.array([[2.0, 1.0], [7.0, 8.0], [-1.0, 2.0]])) == pytest.approx([-1.0, 5.0, 1.0])


def test_blends_change_only_what_is_near_the_groove() -> None:
    left, right = shapes.ball((-2.0, 0.0, 0.0), 3.0), shapes.ball((2.0, 0.0, 0.0), 3.0)
    points = cloud(3, 8.0)
    sharp = shapes.union(left, right)(points)
    soft = shapes.union(left, right, blend=1.0)(points)
    apart = np.abs(left(points) - right(points)) >= 1.0
    assert (soft[apart] == sharp[apart]).all()
    assert (soft <= sharp).all()
    assert (sharp - soft).max() <= 0.25
    assert shapes.intersection(left, right)(points) == pytest.approx(np.maximum(left(points), right(points)))


@pytest.mark.parametrize("lacks", ["prior", "truth"])
def test_one_surface_lacks_a_vein_and_all_that_belongs_to_it(lacks: Literal["prior", "truth"]) -> None:
    both = atrium(SEED)
    one = atrium(SEED, lacks=lacks)
    known = set(one.prior_landmarks)
    marked = set(one.points.columns["name"]) - {""}
    assert len(known ^ marked) == 1
    assert len(marked if lacks == "truth" else known) == 3
    assert f"the {lacks} lacks the {(known ^ marked).pop()}" in one.notes
    smaller, same = (one.truth.surface, one.prior) if lacks == "truth" else (one.prior, one.truth.surface)
    whole, like = (both.truth.surface, both.prior) if lacks == "truth" else (both.prior, both.truth.surface)
    assert smaller.volume < 0.99 * whole.volume
    assert same.volume == pytest.approx(like.volume)
    assert smaller.watertight
    at, to = one.truth.correspondence
    assert distances(at, one.prior).max() < 1e-9
    assert distances(to, one.truth.surface).max() < 0.2  # chords of the mesh
    assert len(at) < len(both.truth.correspondence[0])


def test_noise_of_the_prior_moves_its_vertices_and_nothing_else() -> None:
    smooth = atrium(3)
    rough = roughened(smooth, 1.5, 3)
    assert (rough.prior.vertices - smooth.prior.vertices).std() == pytest.approx(1.5, rel=0.02)
    assert rough.points is smooth.points
    assert roughened(smooth, 0.0, 3) is smooth


def test_a_mesh_lies_on_its_shape_and_is_closed() -> None:
    shape = shapes.ellipsoid((9.0, 6.0, 7.0))
    surface = mesh(shape, (-11, -11, -11), (11, 11, 11), 1.0)
    assert np.abs(shape(surface.vertices)).max() < 1e-6
    assert surface.watertight
    assert surface.volume == pytest.approx(4.0 / 3.0 * np.pi * 9.0 * 6.0 * 7.0, rel=0.01)


@pytest.mark.parametrize("name", ["strain", "tilt", "drag", "wobble"])
def test_motions_do_not_fold(name: str) -> None:
    """The Jacobian's determinant stays positive at the sizes that the cases use."""
    rng = np.random.default_rng(SEED)
    moved = {
        "strain": motion.strain((1.1, 0.9, 1.05)),
        "tilt": motion.tilt((1.0, 0.2, 0.1), np.deg2rad(7.0), 20.0),
        "drag": motion.drag(rng.normal(0, 20, (4, 3)), rng.normal(0, 4, (4, 3)), 10.0),
        "wobble": motion.wobble(rng, 2.0, 10.0, 3),
    }[name]
    points = cloud(3, 30.0)
    step = 1e-3
    columns = [(moved(points + e) - moved(points - e)) / (2 * step) for e in step * np.eye(3)]
    assert np.linalg.det(np.stack(columns, axis=2)).min() > 0.0


def test_wobble_has_the_size_and_length_it_is_asked_for() -> None:
    moved = motion.wobble(np.random.default_rng(SEED), 0.5, 6.0, 3)
    points = cloud(3, 100.0)
    shift = moved(points) - points
    step = np.array([1e-3, 0.0, 0.0])
    slope = (moved(points + step) - points - step - shift) / 1e-3
    assert shift.std() == pytest.approx(0.5, rel=0.15)
    # of a squared-exponential field; 200 waves have no even share of directions
    assert slope.std() == pytest.approx(0.5 / 6.0, rel=0.25)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_bend_is_as_large_as_it_is_asked_for_whatever_the_seed(dimension: int) -> None:
    points = cloud(dimension, 30.0)
    for seed in (SEED, 40_287, 91_436):
        moved = motion.bend(np.random.default_rng(seed), points, 2.5, 40.0)(points)
        assert motion.rms(motion.no_rigid(points, moved)) == pytest.approx(2.5, rel=1e-3)


def test_a_blend_is_the_other_motion_at_a_centre_and_the_one_far_away() -> None:
    def still(p):
        return p

    def shifted(p):
        return p + np.array([0.0, 0.0, 2.0])

    # three centres in one place: wholly the other's
    blended = motion.blend(still, shifted, 1.0, np.zeros((3, 3)), 5.0)
    assert blended(np.array([[0.0, 0.0, 0.0], [50.0, 0.0, 0.0]])) == pytest.approx(
        np.array([[0.0, 0.0, 2.0], [50.0, 0.0, 0.0]]), abs=0.02
    )


def test_bulges_find_their_places_whatever_the_draw() -> None:
    """Two directions can leave no place for a third: the draw begins anew."""
    from data_synth.patient import _apart

    veins = np.eye(3)[[0, 0, 1, 1]]
    for seed in range(60):
        found = _apart(np.random.default_rng(seed), 3, veins)
        assert found.shape == (3, 3)
        assert (found @ found.T - np.eye(3)).max() < 0.5


@pytest.mark.parametrize("seed", [5101, 5102])
def test_the_usual_registration_of_a_patient_errs_as_in_the_paper(seed: int) -> None:
    case = patient(seed).case
    found = Pipeline([Landmarks(), ICP(preset="standard")], folds=0).fit(case)["icp"].surface
    assert distances(case.points.of("eam").xyz, found).mean() == pytest.approx(4.5, abs=0.5)
    assert distances(case.points.of("ablation").xyz, found).mean() == pytest.approx(3.2, abs=0.5)


def test_the_same_seed_gives_the_same_case(case: Case) -> None:
    again = atrium(SEED, noise=1.3, unseen=0.2, outliers=0.06, points=400)
    assert same(again, case) == 0.0
    assert atrium(SEED + 1).points.xyz[0] != pytest.approx(again.points.xyz[0], abs=0.1)


def same(one: Case, other: Case) -> float:
    """Largest difference in position between two cases of equal make-up."""
    assert one.truth is not None
    assert other.truth is not None
    assert (one.prior.faces == other.prior.faces).all()
    assert (one.points.type == other.points.type).all()
    assert list(one.prior_landmarks) == list(other.prior_landmarks)
    assert np.array_equal(one.truth.unseen, other.truth.unseen)  # type: ignore[arg-type]
    assert np.array_equal(one.truth.outliers, other.truth.outliers)  # type: ignore[arg-type]
    pairs = [
        (one.prior.vertices, other.prior.vertices),
        (one.points.xyz, other.points.xyz),
        (held_out(one), held_out(other)),
    ]
    pairs += [(truth(one).vertices, truth(other).vertices)]
    return max(float(np.abs(a - b).max()) for a, b in pairs)


def truth(case: Case) -> Surface:
    assert case.truth is not None
    assert case.truth.surface is not None
    return case.truth.surface


def held_out(case: Case) -> Array:
    assert case.truth is not None
    assert case.truth.held_out is not None
    return case.truth.held_out


def test_more_noise_or_points_leave_the_anatomy_alone(case: Case) -> None:
    other = atrium(SEED, noise=0.4, points=50)
    assert (truth(other).vertices == truth(case).vertices).all()
    assert (other.prior.vertices == case.prior.vertices).all()


def test_without_motion_only_a_similarity_and_the_segmentation_error_are_left() -> None:
    still = atrium(SEED, motion=0.0)
    fitted = still.prior.transformed(fit_similarity(still.prior.vertices, truth(still).vertices))
    assert np.linalg.norm(fitted.vertices - truth(still).vertices, axis=1).mean() < 0.7  # 0.3 mm per axis


def test_noise_and_outliers_are_as_asked(case: Case) -> None:
    assert case.truth is not None
    assert case.truth.outliers is not None
    inside = np.zeros(len(case.points), dtype=bool)
    inside[case.truth.outliers] = True
    eam = case.points.type == "eam"
    assert inside.sum() == round(0.06 * 400)
    away = distances(case.points.xyz, truth(case))
    # of three axes one is across the wall
    assert np.sqrt((away[eam & ~inside] ** 2).mean()) == pytest.approx(1.3, rel=0.1)
    assert np.median(away[inside]) > 3.0


def test_the_unseen_share_is_as_asked(case: Case) -> None:
    assert case.truth is not None
    assert case.truth.unseen is not None
    assert case.truth.unseen.mean() == pytest.approx(0.2, abs=0.03)
    hidden = held_out(case)[case.truth.unseen]
    eam = case.points.of("eam").xyz
    near = np.linalg.norm(hidden[:, None] - eam, axis=2).min(axis=1)
    seen = np.linalg.norm(held_out(case)[~case.truth.unseen][:, None] - eam, axis=2).min(axis=1)
    assert np.median(near) > 2.0 * np.median(seen)


@pytest.fixture(scope="module", params=[atrium, jar, star], ids=["atrium", "jar", "star"])
def made(request: pytest.FixtureRequest) -> Case:
    whole: Case = request.param(SEED)
    return whole


def test_held_out_points_lie_on_the_truth(made: Case) -> None:
    assert distances(held_out(made), truth(made)).max() < 1e-9


def test_surfaces_are_valid_and_differ_by_a_few_millimetres(made: Case) -> None:
    for surface in (made.prior, truth(made)):
        found = validity(surface, made.prior)
        assert (
            found["watertight"],
            found["components"],
            found["self_intersections"],
            found["flipped_faces"],
        ) == (True, 1, 0, 0)
    fitted = made.prior.transformed(fit_similarity(made.prior.vertices, truth(made).vertices))
    assert 0.5 < distances(fitted.vertices, truth(made)).mean() < 5.0


def test_the_moved_shape_is_the_truth(case: Case) -> None:
    """Vertices of the truth, taken through the motion, come from the zero set of the analytic anatomy."""
    streams = np.random.default_rng((SEED, 6871)).spawn(5)
    body = anatomy(streams[1])
    imaged = mesh(body.shape, (-50, -45, -42), (50, 45, 48), 1.5)
    # blends have no unit gradient: Newton's last step is small, not nothing
    assert np.abs(body.shape(imaged.vertices)).max() < 1e-2
    assert heartbeat(streams[2], body, 1.0)(imaged.vertices) == pytest.approx(truth(case).vertices)


def test_ablation_rings_and_landmarks_lie_about_the_veins(case: Case) -> None:
    names, prior, marks = case.landmark_pairs()
    assert names == ["LSPV", "LIPV", "RSPV", "RIPV"]
    assert prior.shape == (4, 3)
    away = np.linalg.norm(case.points.of("ablation").xyz[:, None] - marks, axis=2).min(axis=1)
    assert np.quantile(away, 0.9) < 18.0


def test_points_of_the_other_atrium_are_outliers_behind_the_others() -> None:
    plain = atrium(SEED)
    more = atrium(SEED, beside=40)
    np.testing.assert_array_equal(more.points.xyz[:-40], plain.points.xyz)
    np.testing.assert_array_equal(more.truth.outliers[-40:], np.arange(len(plain.points), len(more.points)))
    assert distances(more.points.xyz[-40:], more.truth.surface).max() > 25.0
    assert (more.points.type[-40:] == "eam").all()
    assert "40 points of the other atrium" in more.notes


def test_electrical_columns(case: Case) -> None:
    eam = case.points.of("eam")
    assert eam.columns["bipolar"].min() > 0.0
    assert eam.columns["bipolar"].max() < 2.6
    assert 0.0 <= eam.columns["lat"].min() < eam.columns["lat"].max() < 250.0
    assert np.isnan(case.points.of("landmark").columns["lat"]).all()


def test_activation_is_never_faster_than_the_straight_line(case: Case) -> None:
    surface = truth(case)
    source = surface.vertices[17]
    straight = np.linalg.norm(surface.vertices - source, axis=1) / 0.8
    assert (activation(surface, source) >= straight - 1e-9).all()


def test_patches_take_the_asked_share_of_the_nearest_faces(case: Case) -> None:
    surface = truth(case)
    chosen = patches(surface, surface.vertices[5], 0.1)
    assert surface.face_areas[chosen].sum() / surface.area == pytest.approx(0.1, abs=0.001)


def test_sites_are_uniform_by_area() -> None:
    surface = mesh(shapes.ball((0, 0, 0), 5.0), (-6, -6, -6), (6, 6, 6), 1.0)
    z = sites(np.random.default_rng(SEED), surface, 4000).xyz[:, 2]
    assert np.quantile(z, [0.25, 0.5, 0.75]) == pytest.approx([-2.5, 0.0, 2.5], abs=0.25)  # Archimedes


def test_percent_is_that_of_the_points_spread() -> None:
    clean, noisy = star(SEED, percent=0.0), star(SEED, percent=10.0)
    assert distances(clean.points.xyz, truth(clean)).max() < 1e-3
    spread = np.sqrt(clean.points.xyz.var(axis=0).mean())
    assert (noisy.points.xyz - clean.points.xyz).std() == pytest.approx(0.1 * spread, rel=0.25)


def test_the_built_in_case_is_what_the_generator_writes() -> None:
    """Within what other versions of the numerical libraries may change."""
    assert same(read_case(demo_case()), atrium()) < 1e-3
    assert sum(path.stat().st_size for path in demo_case().iterdir()) < 1_500_000


@pytest.mark.parametrize(
    ("arguments", "name"),
    [(("atrium", "--points", "60"), "atrium_811"), (("star", "--percent", "2"), "star_811")],
)
def test_the_command_writes_a_case_folder(arguments: tuple[str, ...], name: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "data_synth", *arguments, str(tmp_path / "case"), "--seed", "811"]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    assert read_case(tmp_path / "case").name == name
    again = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert again.returncode == 1
    assert "exists already" in again.stderr
