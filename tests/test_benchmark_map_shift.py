"""The benchmark of shifted maps: it shifts what it says, and a shifted phantom is named and comes back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.map_shift import deformed, named, off, shifted
from o3dls.case import Case
from o3dls.io.case_reader import read_case


@pytest.fixture(scope="module")
def phantom(shared_data: Path) -> Case:
    """A phantom atrium of the shared data."""
    return read_case(shared_data / "phantom" / "la_02")


def test_half_of_the_points_move_and_landmarks_stay(phantom: Case) -> None:
    case = phantom
    offset = np.array([0.0, 10.0, 0.0])
    for part in ("left", "later"):
        moved = (shifted(case, part, offset).points.xyz - case.points.xyz)[:, 1] > 0.0
        assert moved[case.points.type == "eam"].mean() == 0.5
        assert not moved[case.points.type == "landmark"].any()


@pytest.mark.parametrize(
    ("part", "length", "said"),
    # of the later half at 15 mm, a plane explains more before the offset is out of the fit
    [("left", 10.0, "beyond the plane (1.00, 0.00, 0.00)"), ("later", 15.0, "taken from point 12")],
)
def test_a_shifted_phantom_is_named_and_comes_back(
    part: str, length: float, said: str, phantom: Case
) -> None:
    case = phantom
    found = deformed(shifted(case, part, np.array([0.0, 0.0, length])), "fit")
    assert said in named(found)
    assert "of 250 points" in named(found)
    # mm, of 1.9 and more with the offset in it: what the noise of 1.4 mm leaves of an offset of half the map
    assert off(case, found) < off(case, deformed(case, "ignore")) + 0.15


def test_a_phantom_that_is_whole_is_not_named(phantom: Case) -> None:
    assert not named(deformed(phantom, "report"))
