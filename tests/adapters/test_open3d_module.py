"""Open3D is whole without dash, and dash comes when its names are used."""

from __future__ import annotations

import subprocess
import sys

import pytest

IMPORTED = """
import sys
from o3dls.adapters.open3d_module import open3d
o3d = open3d()
assert "dash" not in sys.modules
import open3d as again
assert again is o3d
"""
PLOT = """
import importlib
plot = importlib.import_module("open3d.visualization.draw_plotly")
assert isinstance(plot.Dash("a"), sys.modules["dash"].Dash)
assert plot.html.Div is sys.modules["dash"].html.Div
"""
THERE = """
import dash
from o3dls.adapters.open3d_module import open3d
assert open3d().visualization.draw_plotly.__globals__["Dash"] is dash.Dash
"""


@pytest.mark.parametrize(
    "text", [IMPORTED, IMPORTED + PLOT, THERE], ids=["not asked", "asked", "there before"]
)
def test_dash_comes_when_it_is_used(text: str) -> None:
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
