"""What a fit of the motion gives: motion, surface, deviation, history, and how it went in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Array
from ..geometry.differential import vertex_normals
from ..geometry.fold_repair import repair_folds
from ..geometry.similarity import fit_similarity
from .field.drift import Drift
from .iteration import Solved, State
from .motion import FittedMotion
from .problem import MotionProblem

PROBABLE = 0.95  # the status says of a motion less probable than this that it is followed in part


@dataclass(frozen=True, eq=False)
class Iterated:
    """This says where iterations of a problem have come to: the last state and system, the history, how far
    the last round moved the surface (mean along its normals), and what else is to be known.
    """

    problem: MotionProblem
    state: State
    solved: Solved
    trace: tuple[dict[str, float], ...]
    moving: float
    facts: Mapping[str, float] = field(default_factory=dict)

    @property
    def energy(self) -> float:
        return self.trace[-1]["energy"]


@dataclass(frozen=True, eq=False)
class MotionFit:
    """A fit has the motion, moved vertices (n, d), their posterior deviation (n,), last state, and history.

    energy is the free energy in nats: lower is likelier, comparable between fits of the same points. The
    trace has its terms: what residuals cost, what the fields could have explained, and the labels.
    """

    motion: FittedMotion
    vertices: Array
    state: State
    sd: Array
    converged: bool
    trace: tuple[dict[str, float], ...]
    facts: dict[str, float]
    problem: MotionProblem  # what stayed fixed during the fit: a warm start takes it over
    drift: Drift | None = None  # errors that go together, where points show them

    @property
    def energy(self) -> float:
        return self.trace[-1]["energy"]

    @property
    def sigma(self) -> float:
        """Deviation of the mapping points' errors: their own noise, and what goes together."""
        return float(self.state.scales.errors(np.zeros(1, dtype=np.int64), np.ones(1))[0])

    @property
    def errors(self) -> Array:
        """Deviation (n,) of the errors of all points."""
        data = self.problem.data
        return self.state.scales.errors(data.group, data.relative)

    @property
    def gradient(self) -> float:
        """Root mean square gradient of the smooth fields, amplitudes over lengths: 0.05 to 0.19 in motions of
        one heart, 0.2 to 0.4 where a prior is bent into another.
        """
        lengths = self.problem.covariance.lengths
        return float(np.linalg.norm(self.state.scales.sds[: len(lengths)] / lengths))

    @property
    def weights(self) -> Array:
        """Probability of contact (k,) of each mapping point."""
        data = self.problem.data
        mapping = (data.group == 0) & ~data.inside if data.mapping is None else data.mapping
        return np.asarray(self.state.weights[mapping])

    @property
    def similarity(self) -> Array:
        """Least-squares similarity (d+1, d+1) of the fitted motion."""
        return fit_similarity(self.motion.vertices, self.vertices)


def motion_fit(run: Iterated, probability: float, pose_alone: Array, least: float) -> MotionFit:
    """Return what iterations found: the motion followed as far as its `probability`, and the pose alone for
    the rest; the surface stands still where it moved by less than `least`.
    """
    problem = run.problem
    state = run.state
    motion = FittedMotion(
        vertices=problem.vertices,
        faces=problem.faces,
        T_map_prior=problem.pose,
        rest=problem.rest,
        field=run.solved.field,
        probability=probability,
        pose_alone=pose_alone,
        inflation=problem.settings.inflation,
        tree=problem.tree,
    )
    normals = vertex_normals(state.moved, problem.faces)[problem.nodes]
    sd = np.maximum(problem.from_nodes @ motion.sd_in_reference(problem.at_nodes, normals), 0.0)
    vertices = motion.mean(problem.rest.at, state.moved - problem.rest.at)
    folded, left = 0, 0
    if problem.settings.iteration.repair_folds:
        vertices, folded, left = repair_folds(problem.rest.at, vertices, problem.faces)
    facts = dict(run.facts) | state_facts(problem, state)
    facts |= {
        "motion_probability": probability,
        "smoothing_length": problem.smoothing_length,
        "last_step": run.moving,
        "folded_faces": float(folded),
        "still_folded_faces": float(left),
    }
    drift = None
    if (taken := run.solved.rows.taken) is not None:
        found = run.solved.field
        drift = Drift(
            problem.settings.drift,
            state.scales.drift_sds,
            taken,
            found.observed.directions,
            found.solved,
        )
    return MotionFit(motion, vertices, state, sd, run.moving < least, run.trace, facts, problem, drift)


def state_facts(problem: MotionProblem, state: State) -> dict[str, float]:
    """Return the amplitudes and noise levels by name, and what was found of the outliers."""
    covariance = problem.covariance
    landmarks = len(problem.marks) > 0
    names = [f"vector_{x:.3g}" for x in covariance.vector] + [f"normal_{x:.3g}" for x in covariance.normal]
    names += ["bend", "strain"] + ["anchors"] * landmarks
    facts = {f"amplitude_{name}": float(sd) for name, sd in zip(names, state.scales.sds, strict=True)}
    wall = ~problem.data.inside
    facts |= {
        "outlier_fraction": float(1.0 - state.weights[wall].mean()),
        "persistence": state.contact.persistence,
    }
    if state.scales.drifts:
        named = zip(problem.settings.drift.names, state.scales.drift_sds, strict=True)
        facts |= {name: float(sd) for name, sd in named}
    noises = ["ablation_noise"] * (problem.data.groups > 1) + ["landmark_noise"] * landmarks
    return facts | {name: float(noise) for name, noise in zip(noises, state.scales.noises[1:], strict=True)}


def sentence(fit: MotionFit, unit: str, later: int = 0) -> str:
    """Return how a fit went, lengths in `unit`. later: points that were put in since, in a round that cannot
    converge.
    """
    facts = fit.facts
    probability = fit.motion.probability
    still = f"while the surface still moved by {facts['last_step']:.2g} {unit} per iteration"
    found = ["converged" if fit.converged else f"stopped after {len(fit.trace)} iterations, {still}"]
    if later:
        found = [f"updated with {later} point{'s' * (later > 1)} since the full fit"]
    together = float(np.linalg.norm(fit.state.scales.drift_sds))
    common = f", {together:.3g} {unit} of it common to points taken one after the other" if together else ""
    found += [f"noise {fit.sigma:.3g} {unit}{common}", f"share of outliers {facts['outlier_fraction']:.0%}"]
    if probability < PROBABLE:
        alone = fit.motion.pose_alone
        pose = (
            "the start pose"
            if np.array_equal(alone, np.eye(len(alone)))
            else "the pose of points and landmarks"
        )
        found += [
            f"the points do not show a motion beyond the pose for certain (probability {probability:.2f}): "
            f"the result lies between the motion that was fitted and {pose}"
        ]
    if length := facts["smoothing_length"]:
        found += [f"the prior is rougher than the wall and was smoothed over {length:.2g} {unit}"]
    if excluded := int(facts.get("excluded_points", 0)):
        found += [f"{excluded} points that seemed to pull the wall outward were left out at first"]
    if folded := int(facts["folded_faces"]):
        left = int(facts["still_folded_faces"])
        faces, were = ("face", "was") if folded == 1 else ("faces", "were")
        found += [f"{folded} folded {faces} {were} repaired" + (f", {left} remain" if left else "")]
    return "; ".join(found)
