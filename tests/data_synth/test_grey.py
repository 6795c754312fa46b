"""A synthetic image has the values that were asked for where they were asked for, in its case's frame."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from data_synth import atrium
from data_synth.grey import ENHANCED, HEALTHY, Grid, Tissue, enhanced, late_enhancement, oblique_grid
from o3dls import read_case
from o3dls.evaluation.wall_image import blood_of
from o3dls.io.grey.of_case import open_case_image
from tests.tiny import sphere

SEED = 20_417


def test_blood_wall_and_surroundings_have_their_values() -> None:
    ball = sphere(20.0, 40)
    grid = oblique_grid(np.random.default_rng(SEED), ball, np.array([1.0, 1.3, 2.0]), margin=8.0)
    assert grid.spacing == pytest.approx([1.0, 1.3, 2.0])
    assert np.abs(np.abs(grid.affine[:3, :3] / grid.spacing) - 0.5).max() < 0.5  # no axis is the body's
    tissue = Tissue(blood=300.0, around=100.0, thickness=3.0)
    values = late_enhancement(ball, grid, lambda at: 400.0 + at[:, 2], tissue).ravel()
    places = grid.places()
    radius = np.linalg.norm(places, axis=1)
    assert (values[radius < 19.7] == 300.0).all()
    assert (values[radius > 23.2] == 100.0).all()
    wall = (radius > 20.2) & (radius < 22.8)
    assert values[wall] == pytest.approx(400.0 + places[wall, 2])


def test_noise_is_as_large_as_it_says_and_one_seed_gives_one_image() -> None:
    ball, grid = sphere(20.0, 12), Grid((40, 40, 40), np.diag([1.5, 1.5, 1.5, 1.0]))
    noisy = [
        late_enhancement(ball, grid, lambda at: 400.0 + at[:, 2], Tissue(), np.random.default_rng(SEED))
        for _ in range(2)
    ]
    assert (noisy[0] == noisy[1]).all()
    still = late_enhancement(ball, grid, lambda at: 400.0 + at[:, 2])
    assert (noisy[0] - still).std() == pytest.approx(Tissue().noise, rel=0.02)


def test_the_command_writes_a_case_with_its_image(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "data_synth", "enhanced", str(tmp_path / "case"), "--seed", "11"]
    subprocess.run(command, check=True, capture_output=True)
    case = read_case(tmp_path / "case")
    assert case.image["path"] == str(tmp_path / "case" / "lge.nii.gz")
    assert case.points.xyz == pytest.approx(atrium(11).points.xyz)
    part = open_case_image(case).around(case.prior.vertices, 8.0)
    assert blood_of(part, case.prior).mean == pytest.approx(Tissue().blood, rel=0.01)
    outside = part.sample(case.prior.vertices + 1.25 * case.prior.vertex_normals)
    assert np.median(outside) == pytest.approx(HEALTHY, rel=0.05)
    assert 0.02 < (outside > (HEALTHY + ENHANCED) / 2).mean() < 0.5
    assert enhanced(11)[1].shape == open_case_image(case).volume.shape
