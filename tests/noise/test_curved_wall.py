"""The bias of distances from a curved wall, against noise that is drawn."""

import numpy as np
import pytest

from o3dls.noise.curved_wall import curved_wall_bias


@pytest.mark.parametrize(("radius", "sd"), [(25.0, 1.5), (25.0, 2.0), (8.0, 0.8), (-25.0, 1.5)])
@pytest.mark.parametrize("axes", [2, 3], ids=["tube", "ball"])
def test_points_lie_outside_of_a_curved_wall_by_half_the_variance_times_its_bend(
    radius: float, sd: float, axes: int
) -> None:
    rng = np.random.default_rng(5)
    points = np.zeros((400_000, 3))
    points[:, 0] = abs(radius)
    points += rng.normal(0.0, sd, points.shape)
    distance = np.linalg.norm(points[:, :axes], axis=1) - abs(radius)
    distance = distance if radius > 0.0 else -distance  # a hollow
    bias = curved_wall_bias(np.array([sd]), np.array([(axes - 1) / radius]))[0]
    error = sd / np.sqrt(len(points))
    assert distance.mean() == pytest.approx(bias, abs=4.0 * error + 0.05 * abs(bias))


def test_no_bias_is_larger_than_the_law_holds_for() -> None:
    sd = np.array([1.0, 1.0])
    assert curved_wall_bias(sd, np.array([2.0, -2.0])).tolist() == [0.3, -0.3]
