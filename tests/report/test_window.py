"""The window: what each key shows, and a sentence where there is no display."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from o3dls.errors import InputError
from o3dls.report.subject import read_subject
from o3dls.report.window import Stand, view
from tests.finished import finished, finished_2d

WINDOW = """
import logging, sys
import open3d as o3d
from o3dls import view
logging.basicConfig(level=logging.INFO, format="%(message)s")
kind = o3d.visualization.VisualizerWithKeyCallback
def once(window):
    window.poll_events()
    window.update_renderer()
    window.capture_screen_image(sys.argv[2], True)
kind.run = once
view.view(sys.argv[1])
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("view") / "run")


@pytest.fixture(scope="module")
def stand(run: Path) -> Stand:
    return Stand(read_subject([run]))


def test_keys_choose_estimates_and_fields(stand: Stand) -> None:
    keys = stand.keys()
    assert stand.caption(stand.first).startswith("level_set: distance to truth")
    assert stand.caption(keys["1"](stand.first)).startswith("start: distance to truth")
    seen = []
    choice = stand.first
    for _ in range(len(stand.fields) + 1):
        choice = keys["F"](choice)
        seen.append(stand.caption(choice))
    assert len(set(seen)) == len(stand.fields) + 1
    assert choice == stand.first


def test_each_switch_adds_or_takes_one_geometry(stand: Stand) -> None:
    keys = stand.keys()
    base = len(stand.geometries(stand.first))
    counts = {key: len(stand.geometries(keys[key](stand.first))) - base for key in "PGT"}
    assert counts == {"P": -1, "G": 1, "T": 1}


def test_surface_is_that_of_the_estimate(stand: Stand, run: Path) -> None:
    mesh = stand.geometries(stand.keys()["2"](stand.first))[0]
    np.testing.assert_allclose(
        np.asarray(mesh.vertices), stand.subject.results["icp"].estimate.surface.vertices
    )
    assert len(mesh.vertex_colors) == len(mesh.vertices)


def test_no_display_is_said(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(InputError, match="no display here for a window; look at the page that o3dls report"):
        view(run)


def test_two_dimensions_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a run in 2D"):
        view(finished_2d(tmp_path / "run"))


def test_window_opens_and_draws(run: Path, tmp_path: Path) -> None:
    server = shutil.which("xvfb-run")
    if server is None:
        pytest.skip("no xvfb-run: a window needs a screen")
    picture = tmp_path / "window.png"
    command = [server, "-a", sys.executable, "-c", WINDOW, str(run), str(picture)]
    software = {**os.environ, "LIBGL_ALWAYS_SOFTWARE": "1"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=software, check=False)
    assert done.returncode == 0, done.stderr
    assert "level_set: distance to truth" in done.stderr
    from matplotlib.image import imread

    assert imread(picture).std() > 0.05
