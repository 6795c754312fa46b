"""A JSON file beside a volume that contradicts it is named, and an option decides."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from said import said_by

import o3dls
from o3dls.io.images.volumes import write_volume
from o3dls.io.surfaces import read_surface_file

AT = (np.indices((40, 40, 30)).T - [19.5, 19.5, 14.5]) * [1.0, 1.0, 2.0]
BALL = (AT**2).sum(axis=3).T < 15.0**2  # slices last, 2 mm apart
ROUNDED = 0.03  # share of its size: more slices are drawn between those that lie farther apart
RIGHT = {
    "SliceThickness": 2.5,
    "SpacingBetweenSlices": 2,
    "PixelSpacing": [1, 1],
    "ImageOrientationPatientDICOM": [1, 0, 0, 0, -1, 0],
    "units": "mm",
    "EchoTime": 0.002,
}


def volume(path: Path, sidecar: Any = None) -> Path:
    write_volume(path, BALL.astype(np.uint8), np.diag([1.0, 1.0, 2.0, 1.0]), space="LPS")
    if sidecar is not None:
        beside = path.with_name(path.name.split(".")[0] + ".json")
        beside.write_text(sidecar if type(sidecar) is str else json.dumps(sidecar))
    return path


def points(path: Path, scale: Any = 1.0) -> Path:
    ways = np.random.default_rng(90_117).normal(size=(60, 3))
    xyz = scale * ([19.5, 19.5, 29.0] + 15.0 * ways / np.linalg.norm(ways, axis=1)[:, None])
    path.write_text("# units=mm\nx,y,z\n" + "".join(f"{x},{y},{z}\n" for x, y, z in xyz))
    return path


FAULTS = {
    "slices": ({"SpacingBetweenSlices": 3.0}, "slices 3 mm apart, the volume 2 mm apart", [1, 1, 1.5]),
    "slices, in the plane": (
        {"SpacingBetweenSlices": 1.0, "ImageOrientationPatientDICOM": [1, 0, 0, 0, 1, 0]},
        "slices 1 mm apart, the volume 2 mm apart",
        [1, 1, 0.5],
    ),
    "thickness": ({"SliceThickness": 8}, "slices 8 mm thick, the volume 2 mm apart", [1, 1, 4]),
    "pixels": ({"PixelSpacing": [1.5, 1.2]}, "pixels of 1.2 x 1.5 mm, the volume 1 x 1 mm", [1.2, 1.5, 1]),
    "units": ({"units": "cm"}, "states units cm, the volume mm", [10, 10, 10]),
}


@pytest.mark.parametrize("name", ["la.nii", "la.nii.gz", "la.nrrd"])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_sidecar_that_contradicts_is_asked_about_at_every_door(
    fault: str, name: str, tmp_path: Path
) -> None:
    stated, sentence, factors = FAULTS[fault]
    path = volume(tmp_path / name, stated)
    known = read_surface_file(volume(tmp_path / f"known.{name.partition('.')[2]}")).surface
    for decided, scale in (("ignore", np.ones(3)), ("take", np.array(factors))):
        table = points(tmp_path / f"{decided}.csv", scale)
        doors: tuple[tuple[Any, ...], ...] = (
            ("init", tmp_path / decided, "--prior", path, "--points", table),
            ("convert", path, tmp_path / f"{decided}.ply"),
        )
        for door in doors[name != "la.nii" :]:  # a case takes two seconds
            code, said = said_by(*door)
            assert code == 2, said
            assert sentence in said
            assert f"--sidecar {decided} where" in said
            code, said = said_by(*door, "--sidecar", decided)
            assert code == 0, (door, said)
        files = [o3dls.read_surface(tmp_path / f"{decided}.ply")]
        cases = [o3dls.read_case(tmp_path / decided).prior] if name == "la.nii" else []
        for found in (*files, *cases):
            np.testing.assert_allclose(
                np.ptp(found.vertices, axis=0), scale * np.ptp(known.vertices, axis=0), rtol=ROUNDED
            )
    assert "the sidecar is taken" in read_surface_file(path, sidecar="take").notes[0]
    assert "it is ignored" in read_surface_file(path, sidecar="ignore").notes[0]


def test_units_of_a_sidecar_scale_the_origin_too(tmp_path: Path) -> None:
    path = volume(tmp_path / "la.nii", {"units": "cm"})
    vertices = read_surface_file(path, sidecar="take").surface.vertices
    np.testing.assert_allclose(vertices, 10.0 * read_surface_file(path, sidecar="ignore").surface.vertices)


def test_an_orientation_that_contradicts_is_not_taken(tmp_path: Path) -> None:
    """Neither flips nor the order of axes can be told from it."""
    leaning = np.cos(np.pi / 6), np.sin(np.pi / 6)
    stated = {"ImageOrientationPatientDICOM": [leaning[0], 0, leaning[1], 0, 1, 0]}
    path = volume(tmp_path / "la.nii.gz", stated)
    for options in ((), ("--sidecar", "take")):
        code, said = said_by("convert", path, tmp_path / "la.ply", *options)
        assert code == 2
        assert "30 degrees off the axes of the volume: one is of another image; say --sidecar ignore" in said
    code, said = said_by("convert", path, tmp_path / "la.ply", "--sidecar", "ignore")
    assert code == 0, said


@pytest.mark.parametrize(
    "stated",
    [
        RIGHT,
        {"SliceThickness": 0.7},  # a gap
        {"SliceThickness": 5.0},  # an overlap
        {"SpacingBetweenSlices": 1.0},  # of axes in another order, which only an orientation can tell
        {"SpacingBetweenSlices": 0, "SliceThickness": "5", "PixelSpacing": 3, "units": "Hz"},
        {"ImageOrientationPatientDICOM": [0, 0, 1, 0, 1, 0], "SpacingBetweenSlices": 1.0},  # sagittal slices
        [1, 2],
        "no JSON",
    ],
)
def test_a_sidecar_that_agrees_says_nothing(stated: Any, tmp_path: Path) -> None:
    path = volume(tmp_path / "prior.nii.gz", stated)
    assert read_surface_file(path).notes == ()
    points(tmp_path / "points.csv")
    (tmp_path / "case.toml").write_text('frame = "LPS"\n')
    assert o3dls.read_case(tmp_path).prior.watertight  # where prior.json is no second prior


def test_a_decision_on_no_sidecar_is_refused(tmp_path: Path) -> None:
    code, said = said_by("convert", volume(tmp_path / "la.nii"), tmp_path / "la.ply", "--sidecar", "take")
    assert code == 2
    assert "no JSON sidecar la.json is beside it: omit --sidecar" in said
