"""A report begins with the pose in which the prior was given, also where landmarks were fitted first."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from o3dls.case import Case
from o3dls.geometry.similarity import apply, similarity
from o3dls.report.drawing.scene import scene
from o3dls.report.subject import read_subject
from o3dls.report.surfaces.given import with_given
from o3dls.report.writer import write_report
from o3dls.runs.folder import read_run
from tests.finished import bulged_case, finished

FAR = similarity(Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), np.array([40.0, 5.0, -9.0]))


def elsewhere(*, init: bool) -> Case:
    """The prior in another frame than the points, with landmarks on it, and an init matrix that is only about
    right, or none.
    """
    case = bulged_case()
    marks = {name: apply(FAR, at[None])[0] for name, at in case.prior_landmarks.items()}
    rough = np.linalg.inv(FAR)
    rough[:3, 3] += 3.0
    moved = replace(case, prior=case.prior.transformed(FAR), prior_landmarks=marks)
    return replace(moved, init=rough) if init else moved


@pytest.mark.parametrize("init", [False, True])
def test_the_pose_as_given_comes_first_in_table_and_pictures(tmp_path: Path, init: bool) -> None:
    case = elsewhere(init=init)
    folder = finished(tmp_path / "run", case)
    page = write_report([folder]).read_text(encoding="utf-8")
    table = next(
        one for one in re.findall("<table.*?</table>", page, re.DOTALL) if "mean distance, mm<" in one
    )
    rows = re.findall(r'<th scope="row">(.*?)</th>', table)
    assert rows[:2] == ["given (before registration)", "start (landmarks fitted rigidly)"]
    assert "before registration → landmarks fitted rigidly → icp" in page
    drawn = scene(read_subject([folder], runs=[with_given(read_run(folder))]))
    assert drawn["estimates"][0]["name"] == "given"
    run = with_given(read_run(folder))
    pose = np.eye(4) if case.init is None else case.init
    assert run.estimates["given"].surface.vertices == pytest.approx(apply(pose, case.prior.vertices))
    gap = run.scores["given"]["fitted"]["mean_mm"]
    assert gap > run.scores["start"]["fitted"]["mean_mm"] + 1.0
    assert run.final == read_run(folder).final


def test_a_start_that_is_the_pose_as_given_stands_once(tmp_path: Path) -> None:
    run = read_run(finished(tmp_path / "run"))
    assert with_given(run) is run
