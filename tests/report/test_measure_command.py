"""`o3dls measure`: the numbers of a run on the terminal, as JSON and as a table, or why there are none."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from o3dls import Case, Deform, Pipeline, read_run
from o3dls.cli.commands import cli
from o3dls.io.surfaces import write_surface
from o3dls.io.table import read_table
from o3dls.report.mapping.measures import measured_section
from o3dls.report.subject import read_subject
from tests.chamber import chamber, measured
from tests.finished import finished, finished_2d

SIX_DIGITS = 1e-4  # relative: what a folder keeps of a surface


def stretched() -> Case:
    """A chamber that was stretched since it was imaged, with low voltages at its enhanced back."""
    case = measured(chamber(20), np.diag([1.0, 1.15, 0.95, 1.0]), 80, noise=1.0)
    voltage = np.where(case.points.xyz[:, 1] > 0.0, 0.3, 2.0)
    points = replace(case.points, columns={**case.points.columns, "bipolar": voltage})
    ratio = 1.1 + 0.3 * np.tanh(case.prior.vertices[:, 1] / 10.0)
    return replace(case, points=points, frame="LPS", prior=replace(case.prior, fields={"image_ratio": ratio}))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = Pipeline([Deform()], folds=0).run(stretched())
    return run.write(tmp_path_factory.mktemp("runs") / "run")


def said(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["measure", *map(str, arguments)])


def test_json_table_and_terminal_have_the_same_numbers(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "numbers.csv"
    done = said(folder, "--samples", 30, "--json", "--out", out)
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    records = found["measures"]
    table = read_table(out, ("what", "where", "unit"))
    assert list(table.columns["what"]) == [one["what"] for one in records]
    assert table.numbers("naive") == pytest.approx([one["naive"] for one in records])
    text = said(folder, "--samples", 30).stdout
    assert all(one["what"] in text and one["where"] in text for one in records)
    volume = records[0]
    assert f"{volume['low']:.1f}" in text
    assert f"{volume['high']:.1f}" in text
    assert "not a measurement for a patient's record" in text


def test_the_numbers_are_those_of_the_surface(folder: Path) -> None:
    surface = read_run(folder).estimates["deform"].surface
    records = json.loads(said(folder, "--samples", 30, "--json").stdout)["measures"]
    found = {(one["what"], one["where"]): one for one in records}
    assert found["volume", "wall"]["naive"] == pytest.approx(surface.volume / 1000.0, rel=SIX_DIGITS)
    assert found["area", "wall"]["naive"] == pytest.approx(surface.area / 100.0, rel=SIX_DIGITS)
    # half of the points have 0.3 mV
    assert 30.0 < found["share below 0.5 mV", "wall"]["naive"] < 70.0
    assert found["share below 1.5 mV", "wall"]["naive"] > found["share below 0.5 mV", "wall"]["naive"]
    assert found["distance", "LSPV to LIPV"]["low"] < found["distance", "LSPV to LIPV"]["high"]
    assert any(what == "section diameter" for what, _ in found)
    assert any(where == "posterior" for _, where in found)  # of a frame and landmarks that are known
    below = json.loads(said(folder, "--samples", 30, "--json", "--below", 1.0).stdout)["measures"]
    assert {one["what"] for one in below if "below" in one["what"]} == {"area below 1 mV", "share below 1 mV"}


def test_a_seed_gives_equal_intervals_and_another_others(folder: Path) -> None:
    first, again, other = (said(folder, "--samples", 30, "--seed", seed).stdout for seed in (5, 5, 6))
    assert first == again
    assert first != other


def test_what_cannot_be_measured_is_refused(folder: Path, tmp_path: Path) -> None:
    flat, without = finished_2d(tmp_path / "flat"), finished(tmp_path / "without")
    refused = {
        (flat,): "must be in 3D and mm",
        (without,): "no posterior in space; run a pipeline with the stage 'deform' again",
        (folder, "--column", "unipolr", "--below", "1"): "no column 'unipolr': did you mean 'unipolar'?",
        (folder, "--column", "lat", "--below", "1"): "its points have no column 'lat'",
        (folder, "--out", folder / "scores.csv"): "belongs to the run",
        (
            folder,
            "--against",
            "image_rtio",
        ): "its wall has no field 'image_rtio': did you mean 'image_ratio'?",
        (folder, "--lesions", write_lesions(tmp_path, "x,y,z\n900,0,0\n")): "lesion '1' lies",
        (
            folder,
            "--lesions",
            write_lesions(tmp_path, "x,y,z,name\n1,2,3,a\n4,5,6,a\n"),
        ): "'a' is there twice",
        (folder, "--lesions", write_lesions(tmp_path, "x,y,z,sigma\n1,2,3,-1\n")): "sigma",
    }
    for arguments, why in refused.items():
        done = said(*arguments)
        assert done.exit_code != 0
        assert why in str(done.exception)


def write_lesions(folder: Path, text: str) -> Path:
    path = folder / f"lesions_{len(list(folder.iterdir()))}.csv"
    path.write_text(text)
    return path


def records(folder: Path, *arguments: object) -> dict[tuple[str, str], dict[str, float]]:
    done = said(folder, "--samples", 30, "--json", *arguments)
    assert done.exit_code == 0, done.output
    return {(one["what"], one["where"]): one for one in json.loads(done.stdout)["measures"]}


def test_voltages_fall_with_the_enhancement(folder: Path) -> None:
    """Half of the wall has 0.3 mV and half 2 mV; the line passes 0.5 mV on the side that is enhanced."""
    found = records(folder)
    slope = found["slope of ln bipolar over image_ratio", "points"]
    assert slope["low"] < slope["mean"] < slope["high"] < 0.0
    assert slope["naive"] < 0.0
    crossed = found["image_ratio at 0.5 mV", "points"]
    assert 1.1 < crossed["low"] < crossed["mean"] < crossed["high"]
    assert not any("over" in what for what, _ in records(folder, "--column", "unipolar"))


def test_an_image_that_was_brought_onto_the_wall_is_compared_with(folder: Path, tmp_path: Path) -> None:
    """What `o3dls wall` has written is a field of the wall too."""
    copy = tmp_path / "run"
    shutil.copytree(folder, copy)
    surface = read_run(copy).estimates["deform"].surface
    (copy / "wall").mkdir()
    seen = replace(surface, fields={"image_value": 300.0 + surface.vertices[:, 1]})
    write_surface(copy / "wall" / "result.vtp", seen)
    found = records(copy, "--against", "image_value")
    assert found["slope of ln bipolar over image_value", "points"]["high"] < 0.0


def test_lesions_have_gaps_and_distances_to_scars(folder: Path, tmp_path: Path) -> None:
    surface = read_run(folder).estimates["deform"].surface
    front, back = (
        surface.vertices[int(k)] for k in (surface.vertices[:, 1].argmin(), surface.vertices[:, 1].argmax())
    )
    rows = [("front", front), ("back", back), ("beside", back + np.array([0.0, 0.0, 4.0]))]
    text = "x,y,z,name,line\n" + "".join(f"{x},{y},{z},{name},roof\n" for name, (x, y, z) in rows)
    path = write_lesions(tmp_path, text)
    found = records(folder, "--lesions", path)
    assert found["gap", "front to back"]["naive"] == pytest.approx(np.linalg.norm(front - back), abs=0.1)
    gap = found["largest gap", "roof"]
    assert gap["low"] < np.linalg.norm(front - back) < gap["high"]
    assert found["distance to bipolar below 0.5 mV", "back"]["naive"] == 0.0
    assert found["distance to bipolar below 0.5 mV", "front"]["low"] > 10.0
    assert found["distance to image_ratio from 1.2 on", "front"]["low"] > 10.0
    nearer = records(folder, "--lesions", path, "--scar-from", 0.9)
    name = "distance to image_ratio from 0.9 on", "front"
    assert nearer[name]["naive"] < found["distance to image_ratio from 1.2 on", "front"]["naive"]


def test_of_a_table_of_points_those_of_ablation_are_the_lesions(folder: Path, tmp_path: Path) -> None:
    at = read_run(folder).estimates["deform"].surface.vertices[:3]
    kinds = ("eam", "ablation", "ablation")
    text = "x,y,z,type\n" + "".join(f"{x},{y},{z},{k}\n" for (x, y, z), k in zip(at, kinds, strict=True))
    found = records(folder, "--lesions", write_lesions(tmp_path, text))
    assert {where for what, where in found if what == "gap"} == {"1 to 2"}


def test_the_report_has_the_numbers_of_the_whole_wall(folder: Path) -> None:
    done = said(folder, "--json")
    found = {(one["what"], one["where"]): one for one in json.loads(done.stdout)["measures"]}
    section = measured_section(read_subject([folder]))
    assert section is not None
    rows = dict(re.findall(r'<th scope="row">([^<]+)</th>(.*?)</tr>', section.body))
    for what, where in (
        ("volume", "wall"),
        ("share below 0.5 mV", "wall"),
        ("image_ratio at 0.5 mV", "points"),
    ):
        cells = re.findall("<td>([^<]*)</td>", rows[what])
        one = found[what, where]
        wanted = [one["naive"], one["mean"], *map(one.get, ("low", "high"))]
        shown = [*cells[1:3], *cells[3].split(" to ")]
        assert [float(cell) for cell in shown] == pytest.approx(wanted, rel=0.05, abs=0.01)
    assert any(name.startswith("section diameter, ") for name in rows)
    assert not any("posterior" in name for name in rows)


def test_a_run_without_a_posterior_has_no_such_section(tmp_path: Path) -> None:
    assert measured_section(read_subject([finished(tmp_path / "without")])) is None
    assert measured_section(read_subject([finished_2d(tmp_path / "flat")])) is None
