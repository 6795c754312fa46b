"""The four ways that docs/app.md fixes, by mouse: from files to a judged surface, the same as the commands
give on the case folder that the app wrote.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from o3dls.io.case_reader import read_case
from o3dls.io.surfaces import write_surface
from o3dls.resources import demo_case
from tests.app import visited
from tests.app.hand import RUN, Hand, pixels_of, ready
from tests.app.inputs import (
    AWAY,
    atrium,
    carto_zip,
    german_table,
    label_volume,
    moved_prior,
    tagged_openep,
)
from tests.app.served import Served
from tests.browser import Visit, violations
from tests.viewer import FIXTURES

_, _, launch, browser, _ = FIXTURES
app, visit = visited.FIXTURES

MOST_ACTIONS = 25
OF_DEMO = 0.25  # of a matrix: the prior of the demo is not quite in the pose of its map
# From the drop to the first picture of what was dropped: after this time people take their eyes off the page
# (Nielsen 1993 has 1 s for an unbroken thought and 10 s for attention). The server is warm, and the best of
# some drops counts, since other work on the machine is no fault of the page.
FIRST_PICTURE, TRIALS = 3.0, 5
SCRIPT = (
    (ROOT / "docs/app.md").read_text(encoding="utf-8").partition("## The script that the tests follow")[2]
)


def fused(hand: Hand, name: str) -> None:
    """From the page of a case through a run and its export to the report."""
    hand.click("[name=preset][value=quick]")
    hand.click("#fuse")
    hand.sees("#fused", "The run is done.", RUN)
    hand.click("text=Judge it")
    hand.sees("#judge", "level_set of case")
    hand.click("[data-export=ply]")
    file = f"runs/{name}-quick/export/level_set.ply"
    hand.sees("#take", file)
    assert hand.load(f"text={file}").read_bytes().startswith(b"ply")
    hand.sees("#commands", f"o3dls export runs/{name}-quick --format ply")
    assert violations(hand.visit) == []
    hand.click("text=Open the report")
    ready(hand.visit)
    assert hand.page.evaluate("origin") == "null"  # a report of others may ask the app nothing


def ended_alike(hand: Hand, app: Served, name: str) -> None:
    """The case folder gives the same surface on the command line, and the way was as short as the script has
    it.
    """
    command = ["run", "--case", f"cases/{name}", "--out", "again", "--set", "folds=0", "--quiet"]
    line = [sys.executable, "-m", "o3dls", *command]
    done = subprocess.run(line, cwd=app.folder, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stderr
    surfaces = [
        app.folder / run / "estimates/level_set/surface.ply" for run in ("again", f"runs/{name}-quick")
    ]
    assert surfaces[0].read_bytes() == surfaces[1].read_bytes()
    row = re.search(rf"^\| `{name}` \|.*\| (\d+) \|$", SCRIPT, re.MULTILINE)
    assert row is not None
    assert hand.actions == int(row[1]) <= MOST_ACTIONS


def test_carto_zip_with_a_label_volume(visit: Visit, app: Served, tmp_path: Path) -> None:
    hand, case = Hand(visit), atrium()
    hand.drop("prior", label_volume(tmp_path / "labels.nii.gz", case.prior))
    hand.sees("#prior .question", "holds 2 labels")
    assert violations(visit) == []
    hand.press("label 1")
    hand.sees("#prior .read", "ml")
    hand.drop("map", carto_zip(tmp_path, case.points.of("eam")))
    hand.sees("#map .question", "2 maps with points")
    hand.press("1-LA, 250 points")
    hand.sees("#map .read", "CARTO 3, map 1-LA")
    hand.type("#name", "carto")
    hand.click("#make")
    hand.sees("#placing", "The prior is used as it stands")
    fused(hand, "carto")
    ended_alike(hand, app, "carto")


def test_a_table_of_a_german_excel_with_an_stl(visit: Visit, app: Served, tmp_path: Path) -> None:
    hand, case = Hand(visit), atrium()
    hand.drop("prior", moved_prior(tmp_path / "vorhof.stl", case.prior))
    hand.sees("#prior .read", "42.9 ml")
    hand.drop("map", german_table(tmp_path / "punkte.csv", case.points.of("eam")))
    hand.sees("#map .question", "no column 'x'")
    assert violations(visit) == []
    hand.press("x, y, z are Länge, Breite, Höhe")
    hand.sees("#map .read", "250 eam")
    hand.type("#name", "excel")
    hand.click("#make")
    hand.sees("#placing", "Nothing says yet where the prior stands")
    ready(visit)
    assert violations(visit) == []
    mark_pairs(hand, app.folder / "cases" / "excel")
    hand.sees("#sure", "The points fit this pose with confidence 1.00")
    hand.click("#place")
    hand.sees("#placing", "pose from the case's init matrix")
    fused(hand, "excel")
    ended_alike(hand, app, "excel")


def mark_pairs(hand: Hand, folder: Path, count: int = 4) -> None:
    """Click so many pairs, of places of the prior and the points that lie there, on the side that is seen."""
    case = read_case(folder)
    state = hand.page.evaluate("JSON.parse(document.getElementById('app').textContent)")
    beside = np.array(state["beside"])
    prior, points = case.prior.vertices @ beside[:3, :3].T + beside[:3, 3], case.points.xyz
    shown = np.vstack([prior, points])
    apart = beside[:3, 3] + AWAY  # of the two, where the prior would lie on its points
    towards = np.array(hand.page.evaluate("JSON.parse(document.getElementById('panels').dataset.looksFrom)"))
    front = points[np.argsort(points @ towards)[-60:]]  # seen through nothing
    chosen = [front[0]]
    while len(chosen) < count:
        gaps = np.linalg.norm(front[:, None] - np.array(chosen)[None], axis=2).min(axis=1)
        chosen.append(front[gaps.argmax()])
    framed = hand.page.locator("#panels").get_attribute("data-tall")
    for k, place in enumerate(chosen, 1):
        if k == count:
            hand.click("[name=shown][value=beside]")  # the third pair has laid one over the other
            drawn = "tall => document.getElementById('panels').dataset.tall === tall"
            hand.page.wait_for_function(drawn, arg=framed)  # the picture is framed as at first
        hand.point(pixels_of(hand.visit, shown, place + apart))
        hand.sees("#pair-now", "Now the point of the map.")
        hand.point(pixels_of(hand.visit, shown, place))
        hand.sees("#pair-now", f"{k} pairs.")
    hand.sees("#pairs", "mm where the others alone give the pose")


def test_openep_with_tags(visit: Visit, app: Served, tmp_path: Path) -> None:
    hand, case = Hand(visit), atrium()
    write_surface(tmp_path / "prior.vtp", case.prior)
    hand.drop("prior", tmp_path / "prior.vtp")
    hand.sees("#prior .read", "42.9 ml")
    hand.drop("map", tagged_openep(tmp_path / "study.mat", case))
    hand.sees("#map .read", "LIPV, LSPV, RIPV, RSPV")
    hand.drop("landmarks", demo_case() / "prior_landmarks.csv")
    hand.sees("#landmarks .read", "LSPV, LIPV, RSPV, RIPV")
    hand.type("#name", "openep")
    hand.click("#make")
    hand.sees("#placing", "rigid fit of 4 landmarks")
    fused(hand, "openep")
    ended_alike(hand, app, "openep")


def test_a_study_without_landmarks(visit: Visit, app: Served, tmp_path: Path) -> None:
    hand, case = Hand(visit), atrium()
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    hand.drop("prior", moved_prior(tmp_path / "prior.ply", case.prior, turn))
    hand.sees("#prior .read", "42.9 ml")
    hand.drop("map", carto_zip(tmp_path, case.points.of("eam"), maps=1))
    hand.sees("#map .read", "CARTO 3, map 1-LA")
    hand.type("#name", "none")
    hand.click("#make")
    hand.sees("#placing", "Nothing says yet where the prior stands")
    ready(visit)
    hand.press("Find the pose")
    hand.sees("#sure", "The pose was found with confidence 1.00")
    hand.click("#place")
    hand.sees("#placing", "pose from the case's init matrix")
    found = read_case(app.folder / "cases" / "none").init
    assert found is not None
    assert np.abs(found[:3, :3] @ turn - np.eye(3)).max() < OF_DEMO
    fused(hand, "none")
    ended_alike(hand, app, "none")


DROPS: dict[str, Callable[[Path], Path]] = {
    "labels.nii.gz": lambda path: label_volume(path, atrium().prior),
    "vorhof.stl": lambda path: moved_prior(path, atrium().prior),
    "punkte.csv": lambda path: german_table(path, atrium().points.of("eam")),
    "study.mat": lambda path: tagged_openep(path, atrium()),
    "study.zip": lambda path: carto_zip(path.parent, atrium().points.of("eam")),
}


@pytest.mark.parametrize("name", DROPS)
def test_the_first_picture_comes_within_three_seconds(name: str, visit: Visit, tmp_path: Path) -> None:
    hand, path = Hand(visit), DROPS[name](tmp_path / name)
    role = "prior" if name in ("labels.nii.gz", "vorhof.stl") else "map"
    best = np.inf
    for _ in range(TRIALS):  # the first also warms the server
        hand.drop(role, path)
        best = min(best, hand.seconds_to_picture())
    assert best < FIRST_PICTURE
