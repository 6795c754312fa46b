"""Two runs of one heart brought to one anatomy: the prior of the first, as it lies in both maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Array, Mask
from ...case import Case, Points
from ...errors import InputError
from ...estimate import Estimate
from ...evaluation.distances import moved
from ...evaluation.projection import project
from ...geometry.surface import Surface
from ...motion.posterior import wall_posterior
from ...motion.wall.posterior import WallPosterior
from ..subject import Subject

SAME = 1e-6  # diagonals: what files round
SEEN_AT = 1500  # places of a prior that another is registered to
BESIDE = 5.0  # mm: wall that one prior has and the other has not
STRANGE = 4.0  # mm rms: priors that stay so far apart are of two hearts


@dataclass(frozen=True, eq=False)
class InMap:
    """A prior in a map has where its motion brings the vertices (n, 3), samples of the errors (s, n, 3) of
    that, both in the map's frame, the matrix (3, 3) that turns the prior's directions to the map's, and
    which vertices (n,) the prior of the map has.
    """

    vertices: Array
    errors: Array
    turn: Array
    known: Mask

    @property
    def errors_on_prior(self) -> Array:
        """The errors in the frame of the prior."""
        return np.asarray(self.errors @ np.linalg.inv(self.turn).T)


def share_prior(first: Subject, second: Subject) -> bool:
    """Return whether two runs have the same prior."""
    a, b = first.case.prior, second.case.prior
    if not np.array_equal(a.faces, b.faces) or a.vertices.shape != b.vertices.shape:
        return False
    return bool(np.abs(a.vertices - b.vertices).max() <= SAME * a.diagonal)


def bring_together(subjects: Sequence[Subject], samples: int, seed: int) -> tuple[InMap, InMap, float | None]:
    """Return the prior of the first of two runs in both maps; and how far from it (mm rms) the second run's
    own prior stays once registered, None where it is the same.

    The errors of the registration of two priors are added to those of the second map. Raises InputError where
    a run has no posterior, or the priors are of two hearts.
    """
    first, second = subjects
    streams = np.random.default_rng((seed, 2)).spawn(3)
    prior = first.case.prior
    before = _place(first, prior.vertices, samples, streams[0])
    if share_prior(first, second):
        return before, _place(second, prior.vertices, samples, streams[1]), None
    link = _register(second.case, first.case)
    laid = second.case.prior.with_vertices(moved(link, second.case.prior.vertices))
    wall = project(prior.vertices, laid)
    apart = float(np.sqrt(prior.vertex_areas @ wall.distance**2 / prior.area))
    if apart > STRANGE:
        raise InputError(
            f"{second.folders[0]}: its prior stays {apart:.1f} mm rms from that of {first.folders[0]}: both "
            "must be of one heart and one chamber"
        )
    corners = second.case.prior.faces[wall.face]
    own = np.einsum("nc,ncd->nd", wall.weights, second.case.prior.vertices[corners])
    after = _place(second, own, samples, streams[1])
    turn = after.turn @ np.linalg.inv(link.T_map_prior[:3, :3])
    more = _posterior_of(second, link).at(prior.vertices).draw(samples, streams[2]) @ turn.T
    return before, replace(after, errors=after.errors + more, turn=turn, known=wall.distance <= BESIDE), apart


def _place(subject: Subject, at: Array, samples: int, rng: np.random.Generator) -> InMap:
    """Return places (n, 3) of a run's own prior in its map."""
    estimate = subject.last.estimate
    found = moved(estimate, at)
    errors = _posterior_of(subject, estimate).at(found).draw(samples, rng)
    return InMap(found, errors, estimate.T_map_prior[:3, :3], np.ones(len(at), dtype=bool))


def _posterior_of(subject: Subject, estimate: Estimate) -> WallPosterior:
    found = wall_posterior(estimate.motion)
    if found is None:
        raise InputError(
            f"{subject.folders[0]}: has no posterior in space; run a pipeline with the stage 'deform' again, "
            "with this version"
        )
    return found


def _register(case: Case, other: Case) -> Estimate:
    """Register the prior of a case to that of another, as to a map of it."""
    from ...geometry.spread import spread
    from ...pipeline.file import default_pipeline
    from ...pipeline.pipeline import Pipeline

    at = other.prior.vertices[spread(other.prior.vertices, SEEN_AT)]
    marks = np.array(list(other.prior_landmarks.values())).reshape(-1, 3)
    names = np.array([""] * len(at) + list(other.prior_landmarks))
    kind = np.repeat(["eam", "landmark"], [len(at), len(marks)])
    points = Points(np.vstack([at, marks]), kind, {"name": names})
    asked = Case("priors", Surface(case.prior.vertices, case.prior.faces), points, case.prior_landmarks)
    estimates = Pipeline(default_pipeline().allowed_by(asked).stages, folds=0).fit(asked)
    return next(one for one in reversed(estimates.values()) if one.motion is not None)
