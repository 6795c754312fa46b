"""Files carried through a motion: every kind, both ways, in LPS and RAS, with the deviation at each place."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from o3dls import carry
from o3dls.errors import InputError
from o3dls.geometry.similarity import apply, inverse
from o3dls.io.clouds.lines import Lines, encode_lines, read_lines
from o3dls.io.images.registry import read_image
from o3dls.io.markups import Markups, read_markups, write_markups
from o3dls.io.meshes.cells import Cells
from o3dls.io.points import read_points
from o3dls.io.surfaces import read_surface_file, write_surface
from o3dls.io.table import write_table
from o3dls.runs.export.finished import export_run
from o3dls.runs.export.way import way_of
from o3dls.runs.folder import read_run
from tests.oblique_motion import AFFINE, SHAPE, Smooth, chamber, image, oblique_run, turn_of, write_image
from tests.tiny import disc_case

WALL = 0.02  # mm: what a field that is held at some places of the wall misses at others


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The prior in RAS, the map in LPS."""
    return oblique_run("RAS", "LPS").write(tmp_path_factory.mktemp("carry") / "run")


def test_a_surface_goes_to_the_map_and_back(run: Path, tmp_path: Path) -> None:
    wall = chamber()
    # in LPS, though the run's prior is in RAS: the file says so
    write_surface(tmp_path / "oesophagus.ply", wall.transformed(np.eye(4)), space="LPS")
    there = carry(run, tmp_path / "oesophagus.ply", "map", tmp_path / "there.vtp")
    found = read_surface_file(there)
    moved = Smooth("LPS", "LPS")(wall.vertices)
    assert (found.space, found.units) == ("LPS", "mm")
    assert np.linalg.norm(found.surface.vertices - moved, axis=1).max() < WALL
    np.testing.assert_allclose(found.surface.fields["sd_mm"], 0.7, atol=0.05)
    assert (found.surface.fields["motion_known"] == 1.0).all()
    back = read_surface_file(carry(run, there, "image", tmp_path / "back.ply"))
    assert back.space == "RAS"
    assert np.linalg.norm(apply(turn_of("RAS"), back.surface.vertices) - wall.vertices, axis=1).max() < 0.05
    assert "sd_mm_" in back.surface.fields  # those of the first way stay


def test_points_lines_and_places_go_as_the_wall_does(run: Path, tmp_path: Path) -> None:
    at = chamber().vertices[5:400:40]
    moved = Smooth("LPS", "LPS")(at)
    write_table(
        tmp_path / "a.csv",
        {**dict(zip("xyz", at.T / 10.0, strict=True)), "name": np.array([f"p{k}" for k in range(len(at))])},
        {"space": "LPS", "units": "cm"},
    )
    points = read_points(carry(run, tmp_path / "a.csv", "map", tmp_path / "b.csv"), 3)
    np.testing.assert_allclose(points.xyz, moved, atol=WALL)
    assert points.columns["name"][3] == "p3"
    np.testing.assert_allclose(points.numbers("sd_mm"), 0.7, atol=0.05)

    kinds = Cells.of(np.array([4, len(at) - 4]), np.arange(len(at)), 4)
    line = Lines(at, kinds, {"radius": np.arange(len(at)) * 0.5}, "LPS", "mm")
    (tmp_path / "vein.vtk").write_bytes(encode_lines(line))
    path = carry(run, tmp_path / "vein.vtk", "map", tmp_path / "moved.vtk")
    found = read_lines(path, path.read_bytes())
    assert found is not None
    np.testing.assert_allclose(found.xyz, moved, atol=WALL)
    np.testing.assert_array_equal(found.cells.sizes, [4, len(at) - 4])
    np.testing.assert_array_equal(found.values["radius"], line.values["radius"])
    assert {"sd_mm", "motion_known"} <= found.values.keys()

    write_markups(tmp_path / "a.mrk.json", Markups(tuple("abcdefghij"), apply(turn_of("RAS"), at), "RAS"))
    tree = json.loads((tmp_path / "a.mrk.json").read_text())
    tree["markups"][0]["type"] = "ClosedCurve"
    (tmp_path / "a.mrk.json").write_text(json.dumps(tree))
    path = carry(run, tmp_path / "a.mrk.json", "map", tmp_path / "b.mrk.json")
    marks = read_markups(path)
    assert (marks.names, marks.space) == (tuple("abcdefghij"), "LPS")
    np.testing.assert_allclose(marks.xyz, moved, atol=WALL)
    written = json.loads(path.read_text())["markups"][0]
    assert written["type"] == "ClosedCurve"
    assert written["controlPoints"][0]["description"].startswith("sd 0.7")


@pytest.mark.parametrize(("name", "space"), [("a.nii.gz", "RAS"), ("a.nrrd", "LPS")])
def test_labels_go_with_their_voxels(run: Path, name: str, space: str, tmp_path: Path) -> None:
    path = carry(run, write_image(tmp_path / name, space), "map", tmp_path / "b.nrrd")
    found = read_image(path, path.read_bytes())
    values = np.asarray(found.values).transpose(2, 1, 0)
    np.testing.assert_allclose(found.affine[:3, :3], AFFINE[:3, :3], atol=1e-4)
    # a voxel of the image, moved, is where its label went, but for voxels at borders
    inside = np.argwhere(image() > 0)
    moved = Smooth("LPS", "LPS")(apply(AFFINE, inside))
    index = np.rint(apply(inverse(found.affine), moved)).astype(int)
    same = values[tuple(index.T)] == image()[tuple(inside.T)]
    assert same.mean() > 0.93
    volume = np.linalg.det(found.affine[:3, :3]) * (values > 0).sum()
    before = np.linalg.det(AFFINE[:3, :3]) * (image() > 0).sum()
    truth = chamber().with_vertices(Smooth("LPS", "LPS")(chamber().vertices)).volume / chamber().volume
    assert abs(volume / before / truth - 1.0) < 0.03
    assert image().shape == SHAPE


def test_what_is_not_sure_is_said(run: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    far = chamber().with_vertices(chamber().vertices + np.array([0.0, 0.0, 90.0]))
    write_surface(tmp_path / "far.ply", far, space="LPS")
    with caplog.at_level(logging.INFO, "o3dls"):
        fields = read_surface_file(carry(run, tmp_path / "far.ply", "map", tmp_path / "b.vtp")).surface.fields
    assert fields["motion_known"].mean() < 0.2
    assert fields["sd_mm"].max() > 0.9
    assert f"of which the wall tells {int(fields['motion_known'].sum())}" in caplog.text


def test_a_fold_is_named_and_marked(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = oblique_run(size=30.0).write(tmp_path / "run")
    write_surface(tmp_path / "a.ply", chamber(), space="LPS")
    fields = read_surface_file(carry(folder, tmp_path / "a.ply", "map", tmp_path / "b.vtp")).surface.fields
    folded = np.isnan(fields["sd_mm"])
    assert 0 < folded.sum() < len(folded)
    np.testing.assert_array_equal(fields["motion_known"][folded], 0.0)
    assert f"FOLDS OR HAS NO INVERSE at {folded.sum()} places" in caplog.text


def test_the_command_does_what_the_function_does(run: Path, tmp_path: Path) -> None:
    write_surface(tmp_path / "a.ply", chamber(), space="LPS")
    command = [sys.executable, "-m", "o3dls", "carry", str(run), "a.ply", "--to", "map", "--out", "b.vtp"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == "b.vtp\n"
    assert "places, of which the wall tells" in done.stderr
    again = carry(run, tmp_path / "a.ply", "map", tmp_path / "c.vtp")
    assert again.read_bytes() == (tmp_path / "b.vtp").read_bytes()
    wrong = subprocess.run(
        [*command[:-3], "prior"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert wrong.returncode == 2
    assert "'prior' is not one of 'map', 'image'" in wrong.stderr


def test_one_point_alone_and_several_lists_stay_what_they_are(run: Path, tmp_path: Path) -> None:
    at = chamber().vertices[7:10]
    lists = [
        {
            "type": "Line",
            "controlPoints": [{"label": "a", "position": at[0].tolist()}, {"position": at[1].tolist()}],
        },
        {"type": "Fiducial", "controlPoints": {"label": "one", "position": at[2].tolist()}},
    ]
    (tmp_path / "a.mrk.json").write_text(json.dumps({"markups": lists}))
    path = carry(run, tmp_path / "a.mrk.json", "map", tmp_path / "b.mrk.json")
    written = json.loads(path.read_text())["markups"]
    assert [(part["type"], len(part["controlPoints"])) for part in written] == [("Line", 2), ("Fiducial", 1)]
    np.testing.assert_allclose(read_markups(path).xyz, Smooth("LPS", "LPS")(at), atol=WALL)


def test_what_cannot_be_carried_is_said(run: Path, tmp_path: Path) -> None:
    write_surface(tmp_path / "a.ply", chamber())
    with pytest.raises(InputError, match="must be map or image"):
        carry(run, tmp_path / "a.ply", "prior")
    with pytest.raises(InputError, match="'start' has no motion"):
        carry(run, tmp_path / "a.ply", "map", estimate="start")
    (tmp_path / "p.csv").write_text("x,y,z\n1,2,3\n")
    with pytest.raises(InputError, match=r"is carried as \.csv"):
        carry(run, tmp_path / "p.csv", "map", tmp_path / "p.ply")
    with pytest.raises(InputError, match="is 2D"):
        way_of(replace(read_run(run), case=disc_case()), "moved", "map")
    with pytest.raises(InputError, match="belongs to the run"):
        carry(run, tmp_path / "a.ply", "map", run / "estimates/moved/surface.vtp")


def test_an_image_is_resampled_by_the_transform_that_its_refusal_names(run: Path, tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK", reason="pip install o3dls[formats-test]")
    labels = write_image(tmp_path / "labels.nrrd")
    with pytest.raises(InputError, match="volumes are in mm; omit --units"):
        carry(run, labels, "map", tmp_path / "there.nrrd", units="mm")
    carry(run, labels, "map", tmp_path / "there.nrrd")
    grey = sitk.Cast(sitk.ReadImage(str(labels)), sitk.sitkFloat32) * 0.3
    sitk.WriteImage(grey, str(tmp_path / "grey.nrrd"))
    with pytest.raises(
        InputError, match="resample an image by the transform of o3dls export RUN --format itk"
    ):
        carry(run, tmp_path / "grey.nrrd", "map", tmp_path / "no.nrrd")
    export_run(run, tmp_path / "motion.h5", format="itk", spacing=3.0)
    found = sitk.ReadImage(str(tmp_path / "there.nrrd"))
    moved = sitk.Resample(
        grey, found, sitk.ReadTransform(str(tmp_path / "motion.h5")), sitk.sitkNearestNeighbor
    )
    same = sitk.GetArrayFromImage(moved) > 0.0
    carried = sitk.GetArrayFromImage(found) > 0
    assert 2.0 * (same & carried).sum() / (same.sum() + carried.sum()) > 0.97
