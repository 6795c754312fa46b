"""The window: what each key shows, and a sentence where there is no display."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from o3dls.errors import InputError
from o3dls.report.drawing.colour_maps import colour_table
from o3dls.report.drawing.fields import point_field, shown_fields
from o3dls.report.drawing.labels import Sheet
from o3dls.report.subject import read_subject
from o3dls.report.window import Stand, open_window
from tests.finished import finished, finished_2d

WINDOW = """
import logging, sys
import open3d as o3d
from o3dls.report.window import open_window
logging.basicConfig(level=logging.INFO, format="%(message)s")
kind = o3d.visualization.VisualizerWithKeyCallback
def once(window):
    window.poll_events()
    window.update_renderer()
    window.capture_screen_image(sys.argv[2], True)
kind.run = once
open_window(sys.argv[1])
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("view") / "run")


@pytest.fixture(scope="module")
def stand(run: Path) -> Stand:
    return Stand(read_subject([run]))


def test_keys_choose_estimates_and_fields(stand: Stand) -> None:
    keys = stand.keys()
    assert stand.caption(stand.first).startswith("level_set, AP: distance to truth")
    assert stand.caption(keys["1"](stand.first)).startswith("start, AP: distance to truth")
    seen = []
    choice = stand.first
    for _ in range(len(stand.fields) + 1):
        choice = keys["F"](choice)
        seen.append(stand.caption(choice))
    assert len(set(seen)) == len(stand.fields) + 1
    assert choice == stand.first


def test_each_switch_adds_or_takes_what_it_says(stand: Stand) -> None:
    """Edges come with a line that names them; points go with their colour bar and its two lines."""
    keys = stand.keys()
    base = len(stand.geometries(stand.first))
    counts = {key: len(stand.geometries(keys[key](stand.first))) - base for key in "PLGT"}
    assert counts == {"P": -4, "L": -4, "G": 2, "T": 2}


def test_scales_and_colours_are_those_of_the_report(run: Path, stand: Stand) -> None:
    report = read_subject([run])
    assert stand.fields == shown_fields(report)
    assert stand.gaps == point_field(report)
    page = stand.page(stand.first)
    _, colours = page.bar(stand.fields[0], -1.0, -0.2, -1.3)
    table = colour_table(stand.fields[0].colours)
    np.testing.assert_allclose(colours[[0, -1]], table[[0, -1]])


def test_the_ends_of_the_colours_are_written(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[str] = []
    monkeypatch.setattr(Sheet, "text", lambda _, words, at: written.append(words))
    monkeypatch.setattr(Sheet, "before", lambda _, words, at: written.append(words))
    keys = stand.keys()
    stand.geometries(keys["T"](keys["G"](keys["F2"](stand.first))))
    field, gaps = stand.fields[0], stand.gaps
    assert written == [
        "level_set, PA",
        "grey edges: prior, black edges: truth",
        f"0 to {field.high:.3g} mm",
        "distance to truth",
        f"0 to {gaps.high:.3g} mm",
        "distance of the points",
        "LSPV",
        "RSPV",
        "LIPV",
    ]


@pytest.mark.parametrize("key", ["F1", "F4", "F7"])
def test_words_face_the_view_that_is_chosen(key: str, stand: Stand) -> None:
    choice = stand.keys()[key](stand.first)
    page = stand.page(choice)
    words = page.text("level_set", (-1.0, 1.3))
    assert words is not None
    _, size, flat = np.linalg.svd(words.vertices - words.vertices.mean(axis=0))
    assert size[2] < 1e-4  # Open3D's letters are single precision
    towards = list(stand.views.values())[choice.view]
    np.testing.assert_allclose(abs(flat[2] @ towards), np.linalg.norm(towards), atol=1e-5)
    assert np.dot(np.cross(page.axes[0], page.axes[1]), towards) > 0  # not mirrored
    assert page.text("", (0.0, 0.0)) is None


class Window:
    """A window that is not there: it keeps what is put into it."""

    def __init__(self) -> None:
        self.keys: dict[int, Callable[[object], object]] = {}
        self.shown: list[object] = []
        self.looks: list[tuple[str, list[float]]] = []
        self.mesh_show_back_face = False

    def create_window(self, *_: object) -> bool:
        return True

    def get_render_option(self) -> Window:
        return self

    def get_view_control(self) -> Window:
        return self

    def register_key_callback(self, key: int, press: Callable[[object], object]) -> None:
        self.keys[key] = press

    def clear_geometries(self) -> None:
        self.shown = []

    def add_geometry(self, one: object, *, reset_bounding_box: bool) -> None:
        self.shown.append(one)

    def set_front(self, at: list[float]) -> None:
        self.looks.append(("front", at))

    def set_up(self, at: list[float]) -> None:
        self.looks.append(("up", at))

    def set_lookat(self, at: list[float]) -> None:
        self.looks.append(("at", at))

    def run(self) -> None:
        for key in ("1", "P", "H"):
            self.keys[ord(key)](None)
        self.keys[290 + 1](None)  # F2: from behind

    def destroy_window(self) -> None:
        self.keys = {}


def test_keys_reach_the_window(
    run: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    import open3d as o3d

    window = Window()
    monkeypatch.setattr(o3d.visualization, "VisualizerWithKeyCallback", lambda: window)
    monkeypatch.setenv("DISPLAY", ":0")
    caplog.set_level("INFO", logger="o3dls")
    open_window(run)
    fronts = [at for name, at in window.looks if name == "front"]
    np.testing.assert_allclose(fronts, [[0, -1, 0], [0, 1, 0]], atol=1e-12)  # LPS: AP, then PA
    assert "start, PA: distance to truth" in caplog.text
    assert caplog.text.count("F1 AP, F2 PA, F3 LAO 45") == 2
    assert len(window.shown) > 5


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
    with pytest.raises(InputError, match="no display here for a window; look at the page in a browser"):
        open_window(run)


def test_two_dimensions_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a run in 2D"):
        open_window(finished_2d(tmp_path / "run"))


def test_window_opens_and_draws(run: Path, tmp_path: Path) -> None:
    server = shutil.which("xvfb-run")
    if server is None:
        pytest.skip("no xvfb-run: a window needs a screen")
    picture = tmp_path / "window.png"
    command = [server, "-a", sys.executable, "-c", WINDOW, str(run), str(picture)]
    software = {**os.environ, "LIBGL_ALWAYS_SOFTWARE": "1"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=software, check=False)
    assert done.returncode == 0, done.stderr
    assert "level_set, AP: distance to truth" in done.stderr
    from matplotlib.image import imread

    assert imread(picture).std() > 0.05


def test_words_stand_apart_and_no_light_falls_on_bars_and_words(stand: Stand) -> None:
    """With the longest label of all fields before the bar of the points."""
    longest = max(range(len(stand.fields)), key=lambda k: len(stand.fields[k].label))
    choice = replace(stand.first, field=longest, landmarks=False)
    page = stand.page(choice)
    surface, points, *rest = stand.geometries(choice)
    assert surface.has_vertex_normals()
    assert points.has_vertex_normals()
    boxes = []
    for one in rest:
        assert not one.has_vertex_normals()
        flat = (np.asarray(one.vertices) - page.centre) @ page.axes[:2].T / page.radius
        boxes.append((flat.min(axis=0), flat.max(axis=0)))
    assert len(boxes) == 7
    for k, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[k + 1 :]:
            assert (low >= other_high).any() or (high <= other_low).any()
