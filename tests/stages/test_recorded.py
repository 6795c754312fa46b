"""The recorded pose is taken as it is, and refused where there is none or where it is not a pose."""

from dataclasses import replace

import numpy as np
import pytest
from chamber import chamber, measured, pose

from o3dls.errors import InputError
from o3dls.estimate import Estimate
from o3dls.stages.recorded import Recorded


def test_the_recorded_matrix_is_the_estimate() -> None:
    case = replace(measured(chamber(16), np.eye(4)), init=pose(20.0, 7.0, 1.02))
    found = Recorded()(case, Estimate(case.prior, np.eye(4), "start"))
    np.testing.assert_array_equal(found.T_map_prior, case.init)
    np.testing.assert_allclose(found.surface.vertices, case.prior.transformed(case.init).vertices)


def test_a_case_without_a_recorded_pose_says_so() -> None:
    case = measured(chamber(16), np.eye(4))
    assert "no init.csv" in str(Recorded().obstacle(case))
    with pytest.raises(InputError, match=r"no init\.csv"):
        Recorded()(case, Estimate(case.prior, np.eye(4), "start"))
