"""The walk of docs/start.md with one's own data: from what people bring to voltages on the image.

The map of the built-in case comes as a table that a German Excel saved, as an export of EnSite Precision and
as a data set of OpenEP with tags; the commands are those of the page, and the wall is found each time.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from said import said_by
from test_readme import BLOCK, execute

from o3dls import read_case, read_points, read_surface
from o3dls.case import Points
from o3dls.evaluation.distances import distances
from o3dls.io.matlab import openep
from o3dls.io.matlab.openep_points import electric_of, rfindex_of
from o3dls.resources import demo_case

PAGE = (ROOT / "docs/start.md").read_text(encoding="utf-8")
OWN = PAGE.partition("## With your own data")[2]
DEMO = demo_case()
PARTED = {"eam": 250, "ablation": 40, "landmark": 4}
NAMES = ["LSPV", "LIPV", "RSPV", "RIPV"]
HEADINGS = (
    "Pos-X (mm)",
    "Pos-Y (mm)",
    "Pos-Z (mm)",
    "type",
    "name",
    "Bipolare Spannung",
    "LAT [ms]",
    "Größe",
)
EXCEL = {  # how it saves a table: name of the file, encoding, what parts the cells
    "CSV": ("punkte.csv", "cp1252", ";"),
    "CSV UTF-8": ("punkte.csv", "utf-8-sig", ";"),
    "UTF-16 with semicolons": ("punkte.csv", "utf-16", ";"),
    "Unicode text": ("punkte.txt", "utf-16", "\t"),
}


@cache
def measured() -> Points:
    return read_points(DEMO / "points.csv")


def german(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.10g}".replace(".", ",")


def excel(folder: Path, how: str) -> Path:
    """The points of the built-in case as a German Excel saves them, with a column that nobody knows."""
    name, encoding, comma = EXCEL[how]
    points = measured()
    rows = [comma.join(HEADINGS)]
    for k, xyz in enumerate(points.xyz):
        values = (points.numbers(column)[k] for column in ("bipolar", "lat"))
        cells = [*map(german, xyz), points.type[k], str(points.columns["name"][k]), *map(german, values)]
        rows.append(comma.join([*cells, "groß"]))
    (folder / name).write_bytes("".join(f"{row}\r\n" for row in rows).encode(encoding))
    return folder / name


def precision(folder: Path) -> Path:
    """The eam points as EnSite Precision exports them: a row for each quantity, in two files."""
    eam = measured().of("eam")
    study = folder / "study"
    study.mkdir()
    parts = np.array_split(np.arange(len(eam)), 2)
    for number, part in enumerate(parts, 1):
        some = eam.select(part)
        table = {
            "pt number": part + 1,
            "rov trace": ["HD 1-2"] * len(part),
            "ref LAT": [100.0] * len(part),
            "rov LAT": 100.0 + some.numbers("lat") / 1000.0,
            "peak2peak": some.numbers("bipolar"),
            **{f"roving {axis}": values for axis, values in zip("xyz", some.xyz.T, strict=True)},
            "utilized": [1] * len(part),
        }
        text = io.StringIO()
        text.write("St. Jude Medical. File Revision : 5.2.0\nExport Data Element : DxL\n")
        text.write(f"Total number of data points (columns):,{len(part)}\n")
        text.write(f"This is file {number} of {len(parts)} for map,LA SR\nBegin data\n")
        text.writelines(f"{name}:,{','.join(map(str, cells))}\n" for name, cells in table.items())
        text.write("Seg data len:,1.0\nrov trace:,A\n,0.1\n\nFFT spectrum\nEOF\n")
        (study / f"DxL_{number}.csv").write_text(text.getvalue())
    return study


def tagged(folder: Path) -> Path:
    """The map as a data set of OpenEP, whose tags alone say what is a landmark."""
    points = measured()
    at_wall = points.select(points.type != "ablation")
    names = np.array([str(name) for name in at_wall.columns["name"]], dtype=object)
    electric = electric_of(Points(at_wall.xyz, np.full(len(at_wall), "eam"), at_wall.columns))
    tree = {"electric": {**electric, "tags": names.reshape(-1, 1)}, **rfindex_of(points)}
    (folder / "study.mat").write_bytes(openep.save(tree))
    return folder / "study.mat"


def blocks() -> dict[str, str]:
    """What the section shows, by its first command of o3dls."""
    found = {}
    for block in BLOCK.finditer(OWN):
        command = re.search(r"^o3dls (\w+)", block["code"], re.MULTILINE)
        assert command, block["code"]
        found[command[1]] = block["code"]
    return found


def walk_table(folder: Path, how: str) -> None:
    """Make the case as the page says, with another table in place of the one that is built in."""
    code = blocks()["init"]
    assert "$demo/points.csv" in code
    execute("sh", code.replace("$demo/points.csv", str(excel(folder, how))), folder)


def check_voltages(folder: Path, run: str, points: Path) -> None:
    """The wall is near the true one, and the voltages are on the image's own surface."""
    truth = read_surface(DEMO / "truth.ply")
    off = distances(read_surface(folder / run / "estimates/level_set/surface.ply").vertices, truth).mean()
    assert off < 1.5  # mm; the prior in its right pose is off by more than 2
    code, said = said_by(
        "export", folder / run, "--on", "prior", "--format", "vtp", "--out", folder / "wall.vtp"
    )
    assert code == 0, said
    wall = read_surface(folder / "wall.vtp")
    np.testing.assert_allclose(wall.vertices, read_surface(DEMO / "prior.ply").vertices, atol=1e-4)
    given = read_points(points).of("eam").numbers("bipolar")
    there = wall.fields["bipolar"][np.isfinite(wall.fields["bipolar"])]
    assert len(there) > 0.5 * len(wall.vertices)
    assert np.nanmin(given) - 1e-6 <= there.min() < there.max() <= np.nanmax(given) + 1e-6


def run_without_folds(folder: Path, case: str) -> None:
    """Run the case as the page says, but for the cross-validation, which takes most of the time."""
    plan = folder / case / "pipeline.toml"
    text = re.sub(r"^# folds = \d+", "folds = 0", plan.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert "\nfolds = 0" in text
    plan.write_text(text, encoding="utf-8")
    execute("sh", blocks()["run"], folder)


@pytest.mark.parametrize("how", EXCEL)
def test_the_table_of_a_german_excel_makes_the_same_case(how: str, tmp_path: Path) -> None:
    code, said = said_by(
        *("init", tmp_path / "own", "--prior", DEMO / "prior.ply", "--points", excel(tmp_path, how)),
        *("--landmarks", DEMO / "prior_landmarks.csv"),
    )
    assert code == 0, said
    found = read_points(excel(tmp_path, how))
    np.testing.assert_array_equal(found.xyz, measured().xyz)
    np.testing.assert_array_equal(found.type, measured().type)
    for column in ("bipolar", "lat"):
        np.testing.assert_array_equal(found.columns[column], measured().columns[column])
    became = read_case(tmp_path / "own").columns
    assert became["Bipolare Spannung"] == "taken as bipolar"
    assert became["Größe"] == "kept as text, and not used"
    assert {kind: (found.type == kind).sum() for kind in PARTED} == PARTED
    code, said = said_by("check", tmp_path / "own/pipeline.toml")
    assert code == 0, said


@pytest.mark.parametrize("how", ["CSV", "UTF-16 with semicolons"])
def test_the_walk_leads_from_the_table_of_a_german_excel_to_voltages(how: str, tmp_path: Path) -> None:
    walk_table(tmp_path, how)
    run_without_folds(tmp_path, "own")
    check_voltages(tmp_path, "own/run", excel(tmp_path, how))


@pytest.mark.parametrize(("study", "landmarks"), [(precision, False), (tagged, True)])
def test_the_walk_leads_from_a_study_to_voltages(
    study: Callable[[Path], Path], landmarks: bool, tmp_path: Path
) -> None:
    code, said = said_by(
        *("import", study(tmp_path), tmp_path / "own", "--prior", DEMO / "prior.ply", "--units", "mm"),
        *(("--landmarks", DEMO / "prior_landmarks.csv") if landmarks else ()),
    )
    assert code == 0, said
    points = read_points(tmp_path / "own/points.csv")
    eam = measured().of("eam")
    assert (points.type == "landmark").sum() == (4 if landmarks else 0)
    assert (points.type == "ablation").sum() == (40 if landmarks else 0)
    assert all(f"took landmark {name}" in said for name in NAMES if landmarks)
    np.testing.assert_allclose(points.of("eam").xyz[: len(eam)], eam.xyz, atol=1e-9)
    np.testing.assert_allclose(points.of("eam").numbers("bipolar")[: len(eam)], eam.numbers("bipolar"))
    np.testing.assert_allclose(points.of("eam").numbers("lat")[: len(eam)], eam.numbers("lat"), atol=0.01)
    plan = tmp_path / "plan.toml"
    stages = ["landmarks"] * landmarks + ["icp", "deform", "level_set"]
    plan.write_text("folds = 0\n" + "".join(f'[[stage]]\nuse = "{stage}"\n' for stage in stages))
    code, said = said_by("run", plan, "--case", tmp_path / "own", "--out", tmp_path / "run")
    assert code == 0, said
    check_voltages(tmp_path, "run", tmp_path / "own/points.csv")


def test_the_reported_export_of_precision_is_read(shared_data: Path, tmp_path: Path) -> None:
    study = shared_data / "reports/05-ensite-dxl-precision/study"
    code, said = said_by("import", study, tmp_path / "own", "--prior", DEMO / "prior.ply", "--units", "mm")
    assert code == 0, said
    assert "90 utilised points of DxL_1.csv, DxL_2.csv" in said
