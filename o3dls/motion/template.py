"""A temporal template: several surfaces of one patient span the shapes that the heart takes; points say where
between them it is.

x(v) = T (mean(v) + sum_j c_j m_j(v)): the modes m_j are the principal components of the phases, each of unit
variance, and the coefficients c lie about the way that leads through the phases in their order, as far aside
as a phase lies from its neighbours. Pose T and c are found together by Gauss-Newton on the points' distances
along the normals, outliers told by depth as in ICP.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import ROUNDING, TINY, Array, Ints
from ..geometry.closest_point import ClosestPoint
from ..geometry.differential import unit_mean, vertex_normals
from ..geometry.similarity import apply, rms_radius
from ..geometry.twist import Twist
from ..noise.mixture import fit_mixture
from .field.observations import Data
from .fit import fit_motion
from .settings import TemplateSettings

if TYPE_CHECKING:
    from .recorded import Motion


@dataclass(frozen=True, eq=False)
class Template:
    """A template has the mean (n, d) of the phases with their modes (k, n, d), the coefficients (phases, k)
    of the phases, and how far off the way through them a phase of its own may lie, by mode (k,).
    """

    mean: Array
    modes: Array
    coefficients: Array
    faces: Ints
    settings: TemplateSettings

    def shape(self, c: Array) -> Array:
        """Return the vertices (n, d) for coefficients (k,)."""
        return np.asarray(self.mean + np.tensordot(c, self.modes, axes=1))

    @cached_property
    def aside(self) -> Array:
        """Deviation (k,) of a phase from the middle between its neighbours; a tenth of all where there are
        too few to tell.
        """
        if len(self.coefficients) < self.settings.few_phases:
            return np.full(self.coefficients.shape[1], self.settings.aside)
        bend = self.coefficients[1:-1] - (self.coefficients[:-2] + self.coefficients[2:]) / 2.0
        # a phase's own deviation has 1 / 1.5 of that variance
        return np.asarray(np.sqrt((bend**2).mean(axis=0) / 1.5) + self.settings.least_aside)

    def between(self, c: Array) -> float:
        """Return the place on the way through the phases nearest to coefficients (k,): 2.25 is a quarter of
        the way from phase 2 to phase 3.
        """
        scaled = self.coefficients / self.aside
        start = scaled[:-1]
        way = np.diff(scaled, axis=0)
        along = np.clip(
            ((c / self.aside - start) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), TINY), 0.0, 1.0
        )
        nearest = int(np.argmin(np.linalg.norm(c / self.aside - start - along[:, None] * way, axis=1)))
        return nearest + float(along[nearest])

    def at(self, place: float) -> Array:
        """Return the coefficients (k,) at a place on the way."""
        before = min(int(place), len(self.coefficients) - 2)
        along = place - before
        return np.asarray((1.0 - along) * self.coefficients[before] + along * self.coefficients[before + 1])


def template(
    vertices: Array, faces: Ints, phases: Sequence[tuple[Array, Ints]], settings: TemplateSettings
) -> Template:
    """Return the template of a prior (vertices (n, d), faces) and further phases (vertices, faces) in its
    frame; the prior is the first phase.

    A phase with the prior's faces is the prior with its vertices moved; to any other the prior is registered.
    """
    same = [len(f) == len(faces) and bool((f == faces).all()) for _, f in phases]
    moved = (
        v if as_is else _register_phase(vertices, faces, v, settings.most_samples)
        for (v, _), as_is in zip(phases, same, strict=True)
    )
    shapes = np.stack([vertices, *moved])
    mean = shapes.mean(axis=0)
    left, size, modes = np.linalg.svd((shapes - mean).reshape(len(shapes), -1), full_matrices=False)
    kept = min(
        1 + int(np.searchsorted(np.cumsum(size**2), settings.variance * (size**2).sum())), len(shapes) - 1
    )
    root = np.sqrt(len(shapes) - 1)
    return Template(
        mean,
        (size[:kept] / root)[:, None, None] * modes[:kept].reshape(-1, *mean.shape),
        left[:, :kept] * root,
        faces,
        settings,
    )


def _register_phase(vertices: Array, faces: Ints, phase: Array, most: int) -> Array:
    """Move the prior's vertices (n, d) onto a phase, by our own motion field."""
    points = phase[:: max(1, len(phase) // most)]
    count, dim = points.shape
    none = np.zeros((0, dim))
    data = Data(
        points,
        np.zeros(count, dtype=np.int64),
        np.ones(count),
        np.ones(count),
        np.zeros(count, dtype=bool),
        none,
        none,
    )
    return fit_motion(vertices, faces, np.eye(dim + 1), data).state.moved


@dataclass(frozen=True, eq=False)
class Between:
    """This says where between the phases points lie: coefficients (k,), pose, noise, history, and whether the
    surface came to rest.
    """

    c: Array
    pose: Array
    sigma: float
    trace: tuple[Mapping[str, float], ...] = ()
    converged: bool = False


def locate(model: Template, pose: Array, points: Array) -> Between:
    """Return the coefficients and rigid pose for points (n, d), from a start pose (d+1, d+1): every phase is
    tried, the one that fits best refined.

    The start pose may be off by `settings.pose_sd` per axis; turns move the surface as far.
    """
    problem = _Points(model, points, ClosestPoint(apply(pose, model.mean), model.faces), pose)
    tried = [
        problem.refined(Between(c, pose, np.inf), model.settings.trial_iterations) for c in model.coefficients
    ]
    return problem.refined(min(tried, key=lambda one: one.sigma), model.settings.iterations)


@dataclass(frozen=True, eq=False)
class _Points:
    """This compares the points (n, d) with the template."""

    model: Template
    points: Array
    tree: ClosestPoint
    start: Array

    @cached_property
    def size(self) -> float:
        return rms_radius(self.model.mean)

    def refined(self, found: Between, iterations: int) -> Between:
        here = apply(found.pose, self.model.shape(found.c))
        for _ in range(iterations):
            found = self.step(found, self.tree.at(here))
            before = here
            here = apply(found.pose, self.model.shape(found.c))
            step = float(np.abs(here - before).max())
            found = replace(found, trace=(*found.trace, {"sigma": found.sigma, "step": step}))
            if step < self.model.settings.settled * self.size:
                return replace(found, converged=True)
        return found

    def step(self, now: Between, surface: ClosestPoint) -> Between:
        """Make one Gauss-Newton step in coefficients and pose, from the surface as it is; coefficients are
        drawn to the way through the phases.
        """
        model = self.model
        k = len(now.c)
        _, face, foot, bary = surface.query(self.points)
        corners = model.faces[face]
        normals = unit_mean(vertex_normals(surface.vertices, model.faces), corners, bary)
        residual = ((self.points - foot) * normals).sum(axis=1)
        mixture = fit_mixture(residual, self.size)
        turned = np.einsum("kncd,nc->knd", model.modes[:, corners], bary) @ now.pose[:-1, :-1].T
        middle = apply(now.pose, model.mean).mean(axis=0)
        twist = Twist(model.mean.shape[1])
        matrix = np.hstack(
            [
                np.einsum("knd,nd->nk", turned, normals),
                np.einsum("nd,ndk->nk", normals, twist.tangent(foot, middle)),
            ]
        )
        weights = mixture.weights / mixture.sigma**2
        inverse = matrix.T @ (weights[:, None] * matrix)
        right = matrix.T @ (weights * residual)
        towards, hold = self.prior(now.c)
        inverse[:k, :k] += hold
        right[:k] += hold @ (towards - now.c)
        firm = np.repeat([1.0, self.size], [twist.d, twist.size - twist.d]) / self.model.settings.pose_sd
        inverse[k:, k:] += np.diag(firm**2)
        right[k:] -= firm**2 * self.off(now.pose, middle)
        change = np.linalg.lstsq(inverse, right, rcond=ROUNDING)[0]
        return replace(
            now, c=now.c + change[:k], pose=twist.motion(change[k:], middle) @ now.pose, sigma=mixture.sigma
        )

    def off(self, pose: Array, middle: Array) -> Array:
        """Return the shift and turn of a pose against the start's."""
        made = pose @ np.linalg.inv(self.start)
        skew = (made - made.T)[:-1, :-1] / 2.0
        turn = [skew[1, 0]] if len(skew) == 2 else [skew[2, 1], skew[0, 2], skew[1, 0]]
        return np.concatenate([middle - apply(np.linalg.inv(made), middle[None])[0], turn])

    def prior(self, c: Array) -> tuple[Array, Array]:
        """Return where coefficients are pulled to, and how strongly (k, k): firmly across the way, and along
        it as one phase from the next.
        """
        place = self.model.between(c)
        before = min(int(place), len(self.model.coefficients) - 2)
        way = self.model.coefficients[before + 1] - self.model.coefficients[before]
        covariance = np.diag(self.model.aside**2) + np.outer(way, way)
        return self.model.at(place), np.asarray(np.linalg.inv(covariance))


@dataclass(frozen=True, eq=False)
class Shift:
    """A shift leads from the prior to the template's shape: places go along with the vertices (n, d) nearest
    to them, which move by `by` (n, d).
    """

    tree: ClosestPoint  # of the prior
    faces: Ints
    by: Array

    def __call__(self, points: Array) -> Array:
        _, face, _, bary = self.tree.query(points)
        return np.asarray(points + np.einsum("nc,ncd->nd", bary, self.by[self.faces[face]]))


@dataclass(frozen=True, eq=False)
class Chain:
    """A chain applies the prior's shift to the template's shape, then the motion fitted from there
    (estimate.Motion).
    """

    first: Shift
    then: Motion

    def __call__(self, points: Array) -> Array:
        return self.then(self.first(points))

    def sd(self, points: Array, normals: Array) -> Array:
        return self.then.sd(self.first(points), normals)
