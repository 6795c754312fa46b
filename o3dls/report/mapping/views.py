"""From where the pictures look: along the patient's axes where they are known, else along the prior's own.

They are known from a frame that is named (LPS or RAS), of the points or of the prior, or from veins that are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...arrays import Array
from ...registration.landmark_names import partners
from ..subject import Subject

CORNERS = ("LSPV", "RSPV", "LIPV", "RIPV")
SLANTED = 0.5  # sine of 30 degrees: veins that stand nearer a line do not tell up from left
OFF_POLE = 0.002  # a view along the body is tilted by so much, so that what is up is defined


@dataclass(frozen=True, eq=False)
class Orientation:
    """An orientation has unit directions (3,) in the map frame, at right angles, and what they are known by.

    They are the patient's left and front and up, or, where `patient` is false, the prior's x, -y and z, whose
    sides have numbers: words such as left would be taken for the patient's.
    """

    left: Array
    front: Array
    up: Array
    known_by: str
    patient: bool = True

    def looking(self, *, behind: bool = False) -> Array:
        """Return the axes right, up and towards the viewer (3, 3), seen from the front or from behind."""
        side = -1.0 if behind else 1.0
        return np.array([side * self.left, self.up, side * self.front])

    def views(self) -> dict[str, Array]:
        """Return the name of each standard view, and the direction (3,) from where it looks."""
        left, front, up = self.left, self.front, self.up
        if not self.patient:
            sides = (front, -front, left, -left, up + OFF_POLE * front, OFF_POLE * front - up)
            return {f"side {k}": at for k, at in enumerate(sides, 1)}
        turn = {"AP": front, "PA": -front, "LAO 45": front + left, "RAO 30": np.sqrt(3) * front - left}
        turn |= {"LL": left, "RL": -left}
        return turn | {"superior": up + OFF_POLE * front, "inferior": OFF_POLE * front - up}

    def faces(self) -> dict[str, str]:
        """Return the letter of each face of an orientation cube, opposite ones in turn, and the view that it
        faces.
        """
        if not self.patient:
            return {letter: f"side {letter}" for letter in "341256"}
        return {"L": "LL", "R": "RL", "A": "AP", "P": "PA", "S": "superior", "I": "inferior"}

    def sides(self) -> tuple[tuple[str, str], ...]:
        """Name what lies towards left, front and up, each with what lies opposite."""
        if not self.patient:
            return ("side 3", "side 4"), ("side 1", "side 2"), ("side 5", "side 6")
        return ("left", "right"), ("front", "back"), ("head", "feet")


def in_frame(frame: str, known_by: str = "", *, patient: bool = True) -> Orientation:
    """Return the patient's directions in LPS or RAS coordinates."""
    side = -1.0 if frame == "RAS" else 1.0  # of left in x, of posterior in y
    left, front, up = np.array([[side, 0, 0], [0, -side, 0], [0, 0, 1.0]])
    return Orientation(left, front, up, known_by, patient)


def orientation(subject: Subject) -> Orientation:
    """Find the patient's directions in the map frame by the first of what is known, else the prior's."""
    case = subject.case
    if case.frame != "unknown":
        return in_frame(case.frame, f"frame of the points, {case.frame}")
    pose = subject.last.estimate.T_map_prior
    if case.prior_frame != "unknown":
        known_by = f"frame of the prior, {case.prior_frame}, in the pose of {subject.last.name}"
        return _turn_directions(in_frame(case.prior_frame, known_by), pose)
    veins = by_veins(_named_landmarks(subject))
    own = "prior's own sides, opposite ones 1 and 2, 3 and 4, 5 and 6: the patient's axes are not known"
    return veins or _turn_directions(in_frame("LPS", own, patient=False), pose)


def _turn_directions(one: Orientation, pose: Array) -> Orientation:
    """Turn the directions to where a pose (4, 4), whose scale is the same everywhere, brings them."""
    turn = pose[:3, :3] / np.cbrt(np.linalg.det(pose[:3, :3]))
    return Orientation(turn @ one.left, turn @ one.front, turn @ one.up, one.known_by, one.patient)


def _named_landmarks(subject: Subject) -> dict[str, Array]:
    marks = subject.case.points.of("landmark")
    names = marks.columns.get("name", np.full(len(marks), ""))
    return {str(name): at for name, at in zip(names, marks.xyz, strict=True)}


def by_veins(landmarks: Mapping[str, Array]) -> Orientation | None:
    """Estimate the patient's directions: left from right veins to left, up from inferior to superior ones.

    None where there is no such pair, or where both lie nearly along one line.
    """
    found = partners(list(landmarks), CORNERS)
    at = {CORNERS[k]: landmarks[list(landmarks)[i]] for i, k in found.items()}
    left = _mean_step(at, (("RSPV", "LSPV"), ("RIPV", "LIPV")))
    up = _mean_step(at, (("LIPV", "LSPV"), ("RIPV", "RSPV")))
    if left is None or up is None:
        return None
    up = up - (up @ left) * left
    if np.linalg.norm(up) < SLANTED:
        return None
    up = up / np.linalg.norm(up)
    return Orientation(left, np.cross(left, up), up, "named veins: about the patient's axes")


def _mean_step(at: Mapping[str, Array], pairs: tuple[tuple[str, str], ...]) -> Array | None:
    """Return the unit direction (3,) from the first to the second of each pair that is there."""
    steps = [at[there] - at[here] for here, there in pairs if here in at and there in at]
    step = np.sum(steps, axis=0) if steps else np.zeros(3)
    length = np.linalg.norm(step)
    return np.asarray(step / length) if length > 0 else None
