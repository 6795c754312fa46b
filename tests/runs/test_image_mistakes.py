"""What a user names wrongly to slices, wall, carry and the exports is said in a sentence that names it, and
nothing is left half-written.
"""

from __future__ import annotations

import errno
import logging
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from o3dls.cli.main import answer
from o3dls.geometry.similarity import apply, inverse
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.io.mapping.study_import import import_study
from o3dls.io.scenes.mrml import Scene
from o3dls.io.surfaces import write_surface
from o3dls.report.stacks.section import image_section
from o3dls.report.subject import read_subject
from o3dls.runs.export.scene import _add_image
from tests.finished import bulged_case, finished
from tests.io.test_io_study import carto_folder
from tests.oblique import SHAPE, affine, ball_image, write
from tests.oblique_motion import chamber, oblique_run

GAP = "of the prior's vertices: what lies outside of it has no values"
HALF = SHAPE[0] // 2 + 12  # slices of the image that hold two thirds of the ball


def heart() -> np.ndarray:
    """An image (ni, nj, nk) of a ball with blood of 300 and a brighter wall."""
    distance = ball_image()
    return np.where(distance < 0.0, 300.0, np.where(distance < 3000.0, 400.0, 100.0))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a run of a case with an image, a run with a motion on file, and a part of the image."""
    folder = tmp_path_factory.mktemp("mistakes")
    write(folder, "mri.nrrd", heart())
    write(folder, "part.nrrd", heart()[:HALF])
    write_case(folder / "case", replace(bulged_case(), prior_frame="LPS"))
    toml = folder / "case/case.toml"
    toml.write_text(toml.read_text() + 'image = "../mri.nrrd"\n')
    finished(folder / "run", read_case(folder / "case"))
    oblique_run("LPS", "LPS").write(folder / "moved")
    write_surface(folder / "tube.vtp", chamber(), space="LPS", units="mm")
    (folder / "text.txt").write_text("hello\n")
    return folder


def refused(capsys: pytest.CaptureFixture[str], *words: str | Path) -> str:
    """What a command says that ends with the code of wrong input, in one line and without a hidden name."""
    assert answer([str(word) for word in words]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert ".partial" not in said
    assert "Errno" not in said
    return said


@pytest.mark.parametrize("command", ["slices", "wall"])
def test_an_image_that_holds_a_part_of_the_heart_is_said(
    command: str, made: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    options = ["--out", str(tmp_path / "out"), "--image"]
    with caplog.at_level(logging.WARNING, "o3dls"):
        assert answer([command, str(made / "run"), *options, str(made / "mri.nrrd")]) == 0
        assert GAP not in caplog.text
        assert answer([command, str(made / "run"), *options, str(made / "part.nrrd")]) == 0
    (said,) = [record.getMessage() for record in caplog.records if GAP in record.getMessage()]
    share = float(said.split(" holds ")[1].split("%")[0])
    assert said.startswith(str(made / "part.nrrd"))
    index = apply(inverse(affine()), bulged_case().prior.vertices)
    assert share == pytest.approx(100.0 * (index[:, 0] <= HALF - 0.5).mean(), abs=1.0)


def test_a_part_of_the_heart_is_said_by_import_case_report_and_scene(
    made: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    study = carto_folder(tmp_path / "study")
    write_surface(tmp_path / "prior.ply", bulged_case().prior, space="LPS", units="mm")
    given = {"prior": tmp_path / "prior.ply", "image": made / "part.nrrd"}
    found = import_study(study, "1-Map", tmp_path / "imported", **given)
    assert [note for note in found.notes if GAP in note and "part.nrrd" in note]
    shutil.copytree(made / "case", tmp_path / "case")
    shutil.copy(made / "part.nrrd", tmp_path / "mri.nrrd")
    with caplog.at_level(logging.WARNING, "o3dls"):
        case = read_case(tmp_path / "case")
    assert caplog.text.count(GAP) == 1
    run = finished(tmp_path / "run", case)
    section = image_section(read_subject([run]))
    assert section is not None
    assert "The image holds " in section.html()
    scene = Scene(tmp_path / "scene")
    scene.folder.mkdir()
    (said,) = _add_image(scene, case, None)
    assert GAP in said


@pytest.mark.parametrize("command", ["slices", "wall"])
def test_an_image_that_is_not_there_is_said_as_it_was_named(
    command: str, made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(capsys, command, made / "run", "--image", tmp_path / "none.nii", "--out", tmp_path / "out")
    assert said.endswith("none.nii: no such file or folder")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["slices", "wall"])
def test_an_image_that_was_moved_is_named(
    command: str, made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(made / "case", tmp_path / "case")
    shutil.copy(made / "mri.nrrd", tmp_path / "mri.nrrd")
    run = finished(tmp_path / "run", read_case(tmp_path / "case"))
    (tmp_path / "mri.nrrd").rename(tmp_path / "elsewhere.nrrd")
    said = refused(capsys, command, run)
    assert said.endswith(f"the image is no longer at {tmp_path / 'mri.nrrd'}; name where it is by --image")
    assert answer([command, str(run), "--image", str(tmp_path / "elsewhere.nrrd")]) == 0


@pytest.mark.parametrize("command", ["slices", "wall"])
def test_a_file_in_place_of_the_folder_is_said(
    command: str, made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for out in (made / "text.txt", made / "text.txt/deeper"):
        said = refused(capsys, command, made / "run", "--out", out)
        assert said.endswith(f"{out}: cannot be made: {made / 'text.txt'} is a file; name another folder")


@pytest.mark.parametrize(
    "words",
    [
        ("carry", "moved", "tube.vtp", "--to", "map", "--out", "text.txt/a.vtp"),
        ("export", "moved", "--format", "mrb", "--spacing", "4", "--out", "text.txt/a.mrb"),
        ("export", "moved", "--format", "itk", "--spacing", "4", "--out", "text.txt/a.tfm"),
    ],
    ids=lambda words: words[0] + words[-1],
)
def test_a_folder_that_is_a_file_is_said(
    words: tuple[str, ...], made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(made)
    said = refused(capsys, *words)
    assert "text.txt: cannot be made" in said
    assert said.endswith("text.txt is a file; name another folder")


def test_a_folder_that_takes_no_file_is_said(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As of another user, which a test of root cannot have."""
    plain = Path.mkdir

    def mkdir(self: Path, *arguments: int, **options: bool) -> None:
        if ".partial" in self.name:
            raise PermissionError(errno.EACCES, "Permission denied", str(self))
        plain(self, *arguments, **options)

    monkeypatch.setattr(Path, "mkdir", mkdir)
    out = tmp_path / "a.vtp"
    said = refused(capsys, "carry", made / "moved", made / "tube.vtp", "--to", "map", "--out", out)
    assert said.endswith(f"{out}: cannot be written: Permission denied")
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_carried_is_said_with_what_can(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(capsys, "carry", made / "moved", made / "text.txt", "--to", "map")
    assert "no column 'x'" in said
    assert "what is carried: surfaces, lines in VTK, label volumes, Slicer's markups" in said
    (tmp_path / "table.csv").write_text("a,b\n1,2\n")
    said = refused(capsys, "carry", made / "moved", tmp_path / "table.csv", "--to", "map")
    assert "what is carried" not in said
    cine = write(tmp_path, "image.nii", np.zeros((4, 4, 4)))
    data = bytearray(cine.read_bytes())
    data[40:50] = np.array([4, 4, 4, 2, 2], "<i2").tobytes()  # of NIfTI: four axes
    cine.write_bytes(bytes(data))
    said = refused(capsys, "carry", made / "moved", cine, "--to", "map")
    assert "image.nii: " in said
    assert "4 axes" in said
