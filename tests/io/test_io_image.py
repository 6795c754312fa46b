"""The grey image of a case: it lies where its voxels lie, only what is asked for is held in memory, and what
is wrong with it is said in one sentence.
"""

from __future__ import annotations

import gzip
import json
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
from test_io_study import carto_folder

from o3dls.case import Case
from o3dls.cli.main import answer
from o3dls.errors import InputError
from o3dls.geometry.similarity import TURN
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.io.grey.image import GreyImage, image_hash, open_image
from o3dls.io.grey.of_case import open_case_image
from o3dls.io.images.volumes import write_volume
from o3dls.io.mapping.study_import import import_study
from o3dls.io.points import write_points
from o3dls.io.surfaces import read_surface_file, write_surface
from tests.finished import bulged_case
from tests.oblique import FORMATS, affine, ball_image, meta, write, write_series
from tests.tiny import disc_case

INSIDE = np.random.default_rng(31_977).uniform(-25.0, 25.0, size=(400, 3))
WALL = bulged_case().prior.vertices
ROUNDING = 0.02  # mm: of linear interpolation between voxels of 2.2 mm, at 20 mm and beyond


def needs_pydicom(name: str) -> None:
    if name == "series":
        pytest.importorskip("pydicom", reason="a DICOM series needs pydicom: pip install 'o3dls[dicom]'")


def opened(path: Path, frame: str = "LPS", vertices: np.ndarray = WALL) -> GreyImage:
    return open_image(path, vertices if frame != "RAS" else vertices * [-1, -1, 1], frame)


@pytest.mark.parametrize("frame", ["LPS", "RAS"])
@pytest.mark.parametrize("name", FORMATS)
def test_values_are_where_the_voxels_lie(name: str, frame: str, tmp_path: Path) -> None:
    needs_pydicom(name)
    image = opened(write(tmp_path, name, ball_image()), frame)
    at = INSIDE * ([-1, -1, 1] if frame == "RAS" else [1, 1, 1])
    found = image.around(at).sample(at) / 1000.0
    far = np.linalg.norm(INSIDE, axis=1) > 10.0  # nearer to its middle a distance is no linear function
    off = found - (np.linalg.norm(INSIDE, axis=1) - 20.0)
    assert far.sum() > 300
    assert np.abs(off[far]).max() < 0.11  # curvature over half a voxel: 1.1² / (2 · 10) and less
    assert abs(off[far].mean()) < ROUNDING + 0.03  # no half voxel: that would be 0.4 mm and more
    assert image.frame == frame


@pytest.mark.parametrize("name", FORMATS)
def test_slices_are_those_of_the_whole(name: str, tmp_path: Path) -> None:
    needs_pydicom(name)
    values = ball_image()
    volume = opened(write(tmp_path, name, values)).volume
    assert volume.shape == values.shape
    window = (slice(30, 50), slice(10, 40))
    found = volume.slab(7, 12, window)
    assert found == pytest.approx(values[10:40, 30:50, 7:12].T, abs=2.0 if name == "series" else 0.02)


@pytest.mark.parametrize("name", ["big.nii", "big.nii.gz", "big.nrrd", "big.mha"])
def test_only_the_slices_that_are_asked_for_are_held(name: str, tmp_path: Path) -> None:
    values = np.zeros((160, 160, 160), dtype=np.float32)
    path = write(tmp_path, name, values, np.diag([1.0, 1, 1, 1]))
    tracemalloc.start()
    part = open_image(path, np.full((1, 3), 80.0), "LPS").around(np.full((1, 3), 80.0), 8.0)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert part.values.shape == pytest.approx([20, 20, 20], abs=2)
    assert most < values.nbytes / 3


def test_scale_and_offset_of_a_header_are_applied(tmp_path: Path) -> None:
    stored = np.arange(6 * 5 * 4, dtype=np.int16).reshape(6, 5, 4)
    image = nibabel.Nifti1Image(stored, TURN @ np.diag([2.0, 2, 2, 1]))
    image.header.set_slope_inter(0.5, -20.0)
    nibabel.save(image, tmp_path / "a.nii")
    found = open_image(tmp_path / "a.nii", np.ones((1, 3)), "LPS").around(np.ones((1, 3)), 20.0)
    assert found.values == pytest.approx((0.5 * stored - 20.0).T)


def spoil(change: str, path: Path) -> Path:
    """An image of which one thing is wrong."""
    values, lps = ball_image(), affine()
    if change == "missing":
        return path / "none.nrrd"
    if change == "empty":
        (path / "a.nii").write_bytes(b"")
        return path / "a.nii"
    if change == "text":
        (path / "a.nii").write_text("not an image")
        return path / "a.nii"
    if change == "truncated":
        file = write(path, "image.mha", values)
        file.write_bytes(file.read_bytes()[:-40_000])
        return file
    if change in ("packed end", "packed byte"):
        file = write(path, "image.nii.gz", values)
        data = bytearray(file.read_bytes())
        if change == "packed byte":
            data[len(data) // 2] ^= 0x55
        file.write_bytes(bytes(data if change == "packed byte" else data[:-40_000]))
        return file
    if change == "more":
        data = gzip.decompress(write(path, "image.nii.gz", values).read_bytes())
        (path / "image.nii.gz").write_bytes(gzip.compress(data + b"1" * 400))
        return path / "image.nii.gz"
    if change == "phases":
        nibabel.save(nibabel.Nifti1Image(np.zeros((9, 9, 9, 4), np.int16), np.eye(4)), path / "a.nii")
        return path / "a.nii"
    if change == "no form":
        image = nibabel.Nifti1Image(np.zeros((90, 90, 90), np.int16), None)
        image.header["sform_code"] = image.header["qform_code"] = 0
        nibabel.save(image, path / "a.nii")
        return path / "a.nii"
    if change == "elsewhere":
        lps[:3, 3] += [900.0, 0.0, 0.0]
    if change in ("metres", "micrometres"):
        lps[:3] *= 0.001 if change == "metres" else 1000.0
    if change == "turned":
        lps[:3, 3] += [300.0, 200.0, 0.0]
    if change == "sidecar":
        (path / "a.json").write_text(json.dumps({"PixelSpacing": [3.0, 3.0], "SpacingBetweenSlices": 2.2}))
        return write(path, "a.nrrd", values)
    return write(path, "a.nrrd", values, lps)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("missing", "none.nrrd: no such file"),
        ("empty", "is empty"),
        ("text", "must be NIfTI, NRRD, MetaImage, or a folder with a DICOM series"),
        ("truncated", "the file is truncated"),
        ("packed end", "the file is truncated"),
        ("packed byte", "damaged"),
        ("more", "unpack to more than"),
        ("phases", "one volume in 3D; save the phase"),
        ("no form", "does not say how its axes lie in the body: orient it first"),
        ("elsewhere", "does not lie in this image: it holds 0% of its .* name the image that the prior was"),
        ("metres", "if the image's lengths were in m: its header must state sizes and origin in mm"),
        ("micrometres", "more than a body: it must state sizes and origin in mm"),
        ("sidecar", "correct the one that is wrong"),
    ],
)
def test_what_is_wrong_is_said(change: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        opened(spoil(change, tmp_path))


def test_an_image_in_the_other_frame_is_told(tmp_path: Path) -> None:
    path = spoil("turned", tmp_path)
    with pytest.raises(InputError, match=r"left and right, front and back exchanged: one of the two files"):
        opened(path, vertices=WALL + np.array([-300.0, -200.0, 0.0]))


@pytest.mark.parametrize("shift", [0.0, 60.0])
def test_a_prior_whose_frame_is_unknown_is_placed_only_where_one_frame_fits(
    shift: float, tmp_path: Path
) -> None:
    lps = affine()
    lps[:3, 3] += [shift, shift, 0.0]
    path = write(tmp_path, "a.nrrd", ball_image(), lps)
    moved = WALL + np.array([shift, shift, 0.0])
    if shift:
        assert opened(path, "unknown", moved).frame == "LPS"
        assert opened(path, "unknown", moved * [-1, -1, 1]).frame == "RAS"
    else:
        with pytest.raises(InputError, match=r"frame of the prior is not known.*convert PRIOR prior.ply"):
            opened(path, "unknown", moved)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("two", r"holds 2 series \(LGE: 25 files; scout: 25 files\)"),
        ("gap", r"slices 20 and 21 of 49 are 4.4 mm apart, the others 2.2 mm: one is missing"),
        ("phases", "several slices at one place, as of phases"),
        ("no place", "has no ImagePositionPatient: must be one slice"),
        ("sizes", "differ in size, in spacing or in direction"),
        ("pixels", "cannot be read as a slice of DICOM"),
        ("none", "is a folder without DICOM files"),
        ("file", "is one file of DICOM: name the folder"),
    ],
)
def test_what_is_wrong_with_a_series_is_said(change: str, words: str, tmp_path: Path) -> None:
    needs_pydicom("series")

    def spoiled(k: int, image: Any) -> None:
        if change == "two" and k % 2:
            image.SeriesInstanceUID, image.SeriesDescription = "1.2.3", "scout"
        if change == "phases":
            image.ImagePositionPatient = [0.0, 0.0, float(k // 2)]
        if change == "no place" and k == 3:
            del image.ImagePositionPatient
        if change == "sizes" and k == 3:
            image.PixelSpacing = [5.0, 5.0]
        if change == "pixels" and k == 3:
            image.PixelData = image.PixelData[:100]

    folder = tmp_path / "series"
    write_series(folder, ball_image(), affine(), spoiled)
    if change == "gap":
        next(folder.glob("*_20.dcm")).unlink()
    if change == "none":
        folder = tmp_path / "other"
        folder.mkdir()
    with pytest.raises(InputError, match=words):
        opened(next(folder.iterdir()) if change == "file" else folder)


def prior_in(case: Case) -> Case:
    return replace(case, prior_frame="LPS")


@pytest.mark.parametrize("name", ["image.nii.gz", "series"])
def test_a_case_has_the_path_and_the_hash_of_its_image(name: str, tmp_path: Path) -> None:
    needs_pydicom(name)
    write_case(tmp_path / "case", prior_in(bulged_case()))
    image = write(tmp_path, name, ball_image())
    toml = tmp_path / "case" / "case.toml"
    toml.write_text(toml.read_text() + f'image = "../{name}"\n')
    case = read_case(tmp_path / "case")
    assert case.image == {"path": str(image), "sha256": image_hash(image)}
    assert open_case_image(case).frame == "LPS"
    assert name not in case.files


def test_a_case_without_an_image_has_none(tmp_path: Path) -> None:
    write_case(tmp_path / "case", bulged_case())
    assert read_case(tmp_path / "case").image == {}
    assert "image" not in (tmp_path / "case" / "case.toml").read_text()


def test_a_wrong_image_stops_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_case(tmp_path / "case", prior_in(bulged_case()))
    toml = tmp_path / "case" / "case.toml"
    toml.write_text(toml.read_text() + 'image = "mri.nii"\n')
    assert answer(["run", "--case", str(tmp_path / "case"), "--out", str(tmp_path / "run")]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert "case/mri.nii: no such file" in said[0]
    assert not (tmp_path / "run").exists()


def test_a_label_volume_serves_where_there_is_no_grey_image(tmp_path: Path) -> None:
    (tmp_path / "case").mkdir()
    labels = write(tmp_path / "case", "prior.nrrd", (ball_image() < 0).astype(np.uint8))
    write_points(tmp_path / "case" / "points.csv", bulged_case().points)
    case = read_case(tmp_path / "case")
    assert case.image == {"path": str(labels), "shows": "labels", "sha256": image_hash(labels)}
    assert open_case_image(case).around(np.zeros((1, 3))).sample(np.zeros((1, 3))) == pytest.approx(1.0)


def test_init_writes_the_image_as_seen_from_the_case(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = bulged_case()
    write_surface(tmp_path / "prior.ply", case.prior, space="LPS")
    write_points(tmp_path / "points.csv", case.points)
    image = write(tmp_path, "mri.nrrd", ball_image())
    given = ["--prior", str(tmp_path / "prior.ply"), "--points", str(tmp_path / "points.csv")]
    assert answer(["init", str(tmp_path / "case"), *given, "--image", str(image)]) == 0
    assert 'image = "../mri.nrrd"' in (tmp_path / "case" / "case.toml").read_text()
    assert read_case(tmp_path / "case").image["path"] == str(image)
    wrong = write(tmp_path, "far.nrrd", ball_image(), np.diag([1.0, 1, 1, 1]) + np.eye(4, k=3) * 800)
    capsys.readouterr()
    assert answer(["init", str(tmp_path / "b"), *given, "--image", str(wrong)]) == 2
    assert "the prior does not lie in this image" in capsys.readouterr().err
    assert not (tmp_path / "b").exists()


def test_a_volume_whose_bytes_stand_in_the_middle_is_read_as_a_whole(tmp_path: Path) -> None:
    values = ball_image()
    data = meta(values, affine()).replace(b"ElementDataFile", b"HeaderSize = -1\nElementDataFile")
    (tmp_path / "a.mha").write_bytes(data)
    part = opened(tmp_path / "a.mha").around(INSIDE)
    write_volume(tmp_path / "b.nrrd", values, affine(), space="LPS")
    same = opened(tmp_path / "b.nrrd").around(INSIDE)
    assert part.values == pytest.approx(same.values)


def test_an_import_refers_to_the_image_of_its_prior(tmp_path: Path) -> None:
    study = carto_folder(tmp_path / "study")
    write_surface(tmp_path / "prior.ply", bulged_case().prior, space="LPS", units="mm")
    image = write(tmp_path, "mri.nrrd", ball_image())
    prior = tmp_path / "prior.ply"
    found = import_study(study, "1-Map", tmp_path / "case", prior=prior, image=image)
    assert any("mri.nrrd, which stays where it is" in line for line in found.took)
    assert 'image = "../mri.nrrd"' in (tmp_path / "case" / "case.toml").read_text()
    with pytest.raises(InputError, match="an image belongs to a prior"):
        import_study(study, "1-Map", tmp_path / "b", image=image)
    far = write(tmp_path, "far.nrrd", ball_image(), affine() + np.eye(4, k=3) * 900)
    with pytest.raises(InputError, match="the prior does not lie in this image"):
        import_study(study, "1-Map", tmp_path / "c", prior=prior, image=far)
    assert not (tmp_path / "c").exists()


def test_an_image_that_does_not_say_how_it_lies_is_oriented(tmp_path: Path) -> None:
    path = spoil("no form", tmp_path)
    with pytest.raises(InputError, match="orient it first, as in 3D Slicer"):
        opened(path)
    image = nibabel.load(path)
    middle = np.eye(4)
    middle[:3, 3] = -45.0
    image.set_sform(middle, code=1)
    nibabel.save(image, tmp_path / "oriented.nii")
    assert opened(tmp_path / "oriented.nii").frame == "LPS"
    values = ball_image()
    data = write(tmp_path, "a.nrrd", values).read_bytes()
    head, body = data.split(b"\n\n", 1)
    lines = [line for line in head.splitlines() if not line.startswith(b"space")]
    (tmp_path / "b.nrrd").write_bytes(b"\n".join([*lines, b"spacings: 0.9 1.3 2.2"]) + b"\n\n" + body)
    with pytest.raises(InputError, match="orient it first, as in 3D Slicer"):
        opened(tmp_path / "b.nrrd")
    assert opened(tmp_path / "a.nrrd").frame == "LPS"


def test_a_series_is_read_once_pydicom_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    needs_pydicom("series")
    path = write(tmp_path, "series", ball_image())
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "pydicom", None)
        with pytest.raises(InputError, match=r"install pydicom, pip install 'o3dls\[dicom\]', or save it"):
            opened(path)
    assert opened(path).frame == "LPS"


def test_a_prior_without_a_frame_gets_one_and_lies_in_the_image(tmp_path: Path) -> None:
    image = write(tmp_path, "a.nrrd", ball_image())
    write_surface(tmp_path / "bare.ply", bulged_case().prior)
    with pytest.raises(InputError, match=r"o3dls convert PRIOR prior\.ply --frame LPS") as said:
        open_image(image, WALL, "unknown")
    words = str(said.value).partition("o3dls ")[2].removesuffix(" (or RAS)").split()
    places = {"PRIOR": str(tmp_path / "bare.ply"), "prior.ply": str(tmp_path / "prior.ply")}
    assert answer([places.get(word, word) for word in words]) == 0
    file = read_surface_file(tmp_path / "prior.ply")
    assert open_image(image, file.surface.vertices, file.space).frame == "LPS"


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """A few bytes are others, mostly in the header; sometimes the end is missing."""
    found = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        end = min(len(found), 700) if rng.random() < 0.7 else len(found)
        found[int(rng.integers(0, end))] = int(rng.integers(0, 256))
    return bytes(found[: int(rng.integers(1, len(found)))] if rng.random() < 0.15 else found)


@pytest.mark.parametrize("name", FORMATS)
def test_a_damaged_image_is_read_within_bounds_or_refused(name: str, tmp_path: Path) -> None:
    needs_pydicom(name)
    small = np.random.default_rng(5_113).normal(size=(24, 20, 6)).astype(np.float32)
    matrix = affine()
    matrix[:3, 3] = -matrix[:3, :3] @ np.array([12.0, 10.0, 3.0])
    places = np.random.default_rng(77_120).uniform(-3.0, 3.0, size=(40, 3))
    path = write(tmp_path, name, small, matrix)
    file = sorted(path.iterdir())[2] if name == "series" else path
    whole, rng, said = file.read_bytes(), np.random.default_rng(40_019), list[str]()
    for _ in range(120):
        file.write_bytes(damaged(whole, rng))
        try:
            found = open_image(path, places, "LPS").around(places).sample(places)
            assert found.shape == (40,)
        except InputError as error:
            said.append(str(error))
    assert len(said) > 20  # what is packed has a checksum, so that all are refused
    assert all(str(tmp_path) in one for one in said)


def test_a_case_in_the_plane_has_no_image(tmp_path: Path) -> None:
    write_case(tmp_path / "case", disc_case())
    write(tmp_path, "a.nrrd", ball_image())
    toml = tmp_path / "case" / "case.toml"
    toml.write_text(toml.read_text() + 'image = "../a.nrrd"\n')
    with pytest.raises(InputError, match="an image belongs to a prior in 3D, in mm"):
        read_case(tmp_path / "case")
