"""Enhanced atria whose voltages follow the enhancement by the line that they state."""

from __future__ import annotations

import numpy as np
import pytest
from veined import veined

from data_synth import Mapping
from data_synth.scarred import LOW, RATIO, Scarred, scarred
from o3dls.geometry.surface import interpolated

MANY = 3000


@pytest.fixture(scope="module")
def made() -> Scarred:
    return scarred(veined(14.0, 3.0), 5, family="regions", how=Mapping(MANY, 0.5, clustered=False))


def test_the_line_at_the_true_places_is_the_one_that_is_stated(made: Scarred) -> None:
    points = made.case.points.of("eam")
    slope, level = np.polyfit(points.numbers(f"{RATIO}_true"), np.log(points.numbers("bipolar")), 1)
    # what the ratio does not explain is alike over some millimetres, so that many points tell it to 10 %
    assert slope == pytest.approx(made.slope, rel=0.15)
    assert (np.log(LOW) - level) / slope == pytest.approx(made.half, abs=0.05)
    assert f"slope {made.slope:.4f}" in made.case.notes


def test_the_ratio_belongs_to_the_wall_wherever_that_has_moved(made: Scarred) -> None:
    case = made.case
    assert case.truth is not None
    assert case.truth.surface is not None
    truth, ratio = case.truth.surface, case.prior.fields[RATIO]
    points = case.points.of("eam")
    _, face, _, weights = truth.closest_point.query(points.xyz)
    near = interpolated(ratio, truth.faces[face], weights)
    off = near - points.numbers(f"{RATIO}_true")
    assert np.median(np.abs(off)) < 0.02  # the noise of a point leads it a little aside
    assert np.ptp(ratio) > 0.3


def test_a_seed_gives_one_case_and_another_another_line() -> None:
    how = Mapping(40, 1.0, clustered=False)
    one, same, other = (scarred(veined(14.0, 3.0), seed, how=how) for seed in (3, 3, 4))
    assert np.array_equal(one.case.points.xyz, same.case.points.xyz)
    assert one.slope == same.slope != other.slope
