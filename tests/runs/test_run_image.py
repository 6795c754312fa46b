"""A run refers to the image of its case by path and hash; it neither copies it nor needs it to be read."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from o3dls.case import Case
from o3dls.errors import InputError
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.io.grey.image import image_hash
from o3dls.io.grey.of_case import open_kept_image
from o3dls.runs.folder import is_done, read_run
from tests.finished import bulged_case, finished
from tests.oblique import ball_image, write


def case_with_image(folder: Path) -> tuple[Case, Path]:
    """The case of the bulged ball, with an oblique image beside it."""
    image = write(folder, "mri.nii.gz", ball_image())
    write_case(folder / "case", replace(bulged_case(), prior_frame="LPS"))
    toml = folder / "case" / "case.toml"
    toml.write_text(toml.read_text() + 'image = "../mri.nii.gz"\n')
    return read_case(folder / "case"), image


def test_a_run_keeps_path_and_hash_and_no_copy(tmp_path: Path) -> None:
    case, image = case_with_image(tmp_path)
    run = finished(tmp_path / "run", case)
    kept = {"path": str(image), "sha256": image_hash(image)}
    assert json.loads((run / "run.json").read_text())["case"]["image"] == kept
    assert not [path for path in run.rglob("*") if path.suffix == ".gz"]
    assert read_run(run).case.image == kept
    assert read_case(run / "case").image == kept
    assert open_kept_image(read_run(run).case).path == image


def test_a_run_is_read_without_its_image_and_says_that_it_is_gone_or_another(tmp_path: Path) -> None:
    case, image = case_with_image(tmp_path)
    run = finished(tmp_path / "run", case)
    write(tmp_path, "mri.nii.gz", ball_image(19.0))
    with pytest.raises(InputError, match="was changed since the run"):
        open_kept_image(read_run(run).case)
    image.unlink()
    with pytest.raises(InputError, match="the image is no longer at"):
        open_kept_image(read_run(run).case)
    with pytest.raises(InputError, match=r"mri.nii.gz: no such file"):
        read_case(run / "case")


def test_a_case_whose_image_was_changed_is_another_case(tmp_path: Path) -> None:
    case, _ = case_with_image(tmp_path)
    run = finished(tmp_path / "run", case)
    pipeline = read_run(run).provenance.pipeline
    assert is_done(run, pipeline, case)
    assert not is_done(run, pipeline, replace(case, image={**case.image, "sha256": "0"}))


def test_a_run_without_an_image_says_nothing_of_one(tmp_path: Path) -> None:
    run = finished(tmp_path / "run")
    assert "image" not in json.loads((run / "run.json").read_text())["case"]
