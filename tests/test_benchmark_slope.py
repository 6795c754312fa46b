"""The benchmark of slopes judges one case in every way, and tables what it found."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.slope import COLUMNS, Judged, judge, table
from data_synth import Mapping
from data_synth.scarred import scarred
from tests.data_synth.veined import veined


def test_a_case_is_judged_by_every_way() -> None:
    found = judge(scarred(veined(14.0, 3.0), 7, family="regions", how=Mapping(120, 1.0, clustered=False)))
    assert found.points == 120
    assert found.slope.shape == found.half.shape == (len(COLUMNS),)
    assert np.abs(found.slope).max() < 1.0


def test_the_table_has_means_with_their_errors_and_what_is_held() -> None:
    judged = [
        Judged(100, np.array([-0.3, -0.1, 0.02, 0.0]), np.zeros(4), True, True),
        Judged(100, np.array([-0.1, -0.1, -0.02, 0.0]), np.zeros(4), False, True),
    ]
    head, slope, half = table(judged).splitlines()
    assert [name in head for name in COLUMNS] == [True] * len(COLUMNS)
    for cell in ("-20.0 ± 10.0", "-10.0 ± 0.0", "+0.0 ± 2.0", "50.0"):
        assert cell in slope
    assert half.endswith("100.0")
    assert pytest.approx(2.0) == 100.0 * np.sqrt(np.mean([one.slope[2] ** 2 for one in judged]))
    assert " 2.0 " in slope
