"""Where a session stands, as the event `state` says it: errors expected, places to touch next, warnings."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..evaluation.interpolation import REACH
from ..evaluation.trusted_landmarks import contradicted
from ..geometry.cut_wall import on_cut
from ..geometry.surface import Surface
from ..registration.landmarks import leave_one_out
from ..report.expected import expected_of
from ..report.grading.landmarks import FAR_LANDMARK
from ..report.mapping.advice import located
from ..report.mapping.wall_regions import advised
from ..report.surfaces.display import decimated
from .display import subject_of
from .messages import Message, number

PLACES = 3  # places to propose
FACES = 4_000  # of the surface by which they are chosen: its vertices are 5 mm apart on an atrium
MOST_HISTORY = 300  # entries; where there are more, every other of the older half goes


class Advisor:
    """The advisor chooses the places of one prior that are best to touch next, on a copy of it with few
    faces.
    """

    def __init__(self, prior: Surface) -> None:
        self.prior = decimated(replace(prior, fields={}), FACES, FACES)

    def __call__(self, case: Case, estimate: Estimate) -> Message:
        """Return the keys `next` and, where there are fewer than three places, `ended`, which says why."""
        if estimate.motion is None:
            return {"next": [], "ended": "there is no motion yet"}
        surface = self.prior.with_vertices(estimate.motion(self.prior.vertices))
        drawn, moved = replace(case, prior=self.prior), replace(estimate, surface=surface)
        try:
            found = advised(drawn, moved, PLACES)
        except InputError as error:
            return {"next": [], "ended": str(error)}
        places = [
            {
                "xyz": one.place.xyz.tolist(),
                "where": one.where,
                "before": one.place.before,
                "after": one.place.after,
                "gain": one.place.gain,
            }
            for one in located(subject_of(drawn, moved), found)
        ]
        return {"next": places, **({"ended": found.ended} if found.ended else {})}


@dataclass
class Standing:
    """The standing is what the event `state` says. expected: errors of the mapped wall and the rest; history:
    of them over the number of points.
    """

    points: int = 0
    fitted: int = 0
    expected: tuple[float | None, float | None] = (None, None)
    history: list[tuple[int, float | None, float | None]] = field(default_factory=list)
    advice: Message = field(default_factory=lambda: {"next": [], "ended": "there is no estimate yet"})
    warnings: list[dict[str, str]] = field(default_factory=list)
    known: int = 0  # points that the last full fit had
    doubts: list[dict[str, str]] = field(default_factory=list)  # of landmarks
    refusal: str = ""  # why the last full fit was refused
    status: str = ""
    fit: str = "idle"

    def judge(self, case: Case, estimate: Estimate, fitted: int) -> None:
        """Take in a new estimate."""
        self.fitted, self.status = fitted, estimate.status
        self.expected = expected(case, estimate)
        self.warnings = [
            {"code": one.code, "stage": one.stage, "kind": one.kind, "text": one.sentence}
            for one in estimate.warnings
        ]
        if self.history and self.history[-1][0] == fitted:
            self.history.pop()
        self.history.append((fitted, *self.expected))
        if len(self.history) > MOST_HISTORY:
            half = len(self.history) // 2
            self.history = self.history[:half:2] + self.history[half:]

    def judge_landmarks(self, case: Case) -> None:
        """Name the landmarks that lie far from where all others put them."""
        self.doubts = [
            {"code": "landmark-far", "stage": "landmarks", "text": text} for text in far_landmarks(case)
        ]

    def record(self) -> dict[str, Any]:
        """Return the content of the event `state`."""
        refusals = [{"code": "fit-refused", "stage": "live", "text": self.refusal}] if self.refusal else []
        return {
            "points": self.points,
            "fitted": self.fitted,
            "behind": max(0, self.points - self.known) if self.known else 0,
            "mapped_mm": self.expected[0],
            "unmapped_mm": self.expected[1],
            "history": [list(one) for one in self.history],
            **self.advice,
            "warnings": [*self.warnings, *self.doubts, *refusals],
            "status": self.status,
            "fit": self.fit,
        }


def far_landmarks(case: Case) -> list[str]:
    """Say of each landmark pair by how much it lies too far from where the fit to the others puts it; where
    one of them explains that of all, of that one alone.
    """
    names, prior, measured = case.landmark_pairs()
    if len(names) < 2:
        return []
    gaps = leave_one_out(prior, measured, np.ones(len(names)), scale=False)
    odd = contradicted(case)
    order = [odd] if odd is not None else np.flatnonzero(np.nan_to_num(gaps) > FAR_LANDMARK).tolist()
    return [
        f"{names[k]} lies {gaps[k]:.1f} {case.units} from where the others put it: was it marked there?"
        for k in order
    ]


def expected(case: Case, estimate: Estimate) -> tuple[float | None, float | None]:
    """Return errors that the posterior expects of the wall near points and of the rest; None where there is
    none.
    """
    surface = estimate.surface
    points = case.points.of("eam").xyz
    if not len(points):
        return None, None
    gap = np.asarray(cKDTree(points).query(surface.vertices)[0])
    far = np.asarray((gap > REACH) | on_cut(surface), dtype=np.float64)
    found = expected_of(replace(surface, fields={**surface.fields, "prior_only": far}), case.units)
    return (None, None) if found is None else (number(found.mapped), number(found.prior_only))
