"""tools/slicer: what the module for 3D Slicer does without its panel, by slicer-core, and that the panel only
asks and shows.
"""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import stat
import sys
import time
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import o3dls
from o3dls.geometry.similarity import TURN, apply, similarity
from o3dls.io.case_reader import read_case
from o3dls.io.images.registry import read_image
from tests.oblique_motion import AFFINE, chamber, image, oblique_case
from tests.slicer import ROOT, in_slicer, slicer_python

MODULE = ROOT / "tools/slicer/O3dls"
SHIFT = similarity(np.eye(3), np.array([3.0, -2.0, 5.0]))
RAS = np.array([-1.0, -1.0, 1.0])


def part(name: str) -> ModuleType:
    """A part of the module that needs nothing of Slicer."""
    spec = importlib.util.spec_from_file_location(f"slicer_{name}", MODULE / f"o3dls_slicer/{name}.py")
    assert spec is not None
    assert spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What lies in Slicer's scene, in RAS: the chamber, its voxels, points and landmarks in one frame."""
    case = oblique_case()
    measured, path = case.points, tmp_path_factory.mktemp("given") / "given.npz"
    np.savez(
        path,
        vertices=apply(np.linalg.inv(SHIFT), chamber().vertices * RAS),
        faces=chamber().faces,
        shift=SHIFT,
        labels=2 * (image() > 0),
        affine=TURN @ AFFINE,
        points=measured.of("eam").xyz * RAS,
        bipolar=measured.of("eam").numbers("bipolar").round(3),
        sites=measured.of("ablation").xyz * RAS,
        on_prior=np.array(list(case.prior_landmarks.values())) * RAS,
        on_map=measured.of("landmark").xyz * RAS,
    )
    return path


def test_nodes_of_each_kind_become_a_case(given: Path, tmp_path: Path) -> None:
    slicer_python()
    in_slicer("case", MODULE, given, tmp_path)
    known = oblique_case()
    case = read_case(tmp_path / "model")
    assert (case.frame, case.prior_frame, case.units) == ("LPS", "LPS", "mm")
    # under a transform: where it is shown
    np.testing.assert_allclose(case.prior.vertices, chamber().vertices, atol=1e-4)
    np.testing.assert_array_equal(case.prior.faces, chamber().faces)
    for kind in ("eam", "ablation", "landmark"):
        np.testing.assert_allclose(case.points.of(kind).xyz, known.points.of(kind).xyz, atol=1e-6)
    measured = case.points.of("eam")
    np.testing.assert_allclose(
        measured.numbers("bipolar"), known.points.of("eam").numbers("bipolar"), atol=6e-4
    )
    np.testing.assert_array_equal(measured.numbers("unipolar"), 2.5)
    assert np.isnan(measured.numbers("lat")).all()  # CARTO's sign for no value
    np.testing.assert_allclose(
        list(case.prior_landmarks.values()), list(known.prior_landmarks.values()), atol=1e-6
    )
    assert list(case.prior_landmarks) == [f"mark {k}" for k in range(4)]

    path = tmp_path / "segment/prior.nrrd"
    labels = read_image(path, path.read_bytes())
    np.testing.assert_allclose(labels.affine, AFFINE, atol=1e-6)
    np.testing.assert_array_equal(labels.values.transpose(2, 1, 0), image() > 0)
    for name in ("segment", "map"):
        found = read_case(tmp_path / name)
        np.testing.assert_allclose(found.points.xyz, known.points.of("eam").xyz, atol=1e-6)
        assert np.abs(chamber().closest_point.distance(found.prior.vertices)).max() < 2.5  # a voxel is long
    assert np.isfinite(read_case(tmp_path / "map").points.numbers("bipolar")).all()
    said = json.loads((tmp_path / "said.json").read_text())
    assert [sentence.split(":")[0] for sentence in said] == [
        "choose the prior",
        "choose the points",
        "segmentation",
        "shift",
    ]


def wrapper(folder: Path, body: str = "") -> Path:
    """A Python that finds this checkout, which a Python of its own would have installed."""
    path = folder / "python"
    path.write_text(f'#!/bin/sh\n{body}\nexport PYTHONPATH="{ROOT}"\nexec "{sys.executable}" "$@"\n')
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def test_a_run_in_another_python_comes_back_into_the_scene(given: Path, tmp_path: Path) -> None:
    slicer_python()
    in_slicer("module", MODULE, given, tmp_path / "work", wrapper(tmp_path))
    about: dict[str, Any] = json.loads((tmp_path / "work/about.json").read_text())
    assert about["failure"] == "", about["lines"][-5:]
    assert about["version"] == o3dls.__version__
    assert any("level_set" in line for line in about["lines"])
    assert about["url"] == "/the/users/scene.mrml"  # what is saved goes where it went
    assert about["kept"] == 70
    loaded = about["loaded"]
    assert {
        "prior",
        "result",
        "points",
        "ablation sites",
        "map onto image",
        "landmarks of the map",
    } <= loaded.keys()
    # the result, brought back, lies where the segment ends
    world = np.array(loaded["result"]["world"]) * RAS
    assert np.median(chamber().closest_point.distance(world)) < 1.5


def test_a_python_is_found_or_asked_for(tmp_path: Path) -> None:
    job = part("job")
    python = wrapper(tmp_path)
    assert job.find_python(str(python), {}) == (python, o3dls.__version__)
    assert job.find_python("", {"O3DLS_PYTHON": str(python)})[0] == python
    beside = tmp_path / "bin"
    beside.mkdir()
    command = beside / "o3dls"
    command.write_text("#!/bin/sh\n")
    command.chmod(0o755)
    wrapper(beside)
    assert job.find_python("", {"PATH": str(beside)})[0] == beside / "python"
    with pytest.raises(job.NotFound, match="none on the PATH, and O3DLS_PYTHON names none"):
        job.find_python("", {"PATH": ""})
    with pytest.raises(job.NotFound, match="has no o3dls"):
        job.find_python(str(wrapper(tmp_path, "exit 1")), {})


def test_slicers_variables_are_kept_from_it() -> None:
    given = {"PYTHONHOME": "a", "PYTHONPATH": "b", "LD_LIBRARY_PATH": "c", "HOME": "d", "O3DLS_PYTHON": "e"}
    assert part("job").without_slicer(given) == {"HOME": "d", "O3DLS_PYTHON": "e"}


def test_a_job_says_how_it_ends(tmp_path: Path) -> None:
    job = part("job")

    def ended(*steps: str, cancel: bool = False) -> Any:
        found = job.Job([["sh", "-c", step, "run"] for step in steps], {"PATH": os.environ["PATH"]})
        if cancel:
            while not found.lines():
                time.sleep(0.01)
            found.cancel()
        while found.running:
            time.sleep(0.01)
        return found

    good = ended("echo one", "echo two")
    assert (good.failure, good.valid, good.lines()) == ("", True, ["one", "two"])
    doubtful = ended("exit 1", "echo still")
    assert (doubtful.failure, doubtful.valid, doubtful.lines()) == ("", False, ["still"])
    bad = ended("echo the case is wrong; exit 2", "echo never")
    assert (bad.failure, bad.lines()) == ("the case is wrong", ["the case is wrong"])
    assert ended("echo on; exec sleep 60", "echo never", cancel=True).failure == "cancelled"


def test_only_the_panel_has_qt() -> None:
    """And it is thin: no file is read and no process started but by the parts that are tested."""
    for path in MODULE.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        names = {
            alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names
        }
        if path.name == "O3dls.py":
            assert len(path.read_text(encoding="utf-8").splitlines()) < 160
            assert not names & {"subprocess", "csv", "vtk", "numpy"}
        else:
            assert not names & {"qt", "ctk", "slicer"}
    assert "not tried in the application" in (MODULE.parent / "README.md").read_text(encoding="utf-8")
