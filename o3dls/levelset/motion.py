"""The motion T of the prior as a function of points, with its posterior, and the record of how it was fitted (`fit`)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..geometry import Array, Ints, apply, fit_similarity
from .closest import ClosestPoint
from .covariance import Covariance, Observed, Places, cross, displacement, variance
from .evidence import Posterior, Scales, posterior_variance
from .outliers import Contact
from .shape import unit_mean

if TYPE_CHECKING:
    from .problem import Problem


@dataclass(frozen=True, eq=False)
class Motion:
    """The fitted motion, prior frame to map frame, as a function of points with its posterior deviation (estimate.Motion).

    share is the posterior probability that the points show a motion at all: so far the field is followed, and for the rest the similarity
    `alone` (d+1, d+1), from the reference pose to where it would be without a motion, so that points which cannot tell a motion from
    noise leave the prior its shape. inflation calibrates the deviation (docs/method.md).
    """

    vertices: Array  # of the prior, in its own frame
    faces: Ints
    T_map_prior: Array  # the reference pose,
    rest: Places  # and the vertices in it, from which the field displaces: faired where the points show the prior to be rough
    covariance: Covariance
    sds: Array
    observed: Observed
    posterior: Posterior
    share: float
    alone: Array
    inflation: float

    def __call__(self, points: Array) -> Array:
        places = self._reference(points)
        return self.mean(places.at, self._field(places))

    def mean(self, at: Array, field: Array) -> Array:
        """Where places (n, d) of the reference pose went that the field would displace by (n, d)."""
        return at + self.share * field + (1.0 - self.share) * self._pose_alone(at)

    def sd(self, points: Array, normals: Array) -> Array:
        """Posterior standard deviation (n,) along unit `normals` (map frame) of where points (n, d) of the prior frame went."""
        return self.sd_in_reference(self._reference(points), normals)

    def sd_in_reference(self, places: Places, normals: Array) -> Array:
        """The same for places that are known in the reference pose."""
        asked = places.observed(normals)
        crossed = cross(self.covariance, self.sds, self.observed, asked)
        var = posterior_variance(self.posterior.factor, variance(self.covariance, self.sds, asked), crossed)
        # what is not shown may still be so: the deviation is that of the motion from where the surface is left
        beyond = 0.0 if self.share == 1.0 else ((self._field(places) - self._pose_alone(places.at)) * normals).sum(axis=1)
        held_back = (1.0 - self.share) * beyond
        return self.inflation * np.sqrt(var + held_back**2)

    def _field(self, places: Places) -> Array:
        return displacement(self.covariance, self.sds, self.observed, self.posterior.alpha, places)

    def _pose_alone(self, at: Array) -> Array:
        return apply(self.alone, at) - at

    @cached_property
    def _tree(self) -> ClosestPoint:
        return ClosestPoint(self.vertices, self.faces)

    def _reference(self, points: Array) -> Places:
        """Positions in the reference pose, shifted as the surface nearest to them was, and that surface's normals."""
        _, face, _, bary = self._tree.query(points)
        corner = self.faces[face]
        shift = (self.rest.at - apply(self.T_map_prior, self.vertices))[corner]
        at = apply(self.T_map_prior, points) + np.einsum("nc,ncd->nd", bary, shift)
        return Places(at, unit_mean(self.rest.normals, corner, bary))


@dataclass(frozen=True, eq=False)
class State:
    """What one iteration hands to the next: vertices (n, d) where feet are sought, as moved by the field, scales, mixture, belief.

    patches (k,): which row each point falls into, once that stays: points that change rows would keep the surface from standing still.
    """

    feet_on: Array
    moved: Array
    damping: float
    scales: Scales
    contact: Contact
    weights: Array
    patches: Ints | None = None
    step: float = np.inf


@dataclass(frozen=True, eq=False)
class MotionFit:
    """Result: the motion, moved vertices (n, d), their posterior deviation (n,), last state, and history.

    energy is the free energy in nats: lower is likelier, comparable between fits of the same points. The trace has its terms: what
    residuals cost, what the fields could have explained, and the beliefs.
    """

    motion: Motion
    vertices: Array
    state: State
    sd: Array
    converged: bool
    trace: tuple[dict[str, float], ...]
    facts: dict[str, float]
    problem: Problem  # what stayed fixed during the fit: a warm start takes it over

    @property
    def energy(self) -> float:
        return self.trace[-1]["energy"]

    def sentence(self, unit: str) -> str:
        """How it went, lengths in `unit`."""
        share, faired, moving = self.motion.share, self.facts["faired"], self.facts["moving"]
        on = f"stopped after {len(self.trace)} iterations while the surface still moved {moving:.2g} {unit} a round"
        said = ["converged" if self.converged else on]
        said += [f"noise {self.sigma:.3g} {unit}, {100 * self.facts['off_wall']:.0f} % of the points off the wall"]
        if share < 0.95:
            posed = "" if np.array_equal(self.motion.alone, np.eye(len(self.motion.alone))) else ", else the pose of points and landmarks"
            said += [f"the points show a motion beyond the pose with probability {share:.2f}, and the prior follows it that far{posed}"]
        if faired:
            said += [f"the points show the prior to be rough, so it was smoothed over {faired:.2g} {unit} before it was moved"]
        if odd := int(self.facts.get("let_go", 0)):
            said += [f"{odd} points that seemed to draw the wall out were let go until it stood without them"]
        if folded := int(self.facts["folded_faces"]):
            left = int(self.facts["still_folded_faces"])
            faces, were = ("face", "was") if folded == 1 else ("faces", "were")
            mended = f", of which {left} could not be mended" if left else f" and {were} mended from the surroundings"
            said += [f"{folded} {faces} folded over{mended}"]
        return "; ".join(said)

    @property
    def sigma(self) -> float:
        """Noise of the mapping points."""
        return float(self.state.scales.noises[0])

    @property
    def weights(self) -> Array:
        """Belief (k,) in each mapping point."""
        data = self.problem.data
        return np.asarray(self.state.weights[(data.group == 0) & ~data.inside if data.mapping is None else data.mapping])

    @property
    def similarity(self) -> Array:
        """Least-squares similarity (d+1, d+1) of the fitted motion."""
        return fit_similarity(self.motion.vertices, self.vertices)
