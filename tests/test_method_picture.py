"""tools/method_pictures.py draws the stages of a run of the demo."""

from __future__ import annotations

import runpy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from conftest import ROOT

from o3dls import read_case
from o3dls.resources import demo_case


def test_each_stage_has_its_outline_and_a_band_where_there_is_a_deviation() -> None:
    case = read_case(demo_case())
    known = {"sd_mm": np.ones(len(case.prior.vertices))}
    sure = SimpleNamespace(surface=replace(case.prior, fields=known))
    plain = SimpleNamespace(surface=case.prior)
    run = SimpleNamespace(
        case=case, estimates={"start": plain, "icp": plain, "deform": sure, "level_set": sure}
    )
    figure = runpy.run_path(str(ROOT / "tools" / "method_pictures.py"))["drawn"](run)
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == [
        "1. The case",
        "2. Pose: landmarks, then ICP",
        "3. Motion T of the prior",
        "4. Level set φ",
    ]
    outlines = [[c for c in axes.collections if hasattr(c, "get_segments")] for axes in figure.axes]
    assert [len(one) for one in outlines] == [2, 2, 4, 4]  # truth and wall, and two ends of the band
    assert all(len(lines.get_segments()) > 50 for one in outlines for lines in one)
