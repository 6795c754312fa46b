"""An estimate where other programs look at it: on the map, or on the prior, which is the patient's image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from ...arrays import Array
from ...case import MILLIMETRES, Case, Points
from ...errors import InputError
from ...geometry.similarity import TURN, apply
from ...geometry.surface import Surface
from .formats import IN_ANY_UNITS

if TYPE_CHECKING:
    from ...estimate import Estimate
    from ...motion.recorded import RecordedMotion
    from ..run import Run

On = Literal["map", "prior"]


@dataclass(frozen=True, eq=False)
class Placed:
    """A placed surface has its fields and the run's points, in one frame (LPS, RAS or unknown).

    pose (4, 4) is `T_map_prior` on the map; on the prior its inverse, which moves the map onto the image.
    """

    surface: Surface
    points: Points
    pose: Array
    frame: str

    def in_units(self, units: str) -> Placed:
        """Return the surface and the points out of mm in other units; the pose, and what names its unit, stay
        in mm.
        """
        from ...io.points import scaled

        size = MILLIMETRES[units]
        if size == 1.0:
            return self
        surface = self.surface.with_vertices(self.surface.vertices / size)
        return replace(self, surface=surface, points=scaled(self.points, 1.0 / size))


def placed(run: Run, name: str, surface: Surface, on: On, frame: str | None = None) -> Placed:
    """Return an estimate's `surface` on the map, or what it shows on the prior's own surface, in `frame`;
    default that of the map or the prior.

    Raises InputError where the frame is asked for and that of the file is not known.
    """
    case, estimate = run.case, run.estimates[name]
    own = frame_of(case, on)
    if frame and own == "unknown":
        raise InputError(f"case {case.name}: {unknown_frame(on)}")
    frame = frame or own
    points = run.points or case.points
    pose = _pose_in_frame(case, estimate, frame)
    if on == "prior":
        motion = recorded(case, estimate)
        surface = _carry_to_prior(case, motion, surface)
        points = replace(points, xyz=motion.inverse(points.xyz))
        pose = np.asarray(np.linalg.inv(pose))
    if frame != own:
        surface = surface.transformed(TURN)
        points = replace(points, xyz=apply(TURN, points.xyz))
    return Placed(surface, points, pose, frame)


def frame_of(case: Case, on: On) -> str:
    """Return the frame of the map or of the prior, unknown where no file says it."""
    return case.prior_frame if on == "prior" else case.frame


def units_of(case: Case, on: On, format: str) -> tuple[str, str]:
    """Return the units of a file to write, and those that belong there: on the prior, those of its own
    file.
    """
    own = case.prior_file_units or case.units if on == "prior" else case.units
    return own if format in IN_ANY_UNITS else case.units, own


def unknown_frame(on: On) -> str:
    """Return a sentence on how to say a frame that no file states."""
    if on == "map":
        return 'the frame of the case is unknown; say frame = "LPS" or "RAS" in its case.toml'
    return (
        "the frame of the prior is unknown; write it into its file with o3dls convert PRIOR prior.ply "
        "--frame LPS (or RAS), and run again"
    )


def recorded(case: Case, estimate: Estimate) -> RecordedMotion:
    """Return the motion of an estimate, with its inverse, by where it brought the prior's vertices."""
    from ...motion.recorded import RecordedMotion
    from ..estimate_files import move_prior

    if isinstance(estimate.motion, RecordedMotion):
        return estimate.motion
    if estimate.motion is not None:
        after, deviation = move_prior(case.prior, estimate.motion)
        return RecordedMotion(case.prior, after, estimate.T_map_prior, deviation)
    after = case.prior.transformed(estimate.T_map_prior)
    return RecordedMotion(case.prior, after, estimate.T_map_prior, np.full(len(after.vertices), np.nan))


def _carry_to_prior(case: Case, motion: RecordedMotion, surface: Surface) -> Surface:
    """Return the prior with the fields of the surface that its vertices came to lie on, NaN where none is
    near, and their distance from it.
    """
    from ...evaluation.projection import project
    from ...evaluation.transfer import between

    found = between(surface, case.prior, target_motion=motion)
    gap = project(motion.moved.vertices, surface).distance
    return replace(found, fields={**found.fields, f"distance_to_result_{case.units}": gap})


def lps_pose(case: Case, estimate: Estimate) -> tuple[Array, Array, Array]:
    """Return what turns the prior's frame and the map's to LPS, and `T_map_prior` between the two in LPS; an
    unknown frame counts as that of the other side.
    """
    frames = case.prior_frame, case.frame
    prior, on_map = (own if own != "unknown" else other for own, other in (frames, frames[::-1]))
    turn, turn_map = (TURN if frame == "RAS" else np.eye(4) for frame in (prior, on_map))
    return turn, turn_map, np.asarray(turn_map @ estimate.T_map_prior @ turn)


def _pose_in_frame(case: Case, estimate: Estimate, frame: str) -> Array:
    """Return `T_map_prior` between prior and map that are both given in `frame`."""
    prior_frame = case.frame if case.prior_frame == "unknown" else case.prior_frame
    of_map, of_prior = (
        TURN if {own, frame} == {"LPS", "RAS"} else np.eye(len(estimate.T_map_prior))
        for own in (case.frame, prior_frame)
    )
    return np.asarray(of_map @ estimate.T_map_prior @ of_prior)
