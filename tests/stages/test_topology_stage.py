"""The stage: a vein more or less, what it says of it, and what stays where there is nothing to change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import ball_with_tube, circle, meshed, round_distance, sampled
from starts import started

from data_synth import atrium
from o3dls import ICP, Deform, Landmarks, LevelSet, Pipeline, Topology
from o3dls.case import Case
from o3dls.errors import PipelineError
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import distances
from o3dls.geometry.surface import Surface

SEED = 264_575
BALL = meshed(round_distance(16.0), 20.0)
TUBED = meshed(ball_with_tube, 34.0)


@pytest.fixture(scope="module")
def removed() -> tuple[Case, Estimate, Estimate]:
    """A case whose truth lacks a vein, the motion that the stage starts from, and what it makes of it."""
    prior = replace(TUBED, fields={"height": TUBED.vertices[:, 2]})
    case, start = started(prior, sampled(BALL, 800, 0.5, SEED), 0.5)
    return case, start, Topology()(case, start)


def test_a_vein_that_the_truth_lacks_is_removed_and_said(removed: tuple[Case, Estimate, Estimate]) -> None:
    _, start, found = removed
    assert found.status.startswith("removed a part at (")
    assert found.facts["changes"] == [found.status]
    assert [warning.code for warning in found.warnings] == ["topology-changed"]
    assert distances(found.surface.vertices, BALL).mean() < 0.15
    assert found.fit is not None
    assert found.motion is found.fit.motion
    assert found.motion is not start.motion
    assert found.converged == found.fit.converged
    assert found.iterations == len(found.trace) > 0
    away = found.surface.vertices[:, 0] < 5.0
    np.testing.assert_allclose(
        found.surface.fields["height"][away], found.surface.vertices[away, 2], atol=0.3
    )
    assert found.surface.fields["sd_mm"].mean() > 0.0


def test_the_level_set_after_it_keeps_the_motion_and_tells_of_the_changes(
    removed: tuple[Case, Estimate, Estimate],
) -> None:
    case, _, changed = removed
    found = LevelSet()(case, changed)
    for name in ("T_map_prior", "motion", "fit", "weights"):
        assert getattr(found, name) is getattr(changed, name)
    assert found.facts["changes"] == changed.facts["changes"]
    assert found.warnings[0] == changed.warnings[0]
    assert distances(found.surface.vertices, BALL).mean() < 0.1


def test_a_vein_that_the_prior_lacks_is_grown() -> None:
    case, start = started(BALL, sampled(TUBED, 400, 1.0, SEED), 1.0)
    found = LevelSet()(case, Topology()(case, start))
    assert "added a tube" in found.facts["changes"][0]
    assert distances(TUBED.vertices, found.surface).mean() < 0.3 * distances(TUBED.vertices, BALL).mean()


def test_a_vein_that_the_prior_lacks_is_grown_after_a_motion() -> None:
    case = atrium(107, lacks="prior")
    found = Pipeline([Landmarks(), ICP(), Deform(), Topology(), LevelSet()], folds=0).fit(case)
    assert "added a tube" in found["topology"].status
    assert case.truth is not None
    assert case.truth.held_out is not None
    before, after = (
        distances(case.truth.held_out, found[name].surface).mean() for name in ("deform", "level_set")
    )
    assert after < 0.85 * before


@pytest.mark.parametrize("how", [{"evidence": 1e6}, {}], ids=["too little evidence", "no motion"])
def test_without_a_change_the_start_stays_and_the_status_says_why(how: dict[str, float]) -> None:
    case, start = started(TUBED, sampled(BALL, 800, 0.5, SEED), 0.5, fitted=bool(how))
    found = Topology(**how)(case, start)
    assert found.status.startswith("no change of topology: ")
    assert ("evidence" if how else "no motion was fitted") in found.status
    assert found.facts == {"changes": []}
    assert found.warnings == ()
    for name in ("surface", "T_map_prior", "motion", "fit", "weights", "sigma", "converged"):
        assert getattr(found, name) is getattr(start, name)


def test_a_prior_of_two_components_is_left_alone() -> None:
    beside = BALL.vertices + np.array([60.0, 0.0, 0.0])
    prior = Surface(
        np.vstack([TUBED.vertices, beside]), np.vstack([TUBED.faces, BALL.faces + len(TUBED.vertices)])
    )
    case, start = started(prior, sampled(BALL, 800, 0.5, SEED), 0.5)
    assert "the prior has 2 components" in Topology()(case, start).status


def test_outlines_may_come_too() -> None:
    prior = circle(20.0, 300)
    found = Topology()(*started(prior, sampled(prior, 300, 1.0, SEED), 1.0))
    assert found.facts["changes"] == []
    assert found.surface is not None


def test_a_motion_that_begins_earlier_stays() -> None:
    """As that of `phases`, which leads from the prior to the surface that was deformed."""
    case, start = started(TUBED, sampled(BALL, 800, 0.5, SEED), 0.5)
    earlier = start.motion

    class Chain:
        def __call__(self, points: np.ndarray) -> np.ndarray:
            assert earlier is not None
            return earlier(points)

        def sd(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
            assert earlier is not None
            return earlier.sd(points, normals)

    chained: Estimate = replace(start, motion=Chain())
    found = Topology()(case, chained)
    assert found.facts["changes"]
    assert found.motion is chained.motion
    assert found.T_map_prior is chained.T_map_prior


def test_changes_of_an_earlier_stage_are_handed_on() -> None:
    case, start = started(BALL, sampled(BALL, 100, 0.5, SEED), 0.5)
    found = Topology()(case, replace(start, facts={"changes": ["removed a part"]}))
    assert found.facts["changes"] == ["removed a part"]


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"evidence": -1.0}, r"topology.evidence = -1.0 nats: must be a number within \[0, inf\) nats"),
        ({"spacing": 0.0}, r"topology.spacing = 0.0 mm: must be a number within \[0.001, inf\) mm"),
    ],
)
def test_parameters_are_checked(given: dict[str, float], sentence: str) -> None:
    with pytest.raises(PipelineError, match=sentence):
        Topology(**given)
