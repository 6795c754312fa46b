"""A synthetic export of CARTO is read as it was written, and lies beside the image as a patient's does."""

from __future__ import annotations

from pathlib import Path

import nibabel
import numpy as np
import pytest

from data_synth import atrium
from data_synth.carto import GULLET_VALUE, MAP, write_carto_study
from data_synth.grey import ENHANCED, HEALTHY
from o3dls import import_study, read_case, read_surface
from o3dls.evaluation.distances import distances
from o3dls.geometry.similarity import fit_similarity, scale_of
from o3dls.io.grey.of_case import open_case_image
from o3dls.io.mapping.study import read_study

SEED, POINTS = 11, 120
RADIUS = 9.0  # mm: of a ring, whose points are tagged


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("carto") / "study"
    write_carto_study(folder, SEED, POINTS)
    return folder


def test_the_export_is_read_as_a_study_of_carto(study: Path) -> None:
    found = read_study(study / "export")
    case = atrium(SEED, points=POINTS)
    assert (found.vendor, found.name) == ("CARTO 3", MAP)
    assert len(found.points.of("eam")) == POINTS + len(case.points.of("ablation"))
    assert len(found.points.of("ablation")) == len(case.points.of("ablation"))
    assert list(found.landmarks) == sorted(case.prior_landmarks)
    assert not any("NOT agree" in line for line in found.took)
    assert (found.points.of("eam").numbers("bipolar") > 0.0).all()
    # turned and shifted, as the system has a frame of its own, and otherwise as it was
    pose = fit_similarity(case.points.of("eam").xyz, found.points.of("eam").xyz[:POINTS])
    assert scale_of(pose) == pytest.approx(1.0, abs=1e-5)
    assert np.linalg.norm(pose[:3, 3]) == pytest.approx(50.0, abs=1e-2)
    wall = read_surface(study / "true_wall.ply")
    assert np.median(distances(found.points.of("eam").xyz, wall)) < 2.0
    assert distances(np.array(list(found.landmarks.values())), wall).max() < RADIUS


def test_voltages_are_low_where_the_wall_is_enhanced(study: Path, tmp_path: Path) -> None:
    import_study(
        study / "export",
        None,
        tmp_path / "case",
        prior=study / "la_labels.nii.gz",
        image=study / "lge.nii.gz",
    )
    case = read_case(tmp_path / "case")
    truth = atrium(SEED, points=POINTS)
    assert np.median(distances(case.prior.vertices, truth.prior)) < 0.4
    shell = read_surface(tmp_path / "case/map.ply")
    # the shell has the vertices of the wall at imaging, of which the prior of the case is the same
    at = truth.prior.vertices + 1.2 * truth.prior.vertex_normals
    grey = open_case_image(case).around(at).sample(at)
    enhanced = grey > (HEALTHY + ENHANCED) / 2.0
    assert 0.03 < enhanced.mean() < 0.3
    assert len(shell.vertices) == len(grey)
    assert np.median(shell.fields["bipolar"][enhanced]) < 0.6
    assert np.median(shell.fields["bipolar"][~enhanced]) > 2.0


def test_the_oesophagus_lies_behind_the_wall_and_in_the_image(study: Path) -> None:
    gullet, prior = read_surface(study / "oesophagus.stl"), atrium(SEED, points=POINTS).prior
    assert gullet.watertight
    assert 1.0 < distances(gullet.vertices, prior).min() < 6.0
    assert gullet.vertices[:, 1].min() > prior.vertices[:, 1].mean()
    image = nibabel.load(study / "lge.nii.gz")
    middle = gullet.vertices.mean(axis=0) * [-1.0, -1.0, 1.0]
    index = np.rint(np.linalg.inv(image.affine) @ [*middle, 1.0])[:3].astype(int)
    near = image.get_fdata()[tuple(slice(k - 1, k + 2) for k in index)]
    assert near.mean() == pytest.approx(GULLET_VALUE, abs=15.0)
