"""What was not fitted and lies centimetres from the result is never OK: it is a check, and a warning."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from o3dls.case import Case, Points, Truth
from o3dls.pipeline.pipeline import Pipeline
from o3dls.report.checks import checks
from o3dls.report.subject import read_subject
from o3dls.runs.far_points import SETS, FarPoints, far_points
from o3dls.runs.run import Run
from o3dls.stages.icp import ICP
from tests.finished import bulged_case
from tests.tiny import disc_case

MARKS = SETS["landmarks"]


def wall(n: int, seed: int) -> np.ndarray:
    prior = bulged_case().prior
    return prior.vertices[np.random.default_rng(seed).choice(len(prior.vertices), n)]


def with_sites(near: int, far: int, off: float) -> Case:
    """The case with so many ablation sites on the wall, and so many beside it."""
    case = bulged_case()
    eam = case.points.of("eam", "landmark")
    places = wall(near + far, 40_127) + np.repeat([[0.0, 0, 0], [0.0, 0, off]], [near, far], axis=0)
    xyz = np.vstack([eam.xyz, places])
    kinds = np.append(eam.type, np.full(near + far, "ablation"))
    names = np.append(eam.columns["name"], np.full(near + far, ""))
    return replace(case, points=Points(xyz, kinds, {"name": names}), truth=None)


def run_of(case: Case) -> Run:
    return Pipeline([ICP()], folds=0).run(case)


def graded(run: Run, folder: Path) -> tuple[str, str]:
    run.write(folder)
    (found,) = (one for one in checks(read_subject([folder])) if one.name == "Far points")
    return found.grade, found.said


@pytest.mark.parametrize(
    ("near", "far", "off", "grade"),
    [(40, 0, 0.0, "good"), (30, 10, 90.0, "amber"), (39, 1, 90.0, "amber"), (10, 30, 90.0, "bad")],
)
def test_ablation_sites_far_off_are_not_ok(
    near: int, far: int, off: float, grade: str, tmp_path: Path
) -> None:
    run = run_of(with_sites(near, far, off))
    warned = [one for one in run.estimates[run.final].warnings if one.code == "points-far-off"]
    found, said = graded(run, tmp_path / "run")
    assert found == grade
    assert len(warned) == (grade != "good")
    if far:
        assert f"{far} of {near + far} ablation sites lie more than 20 mm from the surface" in said
        assert said in warned[0].sentence


def test_held_out_points_far_off_are_not_ok(tmp_path: Path) -> None:
    case = bulged_case()
    far = replace(case, truth=Truth(held_out=wall(50, 7_719) + np.array([0.0, 120.0, 0.0])))
    found, said = graded(run_of(far), tmp_path / "run")
    assert (found, said[:24]) == ("bad", "50 of 50 held-out points")


def test_landmarks_without_a_partner_are_looked_at_too(tmp_path: Path) -> None:
    case = replace(bulged_case(), truth=None)
    xyz = np.vstack([case.points.xyz, [[0.0, 0.0, 150.0]]])
    names = np.append(case.points.columns["name"], "elsewhere")
    points = Points(xyz, np.append(case.points.type, "landmark"), {"name": names})
    found, said = graded(run_of(replace(case, points=points)), tmp_path / "run")
    assert found in ("amber", "bad")
    assert "landmarks lie more than 20 mm from the surface" in said


def test_noise_and_the_middle_of_a_mouth_are_no_reason() -> None:
    rng = np.random.default_rng(5_541)
    noise = np.abs(rng.normal(0.0, 4.0, 3000))
    assert not FarPoints(SETS["held_out"], noise).doubtful
    assert not FarPoints(MARKS, np.full(6, 14.0)).doubtful
    assert FarPoints(SETS["ablation"], np.full(6, 14.0)).failed
    assert FarPoints(MARKS, np.array([2.0, 3.0, 26.0])).doubtful
    assert FarPoints(SETS["held_out"], np.append(noise, np.full(40, 25.0))).doubtful


def test_a_case_in_pixels_has_no_such_check() -> None:

    assert far_points(run_of(disc_case()), "icp") == []
