"""docs/tutorial_carto.md is run as it stands, and prints what the page shows: from an export of CARTO 3 and a
late enhancement image to values on the wall, a carried oesophagus, and a scene.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from conftest import ROOT
from test_readme import BLOCK

from o3dls import read_surface
from o3dls.evaluation.distances import distances
from o3dls.io.table import read_table

PAGE = (ROOT / "docs/tutorial_carto.md").read_text(encoding="utf-8")
NUMBER = re.compile(r"\d+(?:\.\d+)?")
LAST_DIGIT, SHARE = 0.06, 0.1  # by which a number may differ on another machine
FARTHER = 1.0  # mm: by how much the oesophagus may come to be nearer to the wall, or farther from it


class Done(NamedTuple):
    """This is the folder in which the page was run, and pairs of what it shows and what was printed."""

    folder: Path
    shown: list[tuple[str, str]]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Done:
    folder = tmp_path_factory.mktemp("carto")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    env = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)}
    shown, printed = [], ""
    for block in BLOCK.finditer(PAGE):
        if block["language"] == "text":
            shown.append((block["code"], printed))
            continue
        run = subprocess.run(
            ["sh", "-eu", "-c", block["code"]],
            cwd=folder,
            env=env,
            capture_output=True,
            text=True,
            check=False,
        )
        printed = run.stderr + run.stdout
        assert run.returncode == 0, block["code"] + printed
    return Done(folder, shown)


def agrees(line: str, printed: str) -> bool:
    """Whether a printed line begins with what the page shows, but for last digits."""
    words, numbers = (NUMBER.split(line), NUMBER.findall(line))
    found = NUMBER.findall(printed)[: len(numbers)]
    beginning = NUMBER.split(printed)[: len(words)]
    same = beginning[:-1] == words[:-1] and beginning[-1].startswith(words[-1])
    return same and [float(x) for x in found] == pytest.approx(
        [float(x) for x in numbers], rel=SHARE, abs=LAST_DIGIT
    )


def test_a_line_of_another_version_is_noticed() -> None:
    assert agrees("icp: 10 of 440 pairs, rms 1.48 mm", "icp: 10 of 440 pairs, rms 1.47 mm (0.2 s)")
    assert not agrees("icp: 10 of 440 pairs, rms 1.48 mm", "icp: 10 of 440 pairs, rms 2.48 mm (0.2 s)")
    assert not agrees("icp: 10 of 440 pairs", "icp: 10 of 440 points")
    assert not agrees("took landmark LIPV", "took landmark")


def test_every_block_is_a_command_or_what_it_prints() -> None:
    blocks = list(BLOCK.finditer(PAGE))
    assert len(blocks) == PAGE.count("\n```") // 2
    assert {block["language"] for block in blocks} == {"sh", "text"}
    assert not any(block["spared"] for block in blocks)
    typed = "".join(block["code"] for block in blocks if block["language"] == "sh").replace("\\\n", "")
    commands = [line.split()[1] for line in typed.splitlines()]
    assert commands == ["-m", "import", "run", "slices", "wall", "carry", "export", "export"]


def test_the_page_shows_what_is_printed(done: Done) -> None:
    assert len(done.shown) == 5
    for shown, printed in done.shown:
        rest = iter(printed.splitlines())
        for line in shown.splitlines():
            assert any(agrees(line, found) for found in rest), f"{line}\n{printed}"


def test_the_page_says_what_its_pictures_are_drawn_with(done: Done) -> None:
    pytest.importorskip("vtk", reason="vtk is not installed")
    from tools.carto_pictures import said

    lines = said(done.folder).splitlines()
    landmarks, icp, result = (float(line.split()[-2]) for line in lines[:3])
    told = re.search(r"from (\S+) mm for the landmarks\s+and (\S+) mm for ICP\s+to (\S+) mm", PAGE)
    assert told is not None
    assert [float(x) for x in told.groups()] == pytest.approx([landmarks, icp, result], abs=0.1)
    assert result < 0.5 * icp < 0.5 * landmarks
    enhanced, other = (re.search(r": (\d+) points, median (\S+) mV", line) for line in lines[3:])
    said_of = re.search(
        r"(\d+) points\s+lie\s+on\s+enhanced\s+wall\s+\(above 1.4\),\s+and\s+their\s+median\s+is\s+(\S+) mV;"
        r"\s+it\s+is\s+(\S+) mV\s+for\s+the\s+others",
        PAGE,
    )
    assert enhanced is not None
    assert other is not None
    assert said_of is not None
    count, low, high = (float(x) for x in said_of.groups())
    assert [count, low, high] == pytest.approx(
        [float(enhanced[1]), float(enhanced[2]), float(other[2])], rel=0.2
    )
    assert low < 0.5 < 1.5 < high


def test_values_of_the_image_lie_beside_the_voltages(done: Done) -> None:
    result = read_surface(done.folder / "run/wall/result.vtp")
    ratio, bipolar, area = result.fields["image_ratio"], result.fields["bipolar"], result.vertex_areas
    known = np.isfinite(ratio) & np.isfinite(bipolar)
    low, enhanced = (area * (known & some) for some in (bipolar < 1.0, ratio > 1.4))
    both = (area * (known & (bipolar < 1.0) & (ratio > 1.4))).sum()
    assert both > 0.6 * low.sum()  # of an area in which one wall in seven is enhanced
    assert both > 0.6 * enhanced.sum()
    assert 0.05 < enhanced.sum() / area.sum() < 0.25
    rows = read_table(done.folder / "run/wall/points.csv", "xyz")
    assert len(rows.columns["x"]) == 440
    assert len(list((done.folder / "run/slices").glob("*.png"))) == 36


def test_the_oesophagus_is_carried_beside_the_wall(done: Done) -> None:
    before, after = (
        read_surface(done.folder / name)
        for name in ("study/oesophagus.stl", "run/export/oesophagus_on_map.vtp")
    )
    prior, result = (
        read_surface(done.folder / name) for name in ("case/prior.ply", "run/estimates/level_set/surface.ply")
    )
    known = after.fields["motion_known"] == 1.0
    assert 0.1 < known.mean() < 0.9
    gaps = distances(before.vertices, prior)[known], distances(after.vertices, result)[known]
    assert np.abs(gaps[1] - gaps[0]).max() < FARTHER + 0.1 * gaps[0].max()
    assert np.linalg.norm(after.vertices - before.vertices, axis=1).min() > 10.0  # of another frame


def test_the_scene_and_the_motion_are_whole(done: Done) -> None:
    with zipfile.ZipFile(done.folder / "run/export/level_set.mrb") as bundle:
        names = {Path(name).name for name in bundle.namelist()}
    assert {"image.nrrd", "prior.vtp", "result.vtp", "points.vtp", "bend_onto_image.nrrd"} <= names
    marks = {name for name in names if name.endswith(".mrk.json")}
    assert marks == {
        *("points_as_markups.mrk.json", "ablation_sites.mrk.json"),
        *("landmarks_of_the_map.mrk.json", "landmarks_of_the_prior.mrk.json"),
    }
    assert (done.folder / "motion.tfm").is_file()
    assert (done.folder / "motion_field.nrrd").is_file()
    facts = (done.folder / "run/export/level_set.mrb.json").read_text(encoding="utf-8")
    assert "case" not in facts  # whose name may be a patient's


@pytest.mark.parametrize("picture", sorted(re.findall(r"\((tutorial_carto_\w+\.png)\)", PAGE)))
def test_pictures_are_small(picture: str) -> None:
    assert 20_000 < (ROOT / "docs" / picture).stat().st_size < 200_000
