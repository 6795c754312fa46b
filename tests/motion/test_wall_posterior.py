"""The posterior of a moved wall in space is that of the vector process, and samples have its covariance."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from fields import SIZE, bend, body, covariance, spots, wall

from o3dls.arrays import Array
from o3dls.errors import InputError
from o3dls.estimate import Estimate
from o3dls.geometry.differential import vertex_normals
from o3dls.geometry.surface import Surface
from o3dls.motion.field.covariance import FieldPrior, Observed, Places
from o3dls.motion.field.gaussian_process import FieldPosterior, solve
from o3dls.motion.fit import fit_motion
from o3dls.motion.motion import FittedMotion
from o3dls.motion.posterior import wall_posterior
from o3dls.motion.wall.kept import KeptPosterior
from o3dls.motion.wall.nodes import NodeSums
from o3dls.motion.wall.posterior import WallPosterior
from o3dls.motion.wall.samples import sample_existence, wall_covariance

BOTH = pytest.mark.parametrize("dimension", [2, 3])
INTERPOLATED = 0.03  # relative, of deviations between nodes
MANY = 4000  # samples: a variance is known to 2 %, one of many to 8 %


def after_one_point(
    at: Array, direction: Array, noise: float, *, translation: float = 1e-9, rotation: float = 1e-9
) -> WallPosterior:
    """What is known of a wall that can only shift and turn about the origin, given one measurement."""
    dim = len(at)
    prior = covariance(dim)
    zero = np.zeros(dim)
    free = replace(prior, centre=zero, translation=translation, rotation=rotation, scale=1e-9)
    field = FieldPrior(free, np.zeros(len(free.lengths) + 2))
    seen = Observed(at[None], direction[None], np.zeros(1))
    solved, _ = solve(field.between(seen, seen) + noise**2 * np.eye(1), np.array([1.3]))
    nodes = np.vstack([at, 2.0 * np.eye(dim)])
    places = Places(nodes, nodes / np.linalg.norm(nodes, axis=1, keepdims=True))
    none = np.zeros_like(nodes)
    return WallPosterior(FieldPosterior(field, seen, solved), places, nodes, none, 1.0)


def test_one_measurement_of_a_shift_by_hand() -> None:
    """A point takes s^4 / (s^2 + sigma^2) of the variance s^2 along its direction, and nothing across."""
    s, sigma = 2.0, 1.5
    n = np.array([0.6, 0.0, 0.8])
    found = after_one_point(np.array([10.0, 0.0, 0.0]), n, sigma, translation=s).covariance
    one = s**2 * np.eye(3) - s**4 / (s**2 + sigma**2) * np.outer(n, n)
    # a shift is one for all nodes
    assert np.allclose(found, np.tile(one, (4, 4)), atol=1e-9)


def test_one_measurement_of_a_turn_by_hand() -> None:
    """A turn moves a place at r by w x r; one measured along y at (10, 0, 0) tells the turn about z alone."""
    turn, sigma = 0.1, 0.5
    place = after_one_point(np.array([10.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), sigma, rotation=turn)
    left = turn**2 - turn**4 * 100.0 / (100.0 * turn**2 + sigma**2)  # of the turn about z
    expected = np.diag([0.0, 100.0 * left, 100.0 * turn**2])
    assert np.allclose(place.covariance[:3, :3], expected, atol=1e-9)
    # (0, 2, 0), the third node, is moved along -x by the turn about z, along z by that about x
    assert np.allclose(place.covariance[6:9, 6:9], np.diag([4.0 * left, 0.0, 4.0 * turn**2]), atol=1e-9)
    assert place.covariance[6, 1] == pytest.approx(-2.0 * 10.0 * left)


@cache
def fitted(dimension: int) -> tuple[Surface, FittedMotion]:
    surface = body(dimension)
    truth = surface.vertices + bend(surface, 4_409)
    _, face, bary = spots(surface, 60 if dimension == 2 else 150, 4_410)
    points = np.einsum("nc,ncd->nd", bary, truth[surface.faces[face]])
    data = wall(points + 0.8 * np.random.default_rng(4_411).normal(size=points.shape))
    fit = fit_motion(surface.vertices, surface.faces, np.eye(dimension + 1), data)
    return surface.with_vertices(fit.vertices), fit.motion


@pytest.fixture(scope="module", params=[2, 3])
def moved(request: pytest.FixtureRequest) -> tuple[Surface, FittedMotion]:
    return fitted(request.param)


def estimate(moved: tuple[Surface, FittedMotion], **fields: Array) -> Estimate:
    surface, motion = moved
    return Estimate(replace(surface, fields=fields), np.eye(surface.dimension + 1), "made", motion=motion)


def deviation(motion: FittedMotion, surface: Surface) -> Array:
    return motion.sd(motion.vertices, vertex_normals(surface.vertices, surface.faces))


def along(covariance: Array, normals: Array) -> Array:
    return np.sqrt(np.einsum("na,nab,nb->n", normals, covariance, normals))


def test_along_the_normal_it_is_the_deviation_of_the_motion(moved: tuple[Surface, FittedMotion]) -> None:
    surface, motion = moved
    found = along(estimate(moved).covariance(), surface.vertex_normals)
    assert found == pytest.approx(deviation(motion, surface), rel=INTERPOLATED)


def test_across_the_normal_it_is_the_deviation_of_the_motion_too(
    moved: tuple[Surface, FittedMotion],
) -> None:
    surface, motion = moved
    way = surface.vertex_normals[:, ::-1] * np.r_[1.0, np.full(surface.dimension - 1, -1.0)]
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    found = along(estimate(moved).covariance(), way)
    assert found == pytest.approx(motion.sd(motion.vertices, way), rel=INTERPOLATED)


def test_a_motion_that_is_followed_in_part_is_as_uncertain_as_it_says(
    moved: tuple[Surface, FittedMotion],
) -> None:
    surface, motion = moved
    part = replace(motion, probability=0.4)
    at = part(part.vertices)
    found = along(estimate((surface.with_vertices(at), part)).covariance(), surface.vertex_normals)
    assert found == pytest.approx(part.sd(part.vertices, surface.vertex_normals), rel=INTERPOLATED)
    assert found.mean() > 1.2 * deviation(motion, surface).mean()


def test_samples_have_the_covariance_that_is_stated(moved: tuple[Surface, FittedMotion]) -> None:
    surface, motion = moved
    stated = estimate(moved, sd_mm=deviation(motion, surface))
    samples = stated.samples(MANY, seed=90_417)
    off = samples.vertices - surface.vertices
    scatter = np.einsum("kna,knb->nab", off, off) / MANY
    expected = stated.covariance()
    size = np.einsum("naa->n", expected)
    assert np.abs(scatter - expected).max(axis=(1, 2)) / size == pytest.approx(0.0, abs=0.1)
    assert float(np.einsum("naa->n", scatter).sum() / size.sum()) == pytest.approx(1.0, abs=0.02)
    assert np.abs(off.mean(axis=0)).max() < 5.0 * np.sqrt(size.max() / MANY)
    normal = np.einsum("knd,nd->kn", off, surface.vertex_normals)
    assert normal.std(axis=0) == pytest.approx(deviation(motion, surface), rel=0.08)


def test_neighbours_are_sampled_as_the_process_has_them_go_together(
    moved: tuple[Surface, FittedMotion],
) -> None:
    """Differences of two places along a direction have the variance that the field states for them."""
    surface, motion = moved
    samples = estimate(moved).samples(MANY, seed=31_775)
    first, second = surface.faces[::40, 0], surface.faces[::40, 1]
    x = np.eye(surface.dimension)[0]
    apart = (samples.vertices[:, first] - samples.vertices[:, second]) @ x
    for k, pair in enumerate(zip(first, second, strict=True)):
        joint = motion.joint(motion.vertices[list(pair)], np.tile(x, (2, 1)))
        expected = joint[0, 0] + joint[1, 1] - 2.0 * joint[0, 1]
        assert apart[:, k].var() == pytest.approx(expected, rel=0.15)


def test_equal_seeds_give_equal_samples_and_others_others(moved: tuple[Surface, FittedMotion]) -> None:
    found = estimate(moved)
    first = found.samples(5, seed=11).vertices
    assert np.array_equal(first, found.samples(5, seed=11).vertices)
    assert np.abs(first - found.samples(5, seed=12).vertices).max() > 0.1
    assert len({one.vertices.tobytes() for one in found.samples(5, seed=11)}) == 5
    with pytest.raises(InputError, match="n = 0"):
        found.samples(0)


def test_a_deviation_of_a_reconstruction_replaces_that_of_the_motion_along_the_normal() -> None:
    surface, motion = fitted(3)
    posterior = wall_posterior(motion)
    assert posterior is not None
    own = wall_covariance(surface, posterior, None)
    sd = np.linspace(0.2, 3.0, len(own))
    joined = wall_covariance(surface, posterior, sd)
    normals = surface.vertex_normals
    assert along(joined, normals) == pytest.approx(sd)
    wall_part = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    assert np.allclose(wall_part @ joined @ wall_part, wall_part @ own @ wall_part)
    assert (np.linalg.eigvalsh(joined) > -1e-9).all()
    unknown = np.full(len(own), np.nan)
    assert np.array_equal(wall_covariance(surface, posterior, unknown), own)


@BOTH
def test_what_a_folder_keeps_is_the_same_posterior(dimension: int) -> None:
    posterior = wall_posterior(fitted(dimension)[1])
    assert posterior is not None
    again = KeptPosterior.from_arrays(KeptPosterior.of(posterior).arrays(), dimension)
    assert again.errors.ndim == 1
    assert again.posterior.covariance == pytest.approx(posterior.covariance, abs=1e-8)
    mean = posterior.field.mean(posterior.nodes)
    assert again.posterior.field.mean(again.posterior.nodes) == pytest.approx(mean, abs=1e-8)


def test_errors_that_points_share_are_kept() -> None:
    posterior = wall_posterior(fitted(3)[1])
    assert posterior is not None
    field = posterior.field
    whole = field.solved.factor @ field.solved.factor.T
    seen = field.observed.directions
    solved, _ = solve(whole + 0.5 * seen @ seen.T, whole @ field.solved.alpha)
    shared = replace(posterior, field=replace(field, solved=solved))
    kept = KeptPosterior.of(shared)
    assert kept.errors.ndim == 2
    again = KeptPosterior.from_arrays(kept.arrays(), 3).posterior
    assert again.covariance == pytest.approx(shared.covariance, abs=1e-8)
    assert np.trace(again.covariance) > 1.02 * np.trace(posterior.covariance)


def test_arrays_that_do_not_fit_are_refused() -> None:
    posterior = wall_posterior(fitted(2)[1])
    assert posterior is not None
    whole = KeptPosterior.of(posterior).arrays()
    with pytest.raises(ValueError, match="it has no sds"):
        KeptPosterior.from_arrays({k: v for k, v in whole.items() if k != "sds"}, 2)
    for name in whole.keys() - {"anchors"}:  # there are none
        with pytest.raises(ValueError, match=r"another shape|no number"):
            KeptPosterior.from_arrays({**whole, name: whole[name][:-1]}, 2)
        with pytest.raises(ValueError, match="no number"):
            KeptPosterior.from_arrays({**whole, name: np.full(whole[name].shape, np.nan)}, 2)


def test_sums_over_nodes_are_those_of_a_plain_loop() -> None:
    rng = np.random.default_rng(71_403)
    nodes, places = 10.0 * rng.normal(size=(30, 3)), 10.0 * rng.normal(size=(7, 3))
    sums = NodeSums.of(nodes, places, 12.0)
    matrix = np.zeros((7, 30))
    for place, (near, share) in enumerate(zip(sums.near, sums.share, strict=True)):
        matrix[place, near] = share
    assert matrix.sum(axis=1) == pytest.approx(1.0)
    root = rng.normal(size=(90, 90))
    joint = root @ root.T
    found = sums.covariance(joint, 3)
    for place, row in enumerate(matrix):
        spread_over = np.kron(row, np.eye(3))
        assert found[place] == pytest.approx(spread_over @ joint @ spread_over.T)
    fields = rng.normal(size=(4, 30, 3))
    assert sums.values(fields) == pytest.approx(np.einsum("pn,snc->spc", matrix, fields))


def test_wall_that_is_certain_is_there_in_all_samples_and_never_where_it_is_not() -> None:
    surface = body(3)
    likely = 1.0 * (surface.vertices[:, 0] > 0.0)
    rng = np.random.default_rng(60_232)
    there = sample_existence(surface, likely, SIZE, surface.vertices[::2], 3, rng)
    assert np.array_equal(there, np.tile(likely > 0.0, (3, 1)))


def test_doubtful_wall_is_there_as_often_as_is_likely_and_absent_together() -> None:
    surface = body(3)
    likely = np.where(surface.vertices[:, 0] > 0.0, 0.7, 1.0)
    nodes = surface.vertices[::2]
    rng = np.random.default_rng(60_231)
    there = sample_existence(surface, likely, SIZE, nodes, MANY, rng)
    assert there.mean(axis=0) == pytest.approx(likely, abs=0.04)
    assert there[:, likely == 1.0].all()
    first, second = surface.faces[(likely[surface.faces] < 1.0).all(axis=1)][:, :2].T
    assert (there[:, first] == there[:, second]).mean() > 0.9  # of strangers 0.58 would agree


def test_an_estimate_without_a_posterior_says_so() -> None:
    surface = body(3)
    with pytest.raises(InputError, match="no posterior in space; run a pipeline with the stage 'deform'"):
        Estimate(surface, np.eye(4), "made").samples(3)
