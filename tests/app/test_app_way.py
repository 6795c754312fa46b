"""The whole way by mouse: from two files to a judged surface, the same as the commands give."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from o3dls.io.surfaces import read_surface, write_surface
from o3dls.resources import demo_case
from tests.app.served import Served, served
from tests.browser import Visit, violations
from tests.viewer import FIXTURES

_, _, launch, browser, _ = FIXTURES

READ = 30_000  # ms
RUN = 500_000  # ms, of a whole run on cores that others use too


@pytest.fixture
def app(tmp_path: Path) -> Iterator[Served]:
    with served(tmp_path / "work") as made:
        yield made


@pytest.fixture
def visit(browser: Any, app: Served) -> Iterator[Visit]:
    opened = Visit(browser, app.server.url, wait=False)
    yield opened
    assert [text for text in opened.errors if "willReadFrequently" not in text] == []  # said of these tests
    own = f"http://{app.host}/"
    assert [url for url in opened.requests if not url.startswith((own, "blob:", "data:"))] == []
    opened.page.close()


def says(visit: Visit, selector: str, text: str, patience: int = READ) -> None:
    """Wait until an element says a text."""
    visit.page.locator(selector, has_text=re.compile(re.escape(text))).first.wait_for(timeout=patience)


def command(folder: Path, *arguments: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "o3dls", *arguments], cwd=folder, capture_output=True, text=True, timeout=500
    )
    assert done.returncode == 0, done.stderr


def final_surface(run: Path) -> bytes:
    found = list(run.glob("estimates/level_set/surface.ply"))
    assert len(found) == 1
    return found[0].read_bytes()


def test_the_way_from_a_table_and_an_stl_to_a_judged_surface(visit: Visit, app: Served, tmp_path: Path) -> None:
    page = visit.page
    write_surface(tmp_path / "atrium.stl", read_surface(demo_case() / "prior.ply"))
    says(visit, "#there", "There is no case here yet.")
    page.set_input_files("#prior-file", tmp_path / "atrium.stl")
    says(visit, "#prior .read", "42.9 ml")
    assert page.locator("#prior .read img").evaluate("one => one.naturalWidth") > 0
    page.set_input_files("#map-file", demo_case() / "points.csv")
    says(visit, "#map .read", "250 eam, 40 ablation, 4 landmark")
    page.set_input_files("#landmarks-file", demo_case() / "prior_landmarks.csv")
    says(visit, "#landmarks .read", "LSPV, LIPV, RSPV, RIPV")
    page.fill("#name", "first")
    assert violations(visit) == []
    page.click("#make")
    says(visit, "#placing", "rigid fit of 4 landmarks", patience=READ)
    page.wait_for_function("() => document.documentElement.dataset.ready !== undefined", timeout=READ)
    page.check("[name=preset][value=quick]")
    page.click("#fuse")
    says(visit, "#fused", "The run is done.", patience=RUN)
    assert violations(visit) == []
    page.click("text=Judge it")
    says(visit, "#judge", "case first")
    page.click("[data-export=ply]")
    says(visit, "#take", "runs/first-quick/export/level_set.ply")
    with page.expect_download() as loaded:
        page.click("text=runs/first-quick/export/level_set.ply")
    assert Path(loaded.value.path()).read_bytes().startswith(b"ply")
    says(visit, "#commands", "o3dls export runs/first-quick --format ply")
    assert violations(visit) == []
    page.click("text=Open the report")
    page.wait_for_function("() => document.documentElement.dataset.ready !== undefined", timeout=READ)
    assert page.locator("h1").inner_text() == "first"
    # the case folder that was made is one of the command line, and gives the same surface there
    command(app.folder, "run", "--case", "cases/first", "--out", "again", "--set", "folds=0", "--quiet")
    assert final_surface(app.folder / "again") == final_surface(app.folder / "runs" / "first-quick")
