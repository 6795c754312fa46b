"""The benchmark of changes: its pairs have the scar and the gain that they say, and its table counts them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.change import Judged, table
from data_synth import Mapping
from data_synth.case_points import true_surface
from data_synth.redo import CHANGED, VOLTAGE, redo
from tests.chamber import chamber

AREA = 4.0  # cm²
RIM = 0.25  # of the area: what of it lies on triangles that the border cuts


@pytest.mark.parametrize("area", [AREA, 0.0])
def test_a_redo_has_a_scar_of_the_area_and_its_own_gain_and_points(area: float) -> None:
    prior = chamber(24)
    pair = redo(prior, 90_411, area, Mapping(80, 1.0, clustered=False))
    before, after = (true_surface(case) for case in (pair.before, pair.after))
    scar = after.fields[CHANGED] > 0.5
    assert prior.vertex_areas @ scar == pytest.approx(100.0 * area, rel=RIM)
    ratio = after.fields[VOLTAGE] / before.fields[VOLTAGE]
    assert np.median(ratio[~scar]) == pytest.approx(pair.gain, rel=1e-3)
    assert (ratio[scar] < 0.7 * pair.gain).mean() > 0.8 if area else not scar.any()
    assert not np.allclose(before.vertices, after.vertices, atol=1.0)
    values = [case.points.of("eam").columns["bipolar"] for case in (pair.before, pair.after)]
    assert all(len(one) == 80 and (one > 0.0).all() for one in values)
    assert not np.allclose(*values)


def judged(true: float, found: float, false: float = 0.0) -> Judged:
    return Judged(250, true, found, 0.5 * found, 1.2 * found, false, 0.95, 1.0, 0.9, 1.0)


def test_the_table_counts_what_was_found_and_what_is_false() -> None:
    rows = table([judged(4.0, 4.4), judged(4.0, 3.0), judged(3.0, 0.0), judged(0.0, 0.0, 0.02)]).splitlines()
    cells = {
        row.split()[0] + " " + row.split()[1]: row.split()[2:] for row in rows if row[:4] in ("scar", "none")
    }
    assert cells["scar all"][:8] == ["3", "2", "17.5", "-7.5", "1", "1", "0", "0.0"]
    assert cells["none all"][:3] == ["1", "1", "2.0"]
