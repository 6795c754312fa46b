"""Change the topology of the prior as long as evidence asks for it.

A motion makes up for a wrong topology as well as it can: it stretches the wall into a vein that the prior
lacks, and it doubts the points in the mouth of one that is not there. So a change is proposed where the
points look odd (`growth`, `topology`), made to the prior in its pose, and judged by the free energy of a
motion fitted anew.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..geometry.components import topology
from ..geometry.similarity import apply, rms_radius
from ..geometry.surface import Surface
from ..levelset.normal_displacement import Wall
from ..levelset.observation import Measured, Noise, observe
from ..motion.fit import fit_motion
from ..motion.observations import Data
from ..motion.result import MotionFit
from ..motion.settings import Settings
from .change import DEEP, WITNESSES, Change, changed
from .cuts import removals
from .tubes import growth

MOST = 4  # changes of one prior: more would be another one
ENOUGH = 1000  # points of a kind that propose and judge a change
CLOSELY = 3  # tubes, and cuts, that are looked at closely: those that the likelihood prefers


def reshape(fit: MotionFit, *, spacing: float, threshold: float) -> tuple[MotionFit, tuple[Change, ...]]:
    """Make the best change, look again, until none earns `threshold` nats: the fit of the changed prior, and
    the changes.

    spacing: of the lattice on which the prior is changed, or the length of its edges if these are longer. The
    fit is the same one where there is nothing to change, or where the prior has several pieces: what is
    proposed is for one body.
    """
    made: list[Change] = []
    while len(made) < MOST and topology(fit.motion.rest.at, fit.motion.faces)[0] == 1:
        best = max(
            _judged(fit, list(_proposals(fit, threshold)), spacing),
            key=lambda change: change.gain,
            default=None,
        )
        if best is None or best.gain < threshold:
            break
        fit = _fitted(fit, _remade(fit, best, spacing), fit.problem.data, fit.problem.settings)
        made.append(best)
    return fit, tuple(made)


def _proposals(fit: MotionFit, threshold: float) -> Iterator[Change]:
    """Changes of the prior in its pose. Tubes are looked for before the motion, which would hide them; cuts,
    whose points must lie on a wall that is not there, after it.
    """
    posed = _posed(fit)
    before = Wall(posed)
    after = Wall(posed.with_vertices(fit.vertices))
    tubes = [tube for tube in growth(before, _seen(fit, before, moved=False)) if tube.gain >= threshold]
    yield from heapq.nlargest(CLOSELY, tubes, key=lambda change: change.gain)
    cuts = removals(after, _seen(fit, after, moved=True))
    for cut in heapq.nlargest(CLOSELY, cuts, key=lambda change: change.gain):
        vertices, faces = cut.region
        yield replace(cut, region=(_back(fit, after, vertices), faces))


def _seen(fit: MotionFit, wall: Wall, *, moved: bool) -> Measured:
    """The points of the fit as they look from a wall that has moved to them, or not yet: then their spread
    tells the noise.
    """
    data = _part(fit)
    weights = fit.state.weights[~fit.problem.data.inside]
    relative = (
        fit.state.scales.noises[data.group] / fit.sigma * data.relative
        if moved
        else np.ones(len(data.points))
    )
    noise = Noise(fit.sigma if moved else None, share=float(1.0 - weights.mean()))
    return observe(wall, data.points, data.inside, relative, noise)


def _part(fit: MotionFit) -> Data:
    """An even part of many points: what changes the topology is no detail."""
    data = fit.problem.data
    return data.at(data.part(ENOUGH))


def _back(fit: MotionFit, moved: Wall, points: Array) -> Array:
    """Points (n, d) near the moved wall before the motion: as its closest place was."""
    _, corners, weights = moved.look(points)
    return np.asarray(points - np.einsum("nc,ncd->nd", weights, (fit.vertices - fit.motion.rest.at)[corners]))


def _edge(surface: Surface) -> float:
    """Mean length of an edge: a lattice of this spacing changes the surface and keeps its detail."""
    corners = surface.vertices[surface.faces]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


def _judged(fit: MotionFit, changes: list[Change], spacing: float) -> Iterator[Change]:
    """Changes with what each gains once a motion is fitted anew. The prior without a change is meshed on the
    same lattice: many points see the difference; where the lattice tears it, as a thin wall, that would spoil
    the comparison, and nothing is judged.
    """
    unchanged = _remade(fit, None, spacing) if changes else None
    if unchanged is None or topology(unchanged.vertices, unchanged.faces) != topology(
        fit.motion.rest.at, fit.motion.faces
    ):
        return
    part = _part(fit)
    settings = replace(fit.problem.settings, unfold=False)
    whole = _fitted(fit, unchanged, part, settings).energy
    for change in changes:
        after = _fitted(fit, _remade(fit, change, spacing), part, settings)
        if _explained(change, after):
            yield replace(change, gain=whole - after.energy - change.price)


def _posed(fit: MotionFit) -> Surface:
    """The prior in its pose, before the motion."""
    return Surface(fit.motion.rest.at, fit.motion.faces)


def _explained(change: Change, after: MotionFit) -> bool:
    """Whether the odd points lie on the new wall, in the median. Points that float in the mouth of a part
    that was never touched gain something by any wall near them, many points gain much, and yet it does not
    run through them.
    """
    distance = Wall(Surface(after.vertices, after.motion.faces)).look(change.odd)[0]
    return len(distance) >= WITNESSES and float(np.median(np.abs(distance))) < DEEP * after.sigma


def _remade(fit: MotionFit, change: Change | None, spacing: float) -> Surface:
    """The prior in its pose after a change, or meshed anew without one."""
    posed = _posed(fit)
    return changed(posed, change, max(spacing, _edge(posed)))


def _fitted(fit: MotionFit, posed: Surface, data: Data, settings: Settings) -> MotionFit:
    """The motion of what the prior was made into."""
    motion = fit.motion
    prior = apply(np.asarray(np.linalg.inv(motion.T_map_prior)), posed.vertices)
    # in mm: points float as deep in whatever prior
    depth = settings.depth * fit.problem.size / rms_radius(posed.vertices)
    return fit_motion(
        prior, posed.faces, motion.T_map_prior, data, replace(settings, fairing=(), depth=depth)
    )
