"""A pose that a registration got wrong is told from one that is right, and named on the page of a cohort and
on that of the paper.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from o3dls.arrays import Array
from o3dls.case import Case, Points
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import distances
from o3dls.geometry.similarity import similarity
from o3dls.paper.claims import wrong_poses as on_paper
from o3dls.paper.drawing import NAMES
from o3dls.paper.experiment import score
from o3dls.paper.results import Results
from o3dls.pipeline.pipeline import Pipeline
from o3dls.plugins.stage import Stage
from o3dls.report.cohort.entries import read_entries
from o3dls.report.cohort.page import cohort_page
from o3dls.report.grading.wrong_poses import wrong_poses
from tests.finished import Icp
from tests.tiny import sphere

SEED = 604_417
LONG = np.array([1.6, 1.0, 0.7])  # axes of an ellipsoid: no turn but by half a circle leaves it as it is
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def pose(turn: Array | None = None, shift: float = 0.0, scale: float = 1.0) -> Array:
    return similarity(np.eye(3) if turn is None else turn, np.full(3, shift), scale)


class Variant(Stage):
    """A variant of ICP that ends a quarter of a turn away."""

    name: ClassVar[str] = "variant"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        return Estimate(case.prior.transformed(pose(QUARTER)), pose(QUARTER), "converged")


def ellipsoid_case() -> Case:
    """An ellipsoid with points on it, half a millimetre off."""
    prior = sphere()
    prior = prior.with_vertices(prior.vertices * LONG)
    rng = np.random.default_rng(SEED)
    points = prior.vertices[rng.choice(len(prior.vertices), 150, replace=False)]
    points = points + rng.normal(scale=0.5, size=points.shape)
    return Case("ellipsoid", prior, Points(points, np.full(len(points), "eam")))


def found_among(case: Case, poses: dict[str, Array]) -> list[str]:
    xyz = case.points.xyz
    gaps = {name: distances(xyz, case.prior.transformed(T)) for name, T in poses.items()}
    return [one.name for one in wrong_poses(case.prior.vertices, poses, gaps, xyz)]


def test_a_pose_that_is_turned_away_is_wrong_and_those_beside_the_best_are_not() -> None:
    poses = {"robust": pose(), "shifted": pose(shift=1.0), "turned": pose(QUARTER)}
    assert found_among(ellipsoid_case(), poses) == ["turned"]


def test_another_scale_or_half_a_turn_of_a_symmetric_shape_is_no_wrong_pose() -> None:
    half = np.diag([-1.0, -1.0, 1.0])
    poses = {"robust": pose(), "rigid": pose(scale=1.4), "half": pose(half)}
    assert found_among(ellipsoid_case(), poses) == []


def test_few_points_accuse_no_pose() -> None:
    case = ellipsoid_case()
    few = replace(case, points=case.points.select(np.arange(150) < 8))
    assert found_among(few, {"robust": pose(), "turned": pose(QUARTER)}) == []


@pytest.mark.parametrize("turned", [True, False])
def test_the_page_of_a_cohort_names_the_run_with_a_pose_that_a_variant_got_wrong(
    turned: bool, tmp_path: Path
) -> None:
    stages = [Icp(), Variant(after="start")] if turned else [Icp()]
    folder = Pipeline(stages, folds=0).run(ellipsoid_case()).write(tmp_path / "run")
    (entry,) = read_entries([folder])
    page = cohort_page([entry], tmp_path / "cohort.html")
    said = re.sub("<[^>]+>", "", page)
    assert len(entry.wrong_poses) == turned
    assert ("1 run with a pose that a registration got wrong" in said) == turned
    if turned:
        assert "run: variant is in a wrong pose" in said
        assert re.search(
            r"from that of icp, and \d+\.\d\d mm from the points on average against 0\.\d\d", said
        )


def test_the_page_of_the_paper_names_the_case_and_the_method() -> None:
    case = ellipsoid_case()
    moved = {"icp": pose(QUARTER), "similarity": pose(shift=0.1)}
    moved |= {"start": pose()}
    estimates = {
        name: Estimate(case.prior.transformed(T), T, "converged", seconds=0.1) for name, T in moved.items()
    }
    plan = Pipeline([Variant(as_="icp"), Icp(as_="similarity", after="start")], folds=0)
    rows = [
        {"experiment": "atrium", "seed": 7} | score(case, plan, estimates, name)
        for name in ("icp", "similarity")
    ]
    heading, _, table = on_paper(Results(rows, {}, True, Path()))
    assert heading.markdown() == "## Poses that a registration got wrong"
    _, _, _, _, line = table.markdown().splitlines()
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[:2] == ["atrium, seed 7", NAMES["icp"]]
    assert float(cells[2]) > 3 * float(cells[3].split()[0])
    assert NAMES["similarity"] in cells[3]
    _, none = on_paper(Results(rows[1:], {}, True, Path()))
    assert none.markdown() == "None on this page."
