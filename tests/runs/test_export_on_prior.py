"""Export on the prior: what the map says, on the patient's own image, through the motion and back."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.errors import InputError, PipelineError
from o3dls.estimate import Estimate
from o3dls.geometry.similarity import TURN, apply, similarity
from o3dls.io.images.registry import read_image
from o3dls.io.points import read_points
from o3dls.io.surfaces import read_surface_file, write_surface
from o3dls.io.transforms import read_transform
from o3dls.motion.recorded import RecordedMotion
from o3dls.pipeline.file import read_pipeline
from o3dls.pipeline.pipeline import Pipeline
from o3dls.plugins.stage import Stage
from o3dls.runs.export.finished import export_run
from o3dls.runs.export.writer import Export
from o3dls.runs.folder import read_run
from o3dls.runs.live import messages
from tests.finished import Bulge, bulged_case
from tests.tiny import sphere

TURNED = similarity(np.array([[0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.8, 0.0, 0.6]]), [40.0, -7.0, 90.0], 1.1)


class Turned:
    """A pose, and then a bulge."""

    def __call__(self, points: Array) -> Array:
        return Bulge(np.eye(4), 3.0)(apply(TURNED, points))

    def sd(self, points: Array, normals: Array) -> Array:
        return np.linspace(0.3, 1.5, len(points))


class Known(Stage):
    """Moves the prior as the points were moved."""

    name: ClassVar[str] = "known"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        motion = Turned()
        surface = case.prior.with_vertices(motion(case.prior.vertices))
        return Estimate(surface, TURNED, "known", motion=motion, sigma=0.5)


def turned_case(prior_frame: str, frame: str) -> Case:
    """The bulged ball whose prior lies elsewhere, in an image."""
    case, back = bulged_case("turned"), np.linalg.inv(TURNED)
    marks = {name: apply(back, at[None])[0] for name, at in case.prior_landmarks.items()}
    return replace(
        case,
        prior=case.prior.transformed(back),
        prior_landmarks=marks,
        frame=frame,
        prior_frame=prior_frame,
        truth=None,
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map's frame is not known, as CARTO's; the prior's is."""
    writes = [Export(on="prior", format="vtp"), Export(format="vtp")]
    done = Pipeline([Known()], writes, folds=0).run(turned_case("LPS", "unknown"))
    return done.write(tmp_path_factory.mktemp("prior") / "run")


def test_the_prior_carries_what_its_vertices_came_to_lie_on(run: Path) -> None:
    prior, on_map = (read_surface_file(run / f"export/known{end}.vtp") for end in ("_on_prior", ""))
    case = turned_case("LPS", "unknown")
    assert (prior.space, prior.units, on_map.space) == ("LPS", "mm", "unknown")
    np.testing.assert_allclose(prior.surface.vertices, case.prior.vertices, atol=1e-9)
    np.testing.assert_array_equal(prior.surface.faces, case.prior.faces)
    for name in ("bipolar", "sd_mm", "distance_to_nearest_point_mm", "prior_only"):
        np.testing.assert_allclose(prior.surface.fields[name], on_map.surface.fields[name], atol=1e-6)
    assert np.nanstd(prior.surface.fields["bipolar"]) > 0.1
    assert prior.surface.fields["distance_to_result_mm"].max() < 1e-6
    facts = json.loads((run / "export/known_on_prior.vtp.json").read_text())
    assert (facts["on"], facts["frame"]) == ("prior", "LPS")


def test_a_finished_run_gives_the_same_again(run: Path, tmp_path: Path) -> None:
    again = read_surface_file(export_run(run, tmp_path / "a.vtp", format="vtp", on="prior")).surface
    first = read_surface_file(run / "export/known_on_prior.vtp").surface
    np.testing.assert_allclose(again.vertices, first.vertices, atol=1e-9)
    assert again.fields.keys() == first.fields.keys()
    for name, values in first.fields.items():
        np.testing.assert_allclose(again.fields[name], values, atol=1e-6)


def test_the_points_lie_where_the_motion_took_them_from(run: Path, tmp_path: Path) -> None:
    points = read_points(export_run(run, tmp_path / "a.csv", format="csv", on="prior"), 3)
    measured = turned_case("LPS", "unknown").points
    # the noise of points off the wall is not that of the motion there
    np.testing.assert_allclose(Turned()(points.xyz), measured.xyz, atol=0.7)
    np.testing.assert_array_equal(points.numbers("bipolar"), measured.numbers("bipolar"))
    on_map = read_points(export_run(run, tmp_path / "b.csv", format="csv"), 3)
    np.testing.assert_array_equal(on_map.xyz, measured.xyz)


def test_a_recorded_motion_and_its_inverse_undo_each_other() -> None:
    prior = turned_case("LPS", "LPS").prior
    moved = prior.with_vertices(Turned()(prior.vertices))
    motion = RecordedMotion(prior, moved, TURNED, np.arange(len(prior.vertices)) * 1.0)
    np.testing.assert_allclose(motion(prior.vertices), moved.vertices, atol=1e-9)
    np.testing.assert_array_equal(motion.sd(prior.vertices, prior.vertex_normals), motion.deviation)
    places = prior.vertices[::5] + 1.5 * prior.vertex_normals[::5]
    # the nearest place on the moved wall is another one where the bulge bends it
    np.testing.assert_allclose(motion.inverse(motion(places)), places, atol=0.3)


@pytest.mark.parametrize(
    ("prior_frame", "frame"),
    [("LPS", "unknown"), ("RAS", "unknown"), ("LPS", "LPS"), ("RAS", "LPS"), ("LPS", "RAS")],
)
def test_a_pose_moves_the_map_onto_the_image_in_the_frame_of_the_file(
    tmp_path: Path, prior_frame: str, frame: str
) -> None:
    """An ITK transform is in LPS on both sides; a map whose frame is unknown counts as the image's."""
    case = turned_case(prior_frame, frame)
    folder = Pipeline([Known()], folds=0).run(case).write(tmp_path / "run")
    matrix, space = read_transform(export_run(folder, tmp_path / "a.tfm", format="tfm", on="prior"))
    assert space == "LPS"
    in_lps = {
        side: TURN if own == "RAS" else np.eye(4)
        for side, own in (("map", prior_frame if frame == "unknown" else frame), ("prior", prior_frame))
    }
    wall = apply(TURNED, case.prior.vertices)
    found = apply(matrix, apply(in_lps["map"], wall))
    np.testing.assert_allclose(found, apply(in_lps["prior"], case.prior.vertices), atol=1e-6)
    if frame != "unknown":  # and the other way round
        matrix, _ = read_transform(export_run(folder, tmp_path / "b.tfm", format="tfm"))
        back = apply(matrix, apply(in_lps["prior"], case.prior.vertices))
        np.testing.assert_allclose(back, apply(in_lps["map"], wall), atol=1e-6)


@pytest.mark.parametrize("prior_frame", ["LPS", "RAS"])
def test_a_mask_takes_the_voxels_of_the_image(tmp_path: Path, prior_frame: str) -> None:
    sitk = pytest.importorskip("SimpleITK")
    case = turned_case(prior_frame, "unknown")
    folder = Pipeline([Known()], folds=0).run(case).write(tmp_path / "run")
    middle = case.prior.vertices.mean(axis=0) * ([-1, -1, 1] if prior_frame == "RAS" else [1, 1, 1])
    image = sitk.Image([60, 70, 24], sitk.sitkInt16)
    axes = similarity(np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]]), np.zeros(3))[:3, :3]
    spacing = np.array([0.9, 0.8, 2.5])
    image.SetDirection(axes.ravel())
    image.SetSpacing(spacing)
    image.SetOrigin(middle - axes @ (spacing * [30, 35, 12]))
    grid = tmp_path / "mri.nii.gz"
    sitk.WriteImage(image, str(grid))
    out = export_run(folder, tmp_path / "m.nii.gz", format="mask_nifti", on="prior", grid=grid)
    found, asked = (read_image(path, path.read_bytes()) for path in (out, grid))
    np.testing.assert_allclose(found.affine, asked.affine, atol=1e-4)
    assert found.values.shape == asked.values.shape
    assert set(np.unique(found.values)) <= {0, 1, 2, 3}
    assert (found.values > 0).sum() * spacing.prod() == pytest.approx(case.prior.volume, rel=0.03)
    index = np.argwhere(found.values > 0)[:, ::-1].mean(axis=0)
    np.testing.assert_allclose(found.affine[:3, :3] @ index + found.affine[:3, 3], middle, atol=0.3)
    assert (found.values == 2).any()


def test_what_cannot_be_is_said(run: Path, tmp_path: Path) -> None:
    unknown = Pipeline([Known()], folds=0).run(turned_case("unknown", "unknown")).write(tmp_path / "run")
    with pytest.raises(InputError, match=r"frame of the prior is unknown.*o3dls convert PRIOR prior.ply"):
        export_run(unknown, tmp_path / "a.nii.gz", format="mask_nifti", on="prior")
    with pytest.raises(InputError, match="frame of the case is unknown"):
        export_run(run, tmp_path / "a.nii.gz", format="mask_nifti")
    with pytest.raises(PipelineError, match="grid belongs to the formats mask"):
        Export(format="ply", grid=Path("a.nii"))
    (tmp_path / "text.nii").write_text("no image")
    with pytest.raises(InputError, match="is not an image whose grid could be taken"):
        export_run(run, tmp_path / "a.nrrd", format="mask_nrrd", on="prior", grid=tmp_path / "text.nii")
    with pytest.raises(InputError, match="no such image"):
        export_run(run, tmp_path / "a.nrrd", format="mask_nrrd", on="prior", grid=tmp_path / "b.nii")
    assert not list(tmp_path.glob("a.*"))


def test_an_image_is_missed_before_the_work_and_named_from_where_the_pipeline_stands(tmp_path: Path) -> None:
    (tmp_path / "pipe.toml").write_text(
        '[[stage]]\nuse = "icp"\n[[write]]\nuse = "export"\non = "prior"\nformat = "mask_nrrd"\n'
        'grid = "mri.nii"\n'
    )
    case, pipeline = turned_case("LPS", "unknown"), read_pipeline(tmp_path / "pipe.toml")
    assert f"export: grid = '{tmp_path / 'mri.nii'}': no such image" in pipeline.refusals(case)[0]
    (tmp_path / "mri.nii").write_text("there")
    assert pipeline.refusals(case) == []


def test_a_run_on_a_map_without_a_frame_can_be_sent_on_the_prior(run: Path) -> None:
    with pytest.raises(InputError, match="frame of the case is unknown"):
        messages(run)
    surface, pose, *_ = messages(run, on="prior")
    assert b"known" in surface
    assert b"T_prior_map" in pose


def test_a_moved_prior_of_another_prior_is_refused(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "run")
    read_run(tmp_path / "run")
    write_surface(tmp_path / "run/estimates/known/moved_prior.ply", sphere(rings=5))
    with pytest.raises(InputError, match="other faces than the prior"):
        read_run(tmp_path / "run")
