"""A run as a scene of 3D Slicer: what the bundle holds, and what Slicer's own libraries make of it, node by
node.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from o3dls.arrays import Array
from o3dls.errors import InputError, PipelineError
from o3dls.geometry.similarity import apply, inverse
from o3dls.io.images.registry import read_image
from o3dls.io.images.volumes import write_volume
from o3dls.io.scenes.mrml import Scene
from o3dls.quantities import VOLTAGES
from o3dls.runs.export.finished import export_run
from o3dls.runs.export.scene import _add_image, _add_points
from o3dls.runs.export.writer import Export
from tests.oblique_motion import AFFINE, NAMES, Smooth, chamber, image, oblique_case, oblique_run, turn_of
from tests.slicer import in_slicer, slicer_python

# as the module in tools/slicer reads the values of a point
DESCRIBED = re.compile(r"(Bipolar|Unipolar|LAT) (-?[\d.]+(?:e[+-]?\d+)?)")
RAS = np.array([-1.0, -1.0, 1.0])
INVERSE = 0.06  # mm: Slicer's own inverse of a field with nodes 1 mm apart, and vertices between its places
Nodes = dict[str, dict[str, Any]]


def grey(path: Path, space: str) -> Path:
    """A grey image of the chamber on its oblique voxels, its axes given in LPS or RAS."""
    values = 300.0 * gaussian_filter((image() > 0).astype(np.float32), 0.7)
    write_volume(path, values, turn_of(space) @ AFFINE, space=space)
    return path


def opened(bundle: Path, folder: Path) -> Nodes:
    """The nodes by name, as slicer-core opens the bundle."""
    in_slicer("scene", bundle, folder / "scene", folder / "nodes.json")
    return {one["name"]: one for one in json.loads((folder / "nodes.json").read_text()).values()}


def in_lps(points: list[list[float]]) -> Array:
    return np.array(points) * RAS


@pytest.mark.parametrize(("prior_frame", "frame"), [("RAS", "LPS"), ("LPS", "RAS")])
def test_slicer_opens_every_node_where_it_belongs(prior_frame: str, frame: str, tmp_path: Path) -> None:
    slicer_python()
    run = oblique_run(prior_frame, frame)
    folder = run.write(tmp_path / "run")
    picture = grey(tmp_path / "grey.nii.gz" if frame == "RAS" else tmp_path / "grey.nrrd", prior_frame)
    path = export_run(folder, tmp_path / "a.mrb", format="mrb", image=picture)
    nodes = opened(path, tmp_path)
    wall, case = chamber().vertices, oblique_case(prior_frame, frame)
    moved = Smooth("LPS", "LPS")(wall)
    pose = run.estimates["moved"].T_map_prior

    assert nodes["bend onto image"]["class"] == "vtkMRMLGridTransformNode"
    assert nodes["bend onto image"]["parent"] is None
    assert nodes["map onto image"]["class"] == "vtkMRMLLinearTransformNode"
    assert nodes["map onto image"]["parent"] == "bend onto image"
    assert nodes["map onto image"]["linear"]
    expected = inverse(turn_of(frame) @ pose @ turn_of(prior_frame))
    np.testing.assert_allclose(
        np.array(nodes["map onto image"]["matrix"]), turn_of("RAS") @ expected @ turn_of("RAS"), atol=1e-9
    )

    prior, result = nodes["prior"], nodes["result"]
    assert (prior["parent"], result["parent"]) == (None, "map onto image")
    np.testing.assert_allclose(in_lps(prior["points"]), wall, atol=1e-6)
    np.testing.assert_allclose(in_lps(result["points"]), moved, atol=1e-6)
    # brought onto the image, the result lies on the prior that was moved to it
    assert np.linalg.norm(in_lps(result["world"]) - wall[::50], axis=1).max() < INVERSE
    assert result["cells"] == len(chamber().faces)
    np.testing.assert_allclose(result["arrays"]["sd_mm"], 0.7, atol=1e-3)
    assert (result["scalar"], result["shown"], result["range"]) == (
        "bipolar",
        True,
        list(VOLTAGES["bipolar"]),
    )
    assert result["colours"] == "bipolar 0.5 to 1.5 mV"
    entries = np.array(nodes["bipolar 0.5 to 1.5 mV"]["entries"])
    np.testing.assert_allclose(entries[[0, -1], 0], VOLTAGES["bipolar"])
    assert entries[0, 1] > 2 * entries[0, 2:].max()  # red for scar
    assert entries[-1, 3] > entries[-1, 2]  # violet for healthy wall

    measured = case.points.of("eam")
    np.testing.assert_allclose(
        in_lps(nodes["points"]["points"]), apply(turn_of(frame), measured.xyz), atol=1e-6
    )
    np.testing.assert_allclose(nodes["points"]["arrays"]["bipolar"], measured.numbers("bipolar"))
    assert nodes["points"]["parent"] == "map onto image"
    sites, there = nodes["ablation sites"], nodes["landmarks of the map"]
    np.testing.assert_allclose(
        in_lps(sites["points"]), apply(turn_of(frame), case.points.of("ablation").xyz), atol=1e-6
    )
    assert (sites["parent"], there["parent"]) == ("map onto image", "map onto image")
    clicked = nodes["points as markups"]
    np.testing.assert_allclose(clicked["points"], nodes["points"]["points"], atol=1e-6)
    assert [float(dict(DESCRIBED.findall(said))["Bipolar"]) for said in clicked["said"]] == pytest.approx(
        measured.numbers("bipolar").tolist(), rel=1e-4
    )
    assert clicked["labels"][:2] == ["1", "2"]
    flags = {
        name: tuple(nodes[name][key] for key in ("shown", "named", "locked"))
        for name in ("points as markups", "ablation sites", "landmarks of the map", "landmarks of the prior")
    }
    assert flags == {
        "points as markups": (False, False, True),
        "ablation sites": (True, False, True),
        "landmarks of the map": (True, True, False),
        "landmarks of the prior": (True, True, False),
    }
    here = nodes["landmarks of the prior"]
    assert here["parent"] is None
    assert here["labels"] == there["labels"] == list(NAMES)
    marks = apply(turn_of(prior_frame), np.array(list(case.prior_landmarks.values())))
    np.testing.assert_allclose(in_lps(here["points"]), marks, atol=1e-6)
    assert np.linalg.norm(in_lps(there["world"]) - marks, axis=1).max() < INVERSE

    volume = nodes["image"]
    voxels = read_image(picture, picture.read_bytes())
    np.testing.assert_allclose(
        np.array(volume["affine"]), turn_of("RAS") @ turn_of(voxels.space) @ voxels.affine, atol=1e-4
    )
    assert volume["shape"] == list(voxels.values.shape[::-1])
    assert volume["sum"] == pytest.approx(float(voxels.values.sum()), rel=1e-4)
    assert volume["parent"] is None


def test_what_slicer_cannot_move_as_markups_is_a_cloud(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = oblique_case().points
    counts = {kind: len(points.of(kind)) for kind in ("eam", "inside", "ablation", "landmark")}
    measured = counts["eam"] + counts["inside"]
    assert 0 < counts["landmark"] < counts["ablation"] < measured

    def names(most: int) -> list[tuple[str, str]]:
        monkeypatch.setattr("o3dls.runs.export.scene.MOST_MARKUPS", most)
        scene = Scene(tmp_path / str(most))
        scene.folder.mkdir()
        _add_points(scene, points, np.eye(4), None, "")
        return [(node.split("Node")[0], one["name"]) for node, one in scene.nodes.items()]

    model, marks = "vtkMRMLModel", "vtkMRMLMarkupsFiducial"
    few = [(marks, "ablation sites"), (marks, "landmarks of the map")]
    assert names(measured) == [(model, "points"), (marks, "points as markups"), *few]
    assert names(measured - 1) == [(model, "points"), *few]
    assert names(counts["ablation"] - 1) == [(model, "points"), (model, "ablation sites"), few[1]]


def test_a_bundle_is_whole_and_the_same_each_time(tmp_path: Path) -> None:
    folder = oblique_run().write(tmp_path / "run")
    first, second = (export_run(folder, tmp_path / f"{k}/a.mrb", format="mrb", spacing=4.0) for k in "ab")
    assert first.read_bytes() == second.read_bytes()
    with zipfile.ZipFile(first) as bundle:
        names = bundle.namelist()
        mrml = bundle.read("a/a.mrml").decode()
    assert "a/Data/result.vtp" in names
    assert not any(name.endswith(".ply") for name in names)  # Slicer's reader of PLY keeps no values
    assert all(f'fileName="{name.removeprefix("a/")}"' in mrml for name in names if "/Data/" in name)
    facts = json.loads((tmp_path / "a/a.mrb.json").read_text())
    assert {"name": "result", "under": "map onto image"} in facts["nodes"]
    assert {"name": "prior", "under": ""} in facts["nodes"]


def test_an_estimate_without_a_motion_has_its_pose(tmp_path: Path) -> None:
    folder = oblique_run().write(tmp_path / "run")
    path = export_run(folder, tmp_path / "a.mrb", format="mrb", estimate="start")
    with zipfile.ZipFile(path) as bundle:
        mrml = bundle.read("a/a.mrml").decode()
    assert "GridTransform" not in mrml
    assert "LinearTransform" in mrml


def test_an_image_is_checked(tmp_path: Path) -> None:
    folder = oblique_run().write(tmp_path / "run")
    with pytest.raises(InputError, match="no such file or folder"):
        export_run(folder, tmp_path / "a.mrb", format="mrb", image=tmp_path / "none.nrrd")
    (tmp_path / "no.nrrd").write_text("nothing")
    with pytest.raises(InputError, match="not an image"):
        export_run(folder, tmp_path / "a.mrb", format="mrb", image=tmp_path / "no.nrrd", spacing=4.0)
    with pytest.raises(PipelineError, match="belongs to the format mrb"):
        Export(format="itk", image=tmp_path / "none.nrrd")


def test_the_image_of_a_case_comes_with_it_or_is_said_to_be_missing(tmp_path: Path) -> None:
    picture = grey(tmp_path / "grey.nrrd", "LPS")
    case = replace(oblique_case(), image={"path": str(picture)})
    there, gone = (Scene(tmp_path / name) for name in ("there", "gone"))
    for scene in (there, gone):
        scene.folder.mkdir()
    assert _add_image(there, case, None) == []
    assert [node["name"] for node in there.nodes.values()] == ["image"]
    picture.unlink()
    (said,) = _add_image(gone, case, None)
    assert said.startswith("the image of the case is left out: ")
    assert gone.nodes == {}
    with pytest.raises(InputError):
        _add_image(gone, case, picture)


def test_three_commands_lead_from_a_study_to_a_fused_scene(tmp_path: Path) -> None:
    slicer_python()

    def call(*words: str) -> None:
        subprocess.run([sys.executable, "-m", *words], cwd=tmp_path, check=True, capture_output=True)

    call("data_synth", "study", "study", "--seed", "7")
    labels = tmp_path / "study/la_labels.nii.gz"
    found = read_image(labels, labels.read_bytes())
    grey_values = 400.0 * gaussian_filter((found.values == 1).astype(np.float32), 0.6).transpose(2, 1, 0)
    write_volume(tmp_path / "study/mri.nrrd", grey_values, found.affine, space=found.space)

    call("o3dls", "import", "study/map.mat", "case", "--prior", "study/la_labels.nii.gz")
    call("o3dls", "run", "--case", "case", "--out", "run")
    call("o3dls", "export", "run", "--format", "mrb", "--image", "study/mri.nrrd", "--out", "fused.mrb")

    nodes = opened(tmp_path / "fused.mrb", tmp_path)
    assert {"image", "prior", "result", "points", "map onto image", "bend onto image"} <= nodes.keys()
    # on the image: the wall of the map lies where the chamber ends
    affine = turn_of("RAS") @ turn_of(found.space) @ found.affine
    np.testing.assert_allclose(np.array(nodes["image"]["affine"]), affine, atol=1e-3)
    index = np.rint(apply(inverse(affine), np.array(nodes["result"]["world"]))).astype(int)
    inside = gaussian_filter((found.values == 1).astype(float), 1.0)[tuple(index.T[::-1])]
    assert 0.2 < np.median(inside) < 0.8
    assert nodes["result"]["arrays"]["bipolar"]
