"""Poses that a registration got wrong: not near the pose that fits best, and clearly farther from the
points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...arrays import Array
from ...evaluation.statistics import Difference, paired_difference
from ...geometry.similarity import apply, rms_radius, scale_of
from ..subject import Subject
from ..surfaces.given import found_poses

# rms radii between two poses: variants of ICP that found one pose leave up to 0.08, and landmarks alone 0.19
APART = 0.3


@dataclass(frozen=True)
class WrongPose:
    """A wrong pose has its name and that of the best one, the rms distance of the prior in both, their scales
    left aside, and the difference of their distances from the points.
    """

    name: str
    best: str
    apart: float
    difference: Difference

    def describe(self, unit: str) -> str:
        """Say what is wrong with it."""
        far, near = self.difference.second, self.difference.first
        return (
            f"{self.name} is in a wrong pose: {self.apart:.3g} {unit} from that of {self.best}, and "
            f"{far:.2f} {unit} from the points on average against {near:.2f}"
        )


def wrong_poses(
    vertices: Array, poses: Mapping[str, Array], gaps: Mapping[str, Array], positions: Array
) -> list[WrongPose]:
    """Return the poses that are wrong beside another one of the same prior.

    vertices (m, d): of the prior; poses (d+1, d+1) and distances (n,) of the points at positions (n, d): by
    the names of the estimates. The pose whose points are nearest in the mean is the best. A body of
    revolution in another turn fits as well, and is not wrong.
    """
    if not poses or not len(positions):
        return []
    best = min(poses, key=lambda name: float(gaps[name].mean()))
    found = []
    for name in poses:
        apart = _measure_gap(vertices, poses[name], poses[best])
        if apart < APART * rms_radius(vertices):
            continue
        difference = paired_difference(gaps[best], gaps[name], positions)
        if difference.low > 0.0:
            found.append(WrongPose(name, best, apart, difference))
    return found


def wrong_poses_of(subject: Subject) -> list[WrongPose]:
    """Return the wrong poses among the estimates of the last result's run."""
    run, last = subject.last.run, subject.last
    found = found_poses(run)
    results = {one.key: one for one in subject.results.values() if one.run is run and one.key in found}
    measured = {name: one.measured("fitted", last) for name, one in results.items()}
    positions = next((xyz for xyz, _ in measured.values()), np.zeros((0, run.case.dimension)))
    poses = {name: one.estimate.T_map_prior for name, one in results.items()}
    return wrong_poses(
        run.case.prior.vertices, poses, {name: gaps for name, (_, gaps) in measured.items()}, positions
    )


def _measure_gap(vertices: Array, one: Array, other: Array) -> float:
    """Return the rms distance of a surface in two poses, both brought to the prior's own size: rigid variants
    and those with scale differ in size where both are right.
    """
    apart = _leave_out_scale(vertices, one) - _leave_out_scale(vertices, other)
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def _leave_out_scale(vertices: Array, pose: Array) -> Array:
    posed = apply(pose, vertices)
    middle = posed.mean(axis=0)
    return np.asarray(middle + (posed - middle) / scale_of(pose))
