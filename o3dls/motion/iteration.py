"""One round of fitting the motion: feet, posterior, who touches the wall; and how the first one begins.

Where on the moved surface each point may have come from (`correspondence`) and how far it lies along the
normal there; the posterior of the field (`marginal_likelihood`); each point's residual to the fit without it
decides how far it is believed (`noise.contact`). Reasons and numbers: docs/method.md.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Ints
from ..geometry.differential import vertex_normals
from ..noise.contact import Contact, contact_density, inside_point_weights, label_energy, update_contact
from .correspondence import likely_feet
from .covariance import cross, displacement, grams
from .marginal_likelihood import Posterior, Scales, free_energy, left_out, misfit, solve, tune, with_noise
from .observations import Data, Feet, Rows, gather, points_left_out
from .problem import MotionProblem
from .settings import IterationSettings


class Step(NamedTuple):
    """A step has vertices (n, d) where feet were sought, and by what (n, d) the field moves them on."""

    begun: Array
    change: Array


@dataclass(frozen=True, eq=False)
class State:
    """The state is what one round hands to the next: vertices (n, d) where feet are sought, and as moved by
    the field; amplitudes and noise levels; the mixture, and each point's probability of contact.

    patches (k,): which row each point falls into, once that stays: points that change rows would keep the
    surface from standing still. past: the last rounds, whose steps the next one is mixed with.
    """

    feet_on: Array
    moved: Array
    scales: Scales
    contact: Contact
    weights: Array
    patches: Ints | None = None
    past: tuple[Step, ...] = ()

    def without_history(self) -> State:
        """Return this state for other points or odds: without the rows and steps of earlier rounds."""
        return replace(self, patches=None, past=())


class Solved(NamedTuple):
    """This is the linear system of a round, solved, with its posterior."""

    rows: Rows
    posterior: Posterior


def begin(problem: MotionProblem) -> State:
    """Begin with amplitudes, noise and probabilities of contact by the residuals of the start pose."""
    settings = problem.settings.covariance
    log = expected_scales(problem, settings.noise_fraction)
    fields = len(settings.vector_lengths) + len(settings.normal_lengths)
    anchors = int(len(problem.marks) > 0)
    noises = problem.data.groups + anchors
    log_sd = np.repeat(
        [
            settings.field_log_sd,
            settings.field_log_sd * settings.mode_log_sd,
            settings.field_log_sd * settings.anchor_log_sd,
            settings.field_log_sd * settings.noise_log_sd,
        ],
        [fields, 2, anchors, noises],
    )
    least_noise = np.full(noises, np.log(settings.least_noise * problem.size))
    least = np.r_[np.full(len(log) - noises, -np.inf), least_noise]
    scales = Scales(log, log, log_sd, least, len(log) - noises)
    contact = Contact.expected(problem.size, problem.settings.contact)
    return State(problem.rest.at, problem.rest.at, scales, contact, problem.first_weights)


def step(
    problem: MotionProblem, state: State, iteration: int | None, *, tuning: bool = False
) -> tuple[State, Solved, dict[str, float]]:
    """Make one round of feet, posterior and contact; early ones are held stiff and trust points less.

    iteration: None where the fit goes on from an earlier one, and nothing is annealed.
    """
    settings = problem.settings.iteration
    # where on the surface each point may have come from, and what that says of the field
    feet = find_feet(problem, state, _noise_factor(iteration, settings))
    rows = gather_rows(problem, feet, state)
    # amplitudes and noise levels by the marginal likelihood
    scales = _tune_scales(problem, state.scales, rows) if tuning else state.scales
    log = scales.log + _anneal_scales(iteration, scales, problem.data.groups, settings)
    # the posterior of the field moves the surface
    sds = np.exp(log[: scales.fields])
    prior = cross(problem.covariance, sds, rows.observed, rows.observed)
    matrix, noise = with_noise(prior, log[scales.fields :], rows)
    solved = Solved(rows, solve(matrix, rows.residual)[0])
    moved = problem.rest.at + _displace_vertices(problem, sds, solved)
    # each point's residual to the fit without it says whether it touches the wall
    noises = np.exp(log[scales.fields :])
    alone = left_out(solved.posterior, noise)
    out = points_left_out(rows, feet, state.weights, noise, *alone, noises, problem.data)
    weights, contact = believe(problem, state, *out)
    record = _energy_terms(problem, state, solved, log[scales.fields :], out[0], contact)
    taken = Step(state.feet_on, moved - state.feet_on)
    # vertices may slide along a surface that stands still
    along = (taken.change * vertex_normals(state.feet_on, problem.faces)).sum(axis=1)
    length, fraction = float(np.abs(along).mean()), contact.outlier_fraction
    record |= {"step": length, "sigma": float(scales.noises[0]), "outlier_fraction": fraction}
    # feet are sought again on the way to there; another field has other steps
    early = iteration is not None and iteration < len(settings.noise_factors)
    past = () if early or tuning else state.past
    feet_on = mixed(taken, past, settings.longest_step)
    past = (*past, taken)[-settings.mixed_steps :]
    late = iteration is None or iteration > max(settings.tune_at)
    patches = rows.of_point if late else None
    return State(feet_on, moved, scales, contact, weights, patches, past), solved, record


def _tune_scales(problem: MotionProblem, scales: Scales, rows: Rows) -> Scales:
    """Tune amplitudes and noise levels to maximise the evidence, with priors by the current noise."""
    usual = expected_scales(problem, float(scales.noises[0]) / problem.residual_sd)
    s = problem.settings.covariance
    if problem.residual_sd < s.most_residuals * problem.size:
        # another heart's prior leaves large residuals, which are no sign of much noise
        points = slice(scales.fields, scales.fields + problem.data.groups)
        usual[points] = np.minimum(usual[points], np.log(s.most_usual_noise * problem.size))
    scales = replace(scales, prior_log=usual)
    parts = grams(problem.covariance, rows.observed)
    return replace(scales, log=tune(scales, *parts, rows, problem.settings.iteration))


def expected_scales(problem: MotionProblem, noise_fraction: float) -> Array:
    """Return the logarithms of the usual amplitudes and noise levels if noise makes up so much of the
    residuals of the start and motion the rest.
    """
    s = problem.settings.covariance
    rms = problem.residual_sd
    rest = 1.0 - min(noise_fraction, s.most_noise_fraction) ** 2
    motion = float(np.sqrt(rest / (1.0 - s.noise_fraction**2)))
    moved = motion * rms
    landmarks = len(problem.marks) > 0
    amplitudes = [s.vector_amplitude * moved / 2**k for k in range(len(s.vector_lengths))]
    amplitudes += [s.normal_amplitude * moved / 2**k for k in range(len(s.normal_lengths))]
    amplitudes += [s.bend_amplitude * moved / problem.size, s.strain_amplitude * motion]
    amplitudes += [s.anchor_amplitude * moved] * landmarks
    noises = [s.noise_fraction * rms] * problem.data.groups + [s.landmark_noise * problem.size] * landmarks
    return np.asarray(np.log(amplitudes + noises))


def find_feet(problem: MotionProblem, state: State, noise_factor: float = 1.0) -> Feet:
    """Return where on the moved surface the points may have come from, by the noise levels of now."""
    data = problem.data
    sd = noise_factor * state.scales.noises[data.group] * data.relative
    tree = problem.tree.at(state.feet_on)
    settings = problem.settings.iteration
    cutoff, resolution = settings.foot_cutoff, settings.foot_resolution
    return likely_feet(tree, data.points, sd, problem.rest, cutoff, resolution)


def gather_rows(problem: MotionProblem, feet: Feet, state: State) -> Rows:
    """Return the rows of the linear system: one for each point, or for each patch if points are many."""
    settings = problem.settings.iteration
    patch = settings.patch * min(problem.covariance.lengths)
    frame = problem.frame if len(problem.data.points) > settings.most_rows else None
    return gather(
        feet, problem.data, state.weights, problem.marks, settings.most_rows, patch, state.patches, frame
    )


def believe(problem: MotionProblem, state: State, residual: Array, variance: Array) -> tuple[Array, Contact]:
    """Return the probability of contact per point; an `inside` point counts only while the surface leaves it
    outside.
    """
    data = problem.data
    weights = np.zeros(len(residual))
    wall = ~data.inside
    weights[wall], contact = update_contact(
        residual[wall], variance[wall], data.outlier_odds[wall], state.contact
    )
    fraction = contact.outlier_fraction
    touching = (1.0 - fraction) * contact_density(residual[~wall], variance[~wall])
    floating = fraction * contact.outlier_density(residual[~wall])
    belief = touching / (touching + floating)
    outside = (residual[~wall] > 0.0) & (belief > 0.5)
    crowd = inside_point_weights(data.points[~wall], outside, problem.size, problem.settings.contact)
    # the weights of points at the wall keep changing
    before, part = state.weights[~wall], problem.settings.iteration.inside_step if state.past else 1.0
    weights[~wall] = before + part * (belief * crowd - before)
    return weights, contact


def contact_energy(data: Data, weights: Array, residual: Array, contact: Contact, noises: Array) -> float:
    """Return what the probabilities `weights`, with which the rows were gathered, cost; a bound from one side
    is a ratio, not a density.
    """
    wall = ~data.inside
    density = -np.log(np.sqrt(2.0 * np.pi) * noises[data.group] * data.relative)
    labels = label_energy(weights[wall], residual[wall], data.outlier_odds[wall], contact)
    return labels + float(weights[~wall] @ density[~wall])


def _energy_terms(
    problem: MotionProblem, state: State, solved: Solved, log_noise: Array, residual: Array, contact: Contact
) -> dict[str, float]:
    """Return the free energy and its terms: residuals, what the fields could have explained, labels."""
    data_misfit = misfit(solved.posterior, log_noise, solved.rows)
    complexity = free_energy(solved.posterior, log_noise, solved.rows) - data_misfit
    labels = contact_energy(problem.data, state.weights, residual, contact, np.exp(log_noise))
    terms = {"misfit": data_misfit, "complexity": complexity, "labels": labels}
    return {"energy": sum(terms.values()), **terms}


def _displace_vertices(problem: MotionProblem, sds: Array, solved: Solved) -> Array:
    """Return every vertex's displacement (n, d), interpolated from nodes closer than the shortest length."""
    rows, posterior = solved
    field = displacement(problem.covariance, sds, rows.observed, posterior.alpha, problem.at_nodes)
    return np.asarray(problem.from_nodes @ field)


def mixed(step: Step, past: tuple[Step, ...], longest: float) -> Array:
    """Return the vertices (n, d) to go on from: as if, of all mixtures of this step and the past ones, that
    were taken whose change is least (Anderson 1965); at most `longest` times the step away.
    """
    if not past:
        return step.begun + step.change
    less = np.array([(step.change - other.change).ravel() for other in past])
    way = np.array([(step.begun - other.begun).ravel() for other in past])
    gram = less @ less.T
    gram[np.diag_indices_from(gram)] += 1e-8 * np.trace(gram)  # equal changes make the matrix singular
    share = np.linalg.lstsq(gram, less @ step.change.ravel())[0]
    move = step.change - (share @ (way + less)).reshape(step.change.shape)
    length, limit = (float(np.linalg.norm(one)) for one in (move, longest * step.change))
    return np.asarray(step.begun + min(1.0, limit / max(length, 1e-300)) * move)


def _anneal_scales(iteration: int | None, scales: Scales, groups: int, settings: IterationSettings) -> Array:
    """Return the change of the logarithms in the first rounds: amplitudes grow to 1, noise shrinks to 1."""
    change = np.zeros(len(scales.log))
    if iteration is not None:
        grown = settings.first_amplitude + settings.amplitude_growth * iteration
        change[: scales.fields] = np.log(min(1.0, grown))
    change[scales.fields : scales.fields + groups] = np.log(_noise_factor(iteration, settings))
    return change


def _noise_factor(iteration: int | None, settings: IterationSettings) -> float:
    """Return the factor on the noise in the first rounds: points pull from afar, and none decides alone."""
    factors = settings.noise_factors
    return factors[-1] if iteration is None else factors[min(iteration, len(factors) - 1)]
