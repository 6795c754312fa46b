"""docs/tutorial.md is run as it stands: from a study with no landmark and an oblique label volume of 5 mm
slices to a report and a mesh on the image, in four commands. docs/tutorial_live.md is run without its page.
"""

from __future__ import annotations

from pathlib import Path

import nibabel
import numpy as np
import pytest
from conftest import ROOT
from test_readme import BLOCK, execute

from o3dls import read_surface
from o3dls.evaluation.distances import distances, sample
from o3dls.io.points import read_points

LIVE = (ROOT / "docs/tutorial_live.md").read_text(encoding="utf-8")
PAGE = (ROOT / "docs/tutorial.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tutorial")
    for block in BLOCK.finditer(PAGE):
        execute(block["language"], block["code"], folder)
    return folder


def test_four_commands_follow_the_study() -> None:
    commands = [block["code"].split() for block in BLOCK.finditer(PAGE)]
    assert [words[:2] for words in commands] == [
        ["python", "-m"],
        ["o3dls", "import"],
        ["o3dls", "run"],
        ["o3dls", "export"],
        ["o3dls", "export"],
    ]


def test_the_wall_is_near_the_true_one(done: Path) -> None:
    """Nearer than the pose alone, and within half a millimetre more than the page says."""
    truth = read_surface(done / "study/true_wall.ply")
    off = {}
    for name in ("global_pose", "level_set"):
        found = read_surface(done / f"run/estimates/{name}/surface.ply")
        off[name] = (distances(sample(truth), found).mean() + distances(sample(found), truth).mean()) / 2.0
    assert off["level_set"] < 0.7 * off["global_pose"]
    assert off["level_set"] < 1.0
    assert (done / "run/report.html").stat().st_size > 10_000


def test_the_voltages_lie_on_the_image(done: Path) -> None:
    wall, prior = read_surface(done / "wall.vtp"), read_surface(done / "case/prior.ply")
    np.testing.assert_allclose(wall.vertices, prior.vertices, atol=1e-9)
    assert np.isfinite(wall.fields["bipolar"]).mean() > 0.8
    labels, given = (nibabel.load(done / name) for name in ("labels.nii.gz", "study/la_labels.nii.gz"))
    np.testing.assert_allclose(labels.affine, given.affine, atol=1e-4)
    ours, theirs = (np.asanyarray(image.dataobj) for image in (labels, given))
    assert set(np.unique(ours)) == {0, 1, 2, 3}
    # the surface passes no centre of a voxel
    assert ((ours > 0) != (theirs > 0)).sum() <= 0.01 * (theirs > 0).sum()


def test_the_live_session_ends_as_a_run(tmp_path: Path) -> None:
    shown, *others = [block for block in BLOCK.finditer(LIVE) if "o3dls live" in block["code"]]
    assert shown["spared"]
    assert len(others) == 1
    for block in BLOCK.finditer(LIVE):
        if not block["spared"]:
            execute(block["language"], block["code"], tmp_path)
    points = read_points(tmp_path / "session/case/points.csv")
    assert (points.type == "eam").sum() == 100
    assert (points.type == "landmark").sum() == 4
    assert np.isfinite(read_surface(tmp_path / "wall.vtp").fields["bipolar"]).any()
