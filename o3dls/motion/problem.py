"""One round of fitting the motion T of the prior: feet, posterior, belief; and what stays fixed between the
rounds.

Where on the moved surface each point may have come from (`feet`), and how far along the normal; posterior of
the field (`covariance`, `evidence`); each point's residual to the fit without it decides how far it is
believed (`outliers`). Reasons and numbers: docs/method.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from ..arrays import Array, Ints
from ..geometry.closest_point import ClosestPoint
from ..geometry.differential import unit_mean, vertex_normals
from ..geometry.fairing import fair, roughness
from ..geometry.fold_repair import unfold
from ..geometry.similarity import apply, principal_frame, rms_radius
from ..noise.contact import LEAST, Contact, believe, density, mixture_energy, say
from ..noise.mixture import fit_mixture
from ..noise.robust import spread
from .correspondence import likely_feet
from .covariance import Covariance, Observed, Places, displacement, grams, interpolation
from .marginal_likelihood import Posterior, Scales, assemble, free_energy, left_out, misfit, solve, tune
from .motion import Motion
from .observations import Data, Feet, Rows, gather, points_left_out
from .result import MotionFit, State
from .settings import Settings

Faired = tuple[float, Array]  # a length and the vertices (n, d) of the posed prior smoothed over it


# shortest correlation lengths: where points share rows, smaller patches change little (docs/method.md) but
# the time
PATCH = 0.4


LATE = 1000  # number of a round that continues an earlier fit


SETTLED = 5  # rounds in which amplitudes grow and noise shrinks: steps are large on purpose


# share of noise in the residuals of the start: at first, and the most, since some motion there is
NOISE, MOST_NOISE = (
    0.7,
    0.95,
)


# the posterior takes feet, normals and amplitudes as known: measured on development seeds, docs/method.md
INFLATION = 1.3


@dataclass(frozen=True, eq=False)
class Problem:
    """What stays fixed during a fit: the posed surface, its nodes, the data, the covariance."""

    vertices: Array
    faces: Ints
    pose: Array
    rest: Places  # the vertices in the reference pose,
    faired: float  # and over what length they were smoothed there (0: not at all)
    rough: Array  # what roughness they have there, over settings.broad
    data: Data
    marks: Array  # landmarks of the prior in the reference pose
    covariance: Covariance
    settings: Settings
    size: float
    tree: ClosestPoint
    nodes: Ints
    spread: sparse.csr_matrix  # from nodes to vertices

    @staticmethod
    def make(
        vertices: Array,
        faces: Ints,
        pose: Array,
        data: Data,
        settings: Settings,
        faired: Faired | None = None,
    ) -> Problem:
        posed = apply(pose, vertices)
        centre = posed.mean(axis=0)
        size = rms_radius(posed)
        lengths = [tuple(size * x for x in group) for group in (settings.vector, settings.normal)]
        marks = apply(pose, data.marks_prior)
        up = None if data.up is None else pose[:-1, :-1] @ data.up / np.linalg.norm(pose[:-1, :-1] @ data.up)
        cov = Covariance(
            centre, lengths[0], lengths[1], size, marks, size * settings.anchor_length, 0.2 * size, up
        )
        length, at = faired or (0.0, posed)
        nodes = _spaced(at, 0.27 * min(lengths[0] + lengths[1]))
        spread = interpolation(at[nodes], at, min(lengths[0] + lengths[1]))
        rough = roughness(at, faces, size * settings.broad)
        rest = Places(at, vertex_normals(fair(at, rough, vertex_normals(at, faces)), faces))
        return Problem(
            vertices,
            faces,
            pose,
            rest,
            length,
            rough,
            data,
            marks,
            cov,
            settings,
            size,
            ClosestPoint(at, faces),
            nodes,
            spread,
        )

    @cached_property
    def frame(self) -> Array:
        """The prior's own axes (d+1, d+1), for what must not depend on those of the map."""
        return principal_frame(self.rest.at)

    @cached_property
    def residual(self) -> float:
        """Standard deviation of the points' distances from the posed surface, by their median so that
        outliers have no say.
        """
        distances = self.tree.at(self.rest.at).distance(self.data.points[~self.data.inside])
        return max(spread(distances), 1e-4 * self.size)

    def expected(self, share: float) -> Array:
        """Logarithms of amplitudes and noise levels that are usual where noise makes up a `share` of the
        residual: motion is the rest.
        """
        s, rms = self.settings, self.residual
        motion = float(np.sqrt((1.0 - min(share, MOST_NOISE) ** 2) / (1.0 - NOISE**2)))
        moved = motion * rms
        upright = self.covariance.up is not None
        amplitudes = [s.vector_amplitude * moved / 2**k for k in range(len(s.vector))]
        amplitudes += [s.normal_amplitude * moved / 2**k for k in range(len(s.normal))]
        amplitudes += [s.bend_amplitude * moved / self.size / (1 + upright), s.strain * motion]
        amplitudes += [s.tilt_amplitude * moved / self.size] * upright + [s.anchor_amplitude * moved] * (
            len(self.marks) > 0
        )
        noises = [NOISE * rms] * self.data.groups + [s.landmark_noise * self.size] * (len(self.marks) > 0)
        return np.asarray(np.log(amplitudes + noises))

    def start(self) -> State:
        """Amplitudes and noise in proportion to the residuals of the start pose, beliefs by them."""
        s = self.settings
        log = self.expected(NOISE)
        fields = len(s.vector) + len(s.normal)
        anchors = int(len(self.marks) > 0)
        whole = 2 + (self.covariance.up is not None)
        noises = self.data.groups + anchors
        spread = s.spread * np.repeat(
            [1.0, s.whole_spread, s.anchor_spread, s.noise_spread], [fields, whole, anchors, noises]
        )
        least = np.r_[np.full(len(log) - noises, -np.inf), np.full(noises, np.log(s.finest * self.size))]
        scales = Scales(log, log, spread, least, len(log) - noises)
        return State(
            self.rest.at, self.rest.at, 1.0, scales, Contact(depth=s.depth * self.size), self.first_beliefs
        )

    @cached_property
    def first_beliefs(self) -> Array:
        """Belief (n,) in points by their distance from the posed surface: many that float together would draw
        a wall that trusted them.
        """
        weights = self.data.trusted
        wall = ~self.data.inside
        points = self.data.points[wall]
        _, face, foot, bary = self.tree.at(self.rest.at).query(points)
        outward = (points - foot) * unit_mean(self.rest.normals, self.faces[face], bary)
        touching = np.maximum(fit_mixture(outward.sum(axis=1), self.size).weights, LEAST)
        weights[wall] = touching / (touching + (1.0 - touching) * self.data.odds[wall])
        return weights

    def step(
        self, state: State, iteration: int, *, tuning: bool
    ) -> tuple[State, tuple[Rows, Posterior], dict[str, float]]:
        """One round of foot points, posterior and belief; early rounds are held stiff and trust points
        less.
        """
        feet = self.feet(state, _widening(iteration))
        rows = self.rows(feet, state)
        fixed, parts = grams(self.covariance, rows.observed)
        scales = state.scales
        if tuning:
            scales = replace(scales, centre=self.expected(float(scales.noises[0]) / self.residual))
            scales = replace(scales, log=tune(scales, fixed, parts, rows))
        log = scales.log + _annealed(iteration, scales, self.data.groups)
        matrix, noise = assemble(log, fixed, parts, rows)
        posterior, _ = solve(matrix, rows.residual)
        moved = self.rest.at + self.spread_from_nodes(np.exp(log[: scales.fields]), rows.observed, posterior)
        noises = np.exp(log[scales.fields :])
        residual, var = points_left_out(
            rows, feet, state.weights, noise, *left_out(posterior, noise), noises, self.data
        )
        weights, contact = self.believe(state, residual, var)
        told = misfit(posterior, log[scales.fields :], rows)
        complexity = free_energy(posterior, log[scales.fields :], rows) - told
        labels = self.label_energy(state.weights, residual, contact, noises)
        step = float(np.linalg.norm(moved - state.feet_on, axis=1).mean())
        damping = _damping(state, step, iteration)
        feet_on = state.feet_on + damping * (moved - state.feet_on)
        record = {
            "energy": told + complexity + labels,
            "misfit": told,
            "complexity": complexity,
            "labels": labels,
        }
        record |= {"step": step, "sigma": float(scales.noises[0]), "off_wall": contact.share}
        patches = rows.of_point if iteration > max(self.settings.tune_at) else None
        return (
            State(feet_on, moved, damping, scales, contact, weights, patches, step),
            (rows, posterior),
            record,
        )

    def feet(self, state: State, widening: float = 1.0) -> Feet:
        """Where on the moved surface the points may have come from, by the noise levels of now times
        `widening`.
        """
        sd = widening * state.scales.noises[self.data.group] * self.data.relative
        return likely_feet(self.tree.at(state.feet_on), self.data.points, sd, self.rest)

    def rows(self, feet: Feet, state: State) -> Rows:
        patch = PATCH * min(self.covariance.lengths)
        most = self.settings.rows
        frame = self.frame if len(self.data.points) > most else None
        return gather(feet, self.data, state.weights, self.marks, most, patch, state.patches, frame)

    def believe(self, state: State, residual: Array, var: Array) -> tuple[Array, Contact]:
        """Belief per point; an `inside` point has a say only while the surface leaves it outside."""
        weights = np.zeros(len(residual))
        wall = ~self.data.inside
        weights[wall], contact = believe(residual[wall], var[wall], self.data.odds[wall], state.contact)
        touching, floating = density(residual[~wall], var[~wall], contact)
        belief = (
            touching * (1.0 - contact.share) / (touching * (1.0 - contact.share) + floating * contact.share)
        )
        outside = (residual[~wall] > 0.0) & (belief > 0.5)
        weights[~wall] = belief * say(self.data.points[~wall], outside, self.size)
        # points at the wall come and go
        weights[~wall] = state.weights[~wall] + state.damping * (weights - state.weights)[~wall]
        return weights, contact

    def label_energy(self, weights: Array, residual: Array, contact: Contact, noises: Array) -> float:
        """What the beliefs `weights`, which the rows were gathered with, cost; a bound from one side is a
        ratio, not a density.
        """
        data = self.data
        wall = ~self.data.inside
        density = -np.log(np.sqrt(2.0 * np.pi) * noises[data.group] * data.relative)
        return mixture_energy(weights[wall], residual[wall], data.odds[wall], contact) + float(
            weights[~wall] @ density[~wall]
        )

    @cached_property
    def at_nodes(self) -> Places:
        at = self.rest.at[self.nodes]
        return Places(at, self.rest.normals[self.nodes], self.covariance.features(at))

    def spread_from_nodes(self, sds: Array, observed: Observed, posterior: Posterior) -> Array:
        """Displacement (n, d) of every vertex, interpolated from nodes that stand close together against the
        shortest length.
        """
        field = displacement(self.covariance, sds, observed, posterior.alpha, self.at_nodes)
        return np.asarray(self.spread @ field)

    def off_wall(self, state: State) -> float:
        """Share of the points that is not believed to touch, of those that may."""
        return float(1.0 - state.weights[~self.data.inside].mean())

    def facts(self, state: State) -> dict[str, float]:
        names = [f"vector_{x:.3g}" for x in self.covariance.vector] + [
            f"normal_{x:.3g}" for x in self.covariance.normal
        ]
        names += (
            ["bend", "strain"]
            + ["tilt"] * (self.covariance.up is not None)
            + ["anchors"] * (len(self.marks) > 0)
        )
        facts = {f"amplitude_{name}": float(sd) for name, sd in zip(names, state.scales.sds, strict=True)}
        facts |= {"off_wall": self.off_wall(state), "persistence": state.contact.persistence}
        noises = ["ablation_noise"] * (self.data.groups > 1) + ["landmark_noise"] * (len(self.marks) > 0)
        facts |= {name: float(noise) for name, noise in zip(noises, state.scales.noises[1:], strict=True)}
        return facts


@dataclass(frozen=True, eq=False)
class Run:
    """What rounds solved, how they went, how far the last one moved the surface (mean; from nothing along its
    normals only), and what else is to be known of them.
    """

    problem: Problem
    state: State
    solved: tuple[Rows, Posterior]
    trace: list[dict[str, float]]
    moving: float
    facts: Mapping[str, float] = field(default_factory=dict)

    @property
    def energy(self) -> float:
        return self.trace[-1]["energy"]

    def result(self, share: float, alone: Array, least: float) -> MotionFit:
        """What was found: `share` of the motion is shown, and the pose `alone` stands for the rest
        (`Motion`); the surface stands still where it moved by less than `least`.
        """
        problem, state, (rows, posterior) = self.problem, self.state, self.solved
        fitted = problem.covariance, state.scales.sds, rows.observed, posterior
        motion = Motion(
            problem.vertices, problem.faces, problem.pose, problem.rest, *fitted, share, alone, INFLATION
        )
        now = vertex_normals(state.moved, problem.faces)[problem.nodes]
        sd = np.maximum(problem.spread @ motion.sd_in_reference(problem.at_nodes, now), 0.0)
        vertices = motion.mean(problem.rest.at, state.moved - problem.rest.at)
        folded = 0
        left = 0
        if problem.settings.unfold:
            vertices, folded, left = unfold(problem.rest.at, vertices, problem.faces)
        facts = (
            dict(self.facts)
            | problem.facts(state)
            | {"share": share, "faired": problem.faired, "moving": self.moving}
        )
        facts |= {"folded_faces": float(folded), "still_folded_faces": float(left)}
        return MotionFit(motion, vertices, state, sd, self.moving < least, tuple(self.trace), facts, problem)


def _damping(state: State, step: float, iteration: int) -> float:
    """Share of the next step that is taken: halved while steps do not shrink, since exact points can hold the
    feet in a cycle.
    """
    if iteration <= SETTLED:
        return 1.0
    return max(0.5 * state.damping, 0.125) if step > 0.9 * state.step else min(1.25 * state.damping, 1.0)


def _annealed(iteration: int, scales: Scales, groups: int) -> Array:
    """Change of the logarithms in the first rounds: amplitudes grow from .3 to 1, noise shrinks from 3 to
    1.
    """
    change = np.zeros(len(scales.log))
    change[: scales.fields] = np.log(min(1.0, 0.3 + 0.14 * iteration))
    change[scales.fields : scales.fields + groups] = np.log(_widening(iteration))
    return change


def _widening(iteration: int) -> float:
    """Factor on the noise in the first rounds: points pull from afar, and none decides alone."""
    return (3.0, 2.0, 1.5, 1.2, 1.0)[min(iteration, 4)]


def _spaced(points: Array, spacing: float) -> Ints:
    """Indices of points that stand about `spacing` apart: the one nearest to the middle of each occupied
    cell.
    """
    cells = np.floor((points - points.min(axis=0)) / spacing)
    middle = ((points - points.min(axis=0)) / spacing - cells - 0.5) ** 2
    order = np.lexsort((middle.sum(axis=1), *cells.T))
    first = np.r_[True, (np.diff(cells[order], axis=0) != 0).any(axis=1)]
    return np.asarray(np.sort(order[first]))
