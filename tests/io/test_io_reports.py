"""Inputs of public reports, which lie outside of the repository, end as is right; each report has a test."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from said import said_by

import o3dls
from o3dls.adapters.objects import points_of
from o3dls.io.surfaces import read_surface_file

ROOT = Path(__file__).resolve().parents[1]
QUICK = ("--set", "folds=0", "--set", "level_set.spacing=3")
# report: command, with {} for its folder and {out} for a new one; exit code; what is said
COMMANDS = [
    ("03", "convert {}/missing_slice.nii.gz {out}.ply", 2, "holds 53% .* blank slices .* say --fill-slices"),
    ("03", "convert {}/missing_slice.nii.gz {out}.ply --fill-slices", 0, "faces"),
    ("03", "convert {}/every_5th.nii.gz {out}.ply", 2, "holds 21% .* blank slices .* say --fill-slices"),
    ("03", "convert {}/every_5th.nii.gz {out}.ply --fill-slices", 0, "faces"),
    ("03", "convert {}/contour.nii.gz {out}.ply", 2, "holds 46% .* it is an outline"),
    ("04", "convert {}/wall.nii.gz {out}.ply --label 2", 0, "encloses a wall 3.6 thick, .* and no chamber"),
    (
        "04",
        "run --case {}/closed_wall --out {out}",
        2,
        "encloses a wall 2.5 thick, .* and no chamber",
    ),
    ("04", "run --case {}/endo_epi --out {out}", 2, "encloses a wall 2.5 thick, .* and no chamber"),
    ("07", "convert {}/shifted.nii {out}.ply", 2, "50 mm apart; .* say --form sform or --form qform"),
    ("07", "convert {}/mirrored.nii {out}.ply", 2, "one the mirror image of the other; .* say --form sform"),
    ("07", "convert {}/mirrored.nii {out}.ply --form qform", 0, "frame LPS"),
    ("17", "convert {}/soup.stl {out}.ply", 0, "are welded\n.*162 vertices, 320 faces"),
    ("17", "convert {}/soup.stl {out}.ply --cap", 0, "are welded\n.*162 vertices, 320 faces"),
    ("17", "init {out} --prior {}/soup.stl --points {}/points.csv", 0, "to run it"),
    (
        "20",
        "run --case {}/case --out {out}",
        2,
        "is 2 times as large as the map, .* leave the names",
    ),
    ("21", "convert {}/statismo.json {out}.mrk.json --frame LPS", 0, "mrk.json"),
    ("21", "convert {}/noheader.csv {out}.mrk.json --frame LPS", 0, "mrk.json"),
    (
        "23",
        "init {out} --prior {}/says_um.nii --points {}/points.csv",
        2,
        "units are mm, say --units mm",
    ),
    ("23", "init {out} --prior {}/says_um.nii --points {}/points.csv --units mm", 0, "to run it"),
    (
        "25",
        "import {}/study {out}",
        0,
        "took 2 ablation points, by their tags\n.* tagged EOS, which are",
    ),
    ("23", "convert {}/says_um.nii {out}.ply --units mm", 0, "--units mm overrules that"),
]
ELSEWHERE = {
    "01": "io/test_io_values.py::test_the_reported_case",
    "02": "io/test_io_belonging.py::test_the_reported_study",
    "05": "io/test_io_ensite_rows.py::test_the_reported_export_of_precision_is_read",
    "09": "io/test_io_study_parts.py::test_the_reported_studies_give_their_points",
    "11": "io/test_io_points.py::test_the_reported_points_are_read",
    "12": "io/test_io_study_parts.py::test_the_reported_studies_give_their_points",
    "15": "io/test_io_study_parts.py::test_the_reported_studies_give_their_points",
    "08": "io/test_io_reports.py::test_names_of_another_language_are_paired_as_they_are_meant",
    "13": "io/test_io_reports.py::test_tags_of_openep_are_what_they_mean",
    "16": "io/test_io_reports.py::test_what_is_masked_in_memory_is_no_point",
}


def of(reports: Path, number: str) -> Path:
    (found,) = reports.glob(f"{number}-*")
    return found


@pytest.fixture
def reports(shared_data: Path) -> Path:
    return shared_data / "reports"


def test_every_report_has_a_test(reports: Path) -> None:
    numbers = {path.name[:2] for path in reports.iterdir()}
    assert numbers == {number for number, *_ in COMMANDS} | ELSEWHERE.keys()
    for test in ELSEWHERE.values():
        file, _, function = test.partition("::")
        assert f"def {function}(" in (ROOT / file).read_text(encoding="utf-8"), test


@pytest.mark.parametrize(("number", "command", "code", "sentence"), COMMANDS)
def test_the_reported_command_ends_as_is_right(
    number: str, command: str, code: int, sentence: str, reports: Path, tmp_path: Path
) -> None:
    words = command.replace("{out}", str(tmp_path / "out")).replace("{}", str(of(reports, number))).split()
    found, said = said_by(*words, *(QUICK if words[0] == "run" else ()))
    assert found == code, said
    assert re.search(sentence, said), said


def test_slices_that_were_missing_are_there(reports: Path, tmp_path: Path) -> None:
    said_by("convert", of(reports, "03") / "missing_slice.nii.gz", tmp_path / "a.ply", "--fill-slices")
    surface = read_surface_file(tmp_path / "a.ply").surface
    assert surface.watertight
    assert surface.volume > 0.9 * np.prod(np.ptp(surface.vertices, axis=0)) * np.pi / 6


def test_names_of_another_language_are_paired_as_they_are_meant(reports: Path) -> None:
    case = o3dls.read_case(of(reports, "08") / "case")
    names = case.points.columns["name"]
    found = {names[row]: partner for row, partner in case.landmark_partners().items()}
    meant = {"LOPV": "LSPV", "LUPV": "LIPV", "ROPV": "RSPV", "RUPV": "RIPV"}
    meant |= {"LAA": "LAA", "MA": "MA"}
    assert found == {name: meant[name] for name in names if name}


def test_tags_of_openep_are_what_they_mean(reports: Path, tmp_path: Path) -> None:
    folder = of(reports, "13")
    code, said = said_by("import", folder / "tags.mat", tmp_path / "case", "--prior", folder / "prior.ply")
    assert code == 0, said
    points = o3dls.read_points(tmp_path / "case/points.csv")
    assert sorted(points.of("landmark").columns["name"]) == ["LIPV", "LSPV", "RIPV", "RSPV"]
    assert (points.of("ablation").columns["tags"] == "Ablation").all()
    assert "Ablation" not in points.of("eam").columns["tags"]


def test_what_is_masked_in_memory_is_no_point() -> None:
    masked = np.ma.masked_values(np.array([[1.0, 2, 3], [4, 5, 6], [-9999, -9999, -9999]]), -9999)
    assert points_of(masked).xyz.tolist() == [[1, 2, 3], [4, 5, 6]]
    rows = np.array([(1.0, 2.0, 3.0)], dtype=[("x", "f8"), ("y", "f8"), ("z", "f8")])
    assert points_of(rows).xyz.tolist() == [[1, 2, 3]]
