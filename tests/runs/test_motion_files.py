"""The motion as a file: ITK's transforms against the motion itself, there and back, in LPS and RAS."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from o3dls.arrays import Array
from o3dls.errors import InputError, PipelineError
from o3dls.geometry.similarity import apply, inverse
from o3dls.io.images.registry import read_image
from o3dls.motion.off_wall.field import off_wall
from o3dls.motion.off_wall.inverse import fixed_point
from o3dls.motion.off_wall.settings import SETTINGS
from o3dls.runs.export.finished import export_run
from o3dls.runs.export.placed import recorded
from o3dls.runs.export.writer import Export
from tests.oblique_motion import MIDDLE, Smooth, chamber, oblique_run, turn_of

WALL = 0.02  # mm: by how much a file may miss the motion on the wall, at the default spacing of 1 mm
INVERSE = 0.05  # mm, there and back


def transformed(path: Path, points: Array) -> Array:
    """Points in LPS under a transform file, by SimpleITK."""
    sitk = pytest.importorskip("SimpleITK", reason="pip install o3dls[formats-test]")
    transform = sitk.ReadTransform(str(path))
    return np.array([transform.TransformPoint(point) for point in points.tolist()])


@pytest.mark.parametrize(("prior_frame", "frame"), [("RAS", "LPS"), ("LPS", "RAS")])
def test_itk_agrees_with_the_motion_both_ways(prior_frame: str, frame: str, tmp_path: Path) -> None:
    folder = oblique_run(prior_frame, frame).write(tmp_path / "run")
    path = export_run(folder, format="itk")
    motion = Smooth(prior_frame, frame)
    wall = chamber().vertices[::3]
    moved = apply(turn_of(frame), motion(apply(turn_of(prior_frame), wall)))
    # ITK's file leads from the map to the image
    back, there = transformed(path, moved), transformed(path.with_stem(path.stem + "_inverse"), wall)
    assert np.linalg.norm(there - moved, axis=1).max() < WALL
    assert np.linalg.norm(back - wall, axis=1).max() < INVERSE
    facts = json.loads(path.with_name(path.name + ".json").read_text())
    assert 0.0 < facts["wall_error_p99_mm"] < facts["wall_error_mm"] < WALL
    assert facts["inverse_error_mm"] < INVERSE
    assert facts["nodes_without_inverse"] == 0
    assert "similarity alone" in facts["field"]


def test_a_finished_run_and_its_pipeline_write_the_same(tmp_path: Path) -> None:
    run = oblique_run()
    folder = run.write(tmp_path / "run")
    Export(format="itk", spacing=3.0)(run, tmp_path)
    again = export_run(folder, tmp_path / "again.h5", format="itk", spacing=3.0)
    wall = chamber().vertices[::7]
    first = tmp_path / "export/moved.to_map_inverse.h5"
    # a ply has its places as doubles, and fields as they are: only the similarity is rounded
    np.testing.assert_allclose(
        transformed(first, wall), transformed(again.with_stem("again_inverse"), wall), atol=1e-4
    )


def test_a_matrix_and_its_field_beside_it_do_the_same(tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK", reason="pip install o3dls[formats-test]")
    folder = oblique_run().write(tmp_path / "run")
    whole = export_run(folder, tmp_path / "a.h5", format="itk", spacing=2.0)
    parts = export_run(folder, tmp_path / "b.tfm", format="itk", spacing=2.0)
    wall = Smooth("LPS", "LPS")(chamber().vertices[::9])
    first = transformed(parts, wall)
    field = sitk.Cast(sitk.ReadImage(str(tmp_path / "b_field.nrrd")), sitk.sitkVectorFloat64)
    moved = sitk.DisplacementFieldTransform(field)
    both = np.array([moved.TransformPoint(point) for point in first.tolist()])
    np.testing.assert_allclose(both, transformed(whole, wall), atol=1e-6)


def test_volumes_say_how_sure_and_where(tmp_path: Path) -> None:
    folder = oblique_run().write(tmp_path / "run")
    path = export_run(folder, tmp_path / "a.h5", format="itk", spacing=2.0)
    sd, known = (
        read_image(file, file.read_bytes()) for file in (tmp_path / "a_sd.nrrd", tmp_path / "a_known.nrrd")
    )
    assert (sd.space, known.space) == ("LPS", "LPS")

    def at(volume: object, places: Array) -> Array:
        index = np.rint(apply(inverse(volume.affine), places)).astype(int)  # type: ignore[attr-defined]
        return np.asarray(volume.values[tuple(index.T[::-1])])  # type: ignore[attr-defined]

    wall = chamber()
    np.testing.assert_allclose(at(sd, wall.vertices), 0.7, atol=0.05)
    assert (at(known, wall.vertices) == 1).all()
    out = MIDDLE + 2.4 * (wall.vertices - MIDDLE)
    inside = (
        (apply(inverse(sd.affine), out) > 1)
        & (apply(inverse(sd.affine), out) < np.array(sd.values.shape[::-1]) - 2)
    ).all(axis=1)
    assert inside.sum() > 20
    assert at(sd, out[inside]).mean() > 0.9
    assert at(known, out[inside]).mean() < 0.2
    assert json.loads(path.with_name("a.h5.json").read_text())["files"]["known"] == "a_known.nrrd"


def test_far_away_only_the_similarity_is_left(tmp_path: Path) -> None:
    run = oblique_run()
    field = off_wall(recorded(run.case, run.estimates["moved"]))
    far = MIDDLE + np.array([[300.0, 0, 0], [0, -250.0, 30.0]])
    np.testing.assert_allclose(field(far), apply(field.T_map_prior, far), atol=1e-9)
    assert not field.known(far).any()
    shift = np.linalg.norm(field.displacement(chamber().vertices), axis=1)
    assert shift.max() > 1.0  # and it is not all that there is


def test_the_inverse_undoes_the_field_off_the_wall() -> None:
    run = oblique_run()
    field = off_wall(recorded(run.case, run.estimates["moved"]))
    rng = np.random.default_rng(41_907)
    places = MIDDLE + rng.uniform(-35, 35, size=(200, 3))
    found = field.inverse(field(places))
    assert not found.failed.any()
    np.testing.assert_allclose(found.places, places, atol=1e-3)


def test_what_folds_is_named_and_marked(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = oblique_run(size=30.0).write(tmp_path / "run")
    with caplog.at_level(logging.WARNING, "o3dls"):
        path = export_run(folder, tmp_path / "a.h5", format="itk", spacing=3.0)
    facts = json.loads(path.with_name("a.h5.json").read_text())
    assert facts["nodes_without_inverse"] > 0
    assert f"no inverse at {facts['nodes_without_inverse']} nodes" in caplog.text
    assert "known is 0" in caplog.text


def test_what_no_field_follows_is_in_the_deviation_and_said() -> None:
    run = oblique_run()
    motion = recorded(run.case, run.estimates["moved"])
    assert off_wall(motion).not_followed == ""
    needles = np.arange(0, len(motion.moved.vertices), 40)
    vertices = motion.moved.vertices.copy()
    vertices[needles] += 3.0 * motion.moved.vertex_normals[needles]
    torn = off_wall(replace(motion, moved=motion.moved.with_vertices(vertices)))
    assert "no field in space follows the moved wall" in torn.not_followed
    wall = motion.prior.vertices
    miss = np.linalg.norm(torn(wall) - vertices, axis=1)
    assert miss[needles].max() > 0.5
    np.testing.assert_allclose(torn.sd(wall), np.hypot(0.7, miss), atol=0.05)


def test_a_fixed_point_says_where_it_misses() -> None:
    def strong(at: Array) -> Array:
        return np.where(at[:, :1] > 0, -1.5, 0.2) * at

    found = fixed_point(strong, np.array([[-4.0, 1.0, 0.0], [4.0, 1.0, 0.0]]))
    assert found.residual[0] < 1e-4 < 1.0 < found.residual[1]
    np.testing.assert_allclose(
        found.shift[0] + strong(np.array([[-4.0, 1, 0]]) + found.shift[:1])[0], 0, atol=1e-4
    )


def test_what_cannot_be_written_names_what_can(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few = replace(SETTINGS, most_nodes=100_000)  # a grid of as many as are allowed takes minutes
    monkeypatch.setattr("o3dls.motion.off_wall.grid.SETTINGS", few)
    folder = oblique_run().write(tmp_path / "run")
    with pytest.raises(
        InputError, match=r"'start' has no motion but its pose; name one behind .* --format tfm"
    ):
        export_run(folder, format="itk", estimate="start")
    export_run(folder, tmp_path / "pose.tfm", format="tfm", estimate="start")
    with pytest.raises(InputError, match=r"end in \.h5 or \.tfm"):
        export_run(folder, tmp_path / "a.nii", format="itk")
    with pytest.raises(InputError, match=r"nodes: must be at most .*; say") as refused:
        export_run(folder, tmp_path / "a.h5", format="itk", spacing=1.0)
    export_run(folder, tmp_path / "a.h5", format="itk", spacing=float(str(refused.value).rsplit(" ", 1)[1]))
    with pytest.raises(PipelineError, match="holds both map and prior, in LPS; omit on and frame"):
        Export(format="itk", on="prior")
    assert Export(format="itk").format == "itk"


def test_frames_that_nobody_states_are_asked_for(tmp_path: Path) -> None:
    run = oblique_run()
    lost = replace(run, case=replace(run.case, frame="unknown", prior_frame="unknown"))
    with pytest.raises(InputError, match="the frame of the prior is unknown"):
        export_run(lost.write(tmp_path / "lost"), format="itk")
