"""Badly segmented priors: two tubes are short or missing, the rest is right to about a voxel, and the truth
has all of it.
"""

from __future__ import annotations

import numpy as np
import pytest
from veined import veined

from data_synth import Mapping, badly_segmented
from data_synth.badly_segmented import segmented
from data_synth.chamber import chamber
from data_synth.wall import crosses
from o3dls import Surface
from o3dls.evaluation.distances import distances

SEED = 90_217
VOXEL = 2.5  # mm, the largest side


@pytest.fixture(scope="module")
def whole() -> Surface:
    return veined(25.0)


@pytest.mark.parametrize("remeshed", [True, False])
def test_two_tubes_are_short_and_the_rest_is_right(remeshed: bool, whole: Surface) -> None:
    prior, said = segmented(np.random.default_rng(SEED), whole, remeshed=remeshed)
    assert said.count("cut") == 2
    assert prior.watertight
    assert not crosses(prior).any()
    parts = chamber(whole)
    gap = distances(whole.vertices, prior)
    lost = [k for k in range(4) if gap[(parts.tube == k) & (parts.depth > 15.0)].min() > VOXEL]
    assert len(lost) == 2
    right = ~np.isin(parts.tube, lost) & (parts.depth < 15.0)
    assert np.percentile(gap[right], 95.0) < VOXEL / 2.0
    assert distances(prior.vertices, whole).mean() < VOXEL / 4.0


@pytest.mark.parametrize("landmarks", [True, False])
def test_the_truth_is_the_whole_anatomy_and_is_mapped(landmarks: bool, whole: Surface) -> None:
    case = badly_segmented(whole, SEED, landmarks=landmarks, how=Mapping(800, 0.0, clustered=False))
    wall = case.truth.surface
    assert len(wall.vertices) == len(whole.vertices)
    assert distances(case.points.of("eam").xyz, wall).max() < 1e-3
    assert wall.fields["depth_mm"].max() == pytest.approx(25.0, abs=4.0)
    assert (case.init is None) == landmarks
    if landmarks:
        _, prior, _ = case.landmark_pairs()
        assert distances(prior, case.prior).max() < VOXEL


def test_the_same_seed_gives_the_same_case(whole: Surface) -> None:
    one, again, other = (badly_segmented(whole, seed) for seed in (SEED, SEED, SEED + 1))
    assert np.array_equal(one.prior.vertices, again.prior.vertices)
    assert np.array_equal(one.points.xyz, again.points.xyz)
    assert len(one.prior.vertices) != len(other.prior.vertices)
