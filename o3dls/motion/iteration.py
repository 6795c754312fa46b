"""One round of fitting the motion: feet, posterior, who touches the wall; and how the first one begins.

Where on the moved surface each point may have come from (`correspondence`) and how far it lies along the
normal there; the posterior of the field (`marginal_likelihood`); each point's residual to the fit without it
decides how far it is believed (`noise.contact`). Reasons and numbers: docs/method_motion.md.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Ints
from ..geometry.differential import vertex_normals
from ..noise.contact import Contact, company_odds, contact_density, inside_point_weights, label_energy
from .field.covariance import FieldPrior
from .field.drift import Taken, grams
from .field.gaussian_process import FieldPosterior, solve
from .field.kernels import add_scaled
from .field.marginal_likelihood import Scales, free_energy, misfit, with_noise
from .field.observations import Feet, Rows, gather, number_patches, points_left_out
from .problem import MotionProblem
from .scales import annealed, first_scales, noise_factor, tune_scales


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
    """A solved round has its rows, the logarithms of their noise levels, the diagonal (k,) of their noise
    covariance, and the field that they make likely.
    """

    rows: Rows
    log_noise: Array
    noise: Array
    field: FieldPosterior


def begin(problem: MotionProblem) -> State:
    """Begin with amplitudes, noise and probabilities of contact by the residuals of the start pose."""
    contact = Contact.expected(problem.size, problem.settings.contact)
    return State(problem.rest.at, problem.rest.at, first_scales(problem), contact, problem.first_weights)


def step(
    problem: MotionProblem, state: State, iteration: int | None, *, tuning: bool = False
) -> tuple[State, Solved, dict[str, float]]:
    """Make one round: feet, amplitudes and noise levels, the field, who touches; early rounds are held stiff
    and trust points less. What a round is made of can be exchanged in its problem: `correspondence`,
    `covariance`, `contacts`.

    iteration: None where the fit goes on from an earlier one, and nothing is annealed.
    """
    settings = problem.settings.iteration
    feet = find_feet(problem, state, noise_factor(iteration, settings))
    rows = gather_rows(problem, feet, state)
    scales = tune_scales(problem, state.scales, rows) if tuning else state.scales
    solved = _solve_field(problem, scales, rows, annealed(iteration, scales, problem.data.groups, settings))
    residual, variance = _leave_points_out(problem, state, feet, solved)
    late = iteration is None or iteration > max(settings.tune_at)
    # a wall that is still on its way to a fold has points off it that are no company of floating ones
    weights, contact = believe(problem, state, residual, variance, company=late)
    record = _energy_terms(problem, state, solved, residual, contact)
    # every vertex's displacement, interpolated from nodes closer than the shortest correlation length
    moved = problem.rest.at + problem.from_nodes @ solved.field.mean(problem.at_nodes)
    taken = Step(state.feet_on, moved - state.feet_on)
    record |= {
        "step": _length_across(taken, problem.faces),
        "sigma": float(scales.noises[0]),
        "outlier_fraction": contact.outlier_fraction,
    }
    # feet are sought again on the way to there; another field has other steps
    early = iteration is not None and iteration < len(settings.noise_factors)
    past = () if early or tuning else state.past
    feet_on = mixed(taken, past, settings.longest_step)
    past = (*past, taken)[len(past) + 1 - settings.mixed_steps :]
    patches = rows.of_point if late else None
    return State(feet_on, moved, scales, contact, weights, patches, past), solved, record


def _solve_field(problem: MotionProblem, scales: Scales, rows: Rows, annealed: Array) -> Solved:
    """Solve for the field with scales whose logarithms are changed by `annealed`."""
    log = scales.log + annealed
    log_noise = log[scales.amplitudes :]
    prior = FieldPrior(problem.covariance, np.exp(log[: scales.fields]))
    matrix = prior.between(rows.observed, rows.observed)
    for sd, gram in zip(scales.drift_sds, rows.drift, strict=True):
        add_scaled(matrix, gram, sd**2)
    matrix, noise = with_noise(matrix, log_noise, rows)
    return Solved(
        rows, log_noise, noise, FieldPosterior(prior, rows.observed, solve(matrix, rows.residual)[0])
    )


def _leave_points_out(
    problem: MotionProblem, state: State, feet: Feet, solved: Solved
) -> tuple[Array, Array]:
    """Return each point's residual (n,) to the fit without it, and the variance (n,) to judge that by."""
    alone = solved.field.solved.left_out(solved.noise)
    own = problem.data.noise(np.exp(solved.log_noise))
    return points_left_out(solved.rows, feet, state.weights, solved.noise, alone, own)


def _length_across(taken: Step, faces: Ints) -> float:
    """Return the mean length of a step across the surface: vertices may slide along one that stands still."""
    return float(np.abs((taken.change * vertex_normals(taken.begun, faces)).sum(axis=1)).mean())


def find_feet(problem: MotionProblem, state: State, noise_factor: float = 1.0) -> Feet:
    """Return where on the moved surface the points may have come from, by the noise levels of now."""
    data = problem.data
    sd = noise_factor * state.scales.noises[data.group] * data.relative
    tree = problem.tree.at(state.feet_on)
    return problem.correspondence(tree, data.points, sd, problem.rest)


def gather_rows(problem: MotionProblem, feet: Feet, state: State) -> Rows:
    """Return the rows of the linear system: one for each point, or for each patch if points are many; where
    errors go together, for each patch and part of the order.
    """
    data, of_point = problem.data, state.patches
    if of_point is None and len(data.points) <= problem.settings.iteration.most_rows:
        of_point = np.arange(len(data.points))
    if of_point is None and state.scales.drifts:
        of_point = rows_in_order(problem, feet)
    if of_point is None:
        of_point = number_patches(feet, data.group, _patch_width(problem), problem.frame)
    rows = gather(feet, data, state.weights, problem.marks, of_point)
    if not state.scales.drifts:
        return rows
    place = data.place_in_order
    taken = Taken(np.bincount(rows.of_point, place) / np.bincount(rows.of_point), place, rows.of_point)
    return replace(rows, drift=grams(rows.observed.directions, taken, problem.settings.drift), taken=taken)


def rows_in_order(problem: MotionProblem, feet: Feet) -> Ints | None:
    """Return the row (n,) of each point: its own while they are few, else those of one patch of the surface
    that are taken one soon after the other share a row; None where these would be too many rows.
    """
    data, settings = problem.data, problem.settings.drift
    place = data.place_in_order
    if len(place) <= problem.settings.iteration.most_rows:
        return np.arange(len(place))
    part, wider = settings.block, 1.0
    while wider <= settings.widest:
        parts = (place // part).astype(np.int64)
        groups = data.group + data.groups * parts
        rows = number_patches(feet, groups, wider * _patch_width(problem), problem.frame)
        if rows.max() < settings.most_rows:
            return rows
        part, wider = settings.longer * part, settings.wider * wider
    return None


def _patch_width(problem: MotionProblem) -> float:
    return problem.settings.iteration.patch * float(min(problem.covariance.lengths))


def believe(
    problem: MotionProblem, state: State, residual: Array, variance: Array, *, company: bool = False
) -> tuple[Array, Contact]:
    """Return the probability of contact per point; an `inside` point counts only while the surface leaves it
    outside. company: whether neighbours that float tell of a point.
    """
    data = problem.data
    weights = np.zeros(len(residual))
    wall = ~data.inside
    odds = data.outlier_odds[wall]
    if company:
        odds = odds * company_odds(problem.company, state.weights[wall], residual[wall], state.contact)
    weights[wall], contact = problem.contacts(residual[wall], variance[wall], odds, state.contact)
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


def contact_energy(
    problem: MotionProblem, weights: Array, residual: Array, contact: Contact, noises: Array
) -> float:
    """Return what the probabilities `weights`, with which the rows were gathered, cost; a bound from one side
    is a ratio, not a density.
    """
    data = problem.data
    wall = ~data.inside
    # of two fits one leaves outside what the other leaves inside
    odds = company_odds(problem.company, weights[wall], residual[wall], contact, either_side=True)
    density = -np.log(np.sqrt(2.0 * np.pi) * noises[data.group] * data.relative)
    labels = label_energy(weights[wall], residual[wall], odds * data.outlier_odds[wall], contact)
    return labels + float(weights[~wall] @ density[~wall])


def _energy_terms(
    problem: MotionProblem, state: State, solved: Solved, residual: Array, contact: Contact
) -> dict[str, float]:
    """Return the free energy and its terms: residuals, what the fields could have explained, labels."""
    rows, log_noise, posterior = solved.rows, solved.log_noise, solved.field.solved
    data_misfit = misfit(posterior, log_noise, rows)
    complexity = free_energy(posterior, log_noise, rows) - data_misfit
    labels = contact_energy(problem, state.weights, residual, contact, np.exp(log_noise))
    terms = {"misfit": data_misfit, "complexity": complexity, "labels": labels}
    return {"energy": sum(terms.values()), **terms}


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
