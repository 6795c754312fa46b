"""The stage `paper_level_set`: it starts from the similarity alone, and says what its energy leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import circle, meshed, round_distance, sampled
from starts import started

from o3dls.case import Case, Points
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import distances
from o3dls.geometry.similarity import similarity
from o3dls.stages.paper_level_set import PaperLevelSet

SEED = 264_575


@pytest.mark.parametrize("dimension", [2, 3])
def test_it_starts_from_the_similarity_alone(dimension: int) -> None:
    prior = circle(20.0, 300) if dimension == 2 else meshed(round_distance(14.0), 18.0)
    case, start = started(prior, sampled(prior, 200, 0.5, SEED), 0.5)
    # a motion that the paper's T cannot have
    away = start.surface.with_vertices(start.surface.vertices + 5.0)
    found = PaperLevelSet()(case, replace(start, surface=away))
    assert distances(prior.vertices, found.surface).mean() < 0.6
    assert "component" in found.status
    assert found.facts["components"] >= 1


def test_it_takes_points_that_lie_on_the_prior() -> None:
    prior = meshed(round_distance(14.0), 18.0)
    case = Case("case", prior, Points(prior.vertices[::9], np.full(len(prior.vertices[::9]), "eam")))
    found = PaperLevelSet(iterations=2)(case, Estimate(prior, np.eye(4), "start"))
    assert distances(prior.vertices, found.surface).max() < 0.3


def test_it_begins_at_the_prior_under_t() -> None:
    prior = meshed(round_distance(14.0), 18.0)
    frame = similarity(np.eye(3), np.array([30.0, 0.0, 0.0]))
    truth = prior.transformed(frame)
    case = Case("case", prior, Points(sampled(truth, 200, 0.5, SEED), np.full(200, "eam")))
    found = PaperLevelSet(iterations=2)(case, Estimate(truth, frame, "moved"))
    np.testing.assert_allclose(found.surface.vertices.mean(axis=0), [30.0, 0.0, 0.0], atol=0.5)


def test_iterations_are_those_of_the_sentence() -> None:
    prior = circle(20.0, 300)
    points = sampled(circle(20.0, 300), 100, 0.3, SEED) * [1.2, 1.0]
    case = Case("case", prior, Points(points, np.full(100, "eam")))
    found = PaperLevelSet(iterations=3)(case, Estimate(prior, np.eye(3), "start"))
    assert f" after {found.iterations} reinitialisations" in found.status
    assert len(found.trace) == found.iterations + 1 > 1
    assert found.trace[-1]["energy"] < found.trace[0]["energy"]
