"""Change the topology of the prior as long as evidence asks for it.

A motion makes up for a wrong topology as well as it can: it stretches the wall into a vein that the prior
lacks, and it doubts the points in the mouth of one that is not there. So a change is proposed where the
points look odd (`tubes`, `cuts`), made to the prior in its pose, and judged by the free energy of a
motion fitted anew.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array, Ints
from ..geometry.components import components_and_euler
from ..geometry.similarity import apply, rms_radius
from ..geometry.surface import Surface
from ..levelset.grid.distance import SignedDistance, signed_distance
from ..levelset.settings import LatticeSettings
from ..motion.drift import fit_with_drift, with_doubt
from ..motion.field.observations import Data
from ..motion.fit import TrialFit, fit_motion
from ..motion.result import MotionFit
from ..motion.settings import MotionSettings
from ..parallel import both, each
from .change import Change, changed
from .cuts import removals
from .observation import Measured, Noise, observe
from .settings import TopologySettings
from .tubes import growth
from .wall import Wall


def change_topology(
    fit: MotionFit, *, spacing: float, settings: TopologySettings
) -> tuple[MotionFit, tuple[Change, ...]]:
    """Make the best change, look again, until none earns its evidence: the fit of the changed prior, and the
    changes.

    spacing: of the lattice on which the prior is changed, or the length of its edges if these are longer. The
    fit is the same one where there is nothing to change, or where the prior has several components: what is
    proposed is for one body.
    """
    search = TopologySearch(spacing, settings)
    made: list[Change] = []
    while len(made) < settings.most_changes and _prior_topology(fit)[0] == 1:
        after = search.best(fit)
        if after is None:
            break
        fit, change = after
        made.append(change)
    return fit, tuple(made)


@dataclass(frozen=True)
class TopologySearch:
    """A search makes proposals for one prior, and says what each is worth."""

    spacing: float
    settings: TopologySettings

    def proposals(self, fit: MotionFit) -> Iterator[Change]:
        """Propose changes of the prior in its pose. Tubes are looked for before the motion, which would hide
        them; cuts, whose points must lie on a wall that is not there, after it.
        """
        settings = self.settings
        posed = posed_prior(fit)
        after = Wall(posed.with_vertices(fit.vertices), settings.observation)

        def grown() -> list[Change]:
            before = Wall(posed, settings.observation)
            return list(growth(before, self.seen(fit, before, moved=False), settings))

        def cut_off() -> list[Change]:
            return list(removals(after, self.seen(fit, after, moved=True), settings.cuts))

        cuts, tubes = both(cut_off, grown)
        tubes = [tube for tube in tubes if tube.gain >= settings.evidence]
        yield from heapq.nlargest(settings.judged, tubes, key=lambda change: change.gain)
        for cut in heapq.nlargest(settings.judged, cuts, key=lambda change: change.gain):
            vertices, faces = cut.region
            yield replace(cut, region=(before_motion(fit, after, vertices), faces))

    def seen(self, fit: MotionFit, wall: Wall, *, moved: bool) -> Measured:
        """Return the points of the fit as they look from a wall that has moved to them, or not yet: then
        their distances tell the noise.
        """
        data = _thin_data(fit, self.settings.proposing_points)
        weights = fit.state.weights[~fit.problem.data.inside]
        relative = np.ones(len(data.points))
        if moved:
            relative = fit.state.scales.errors(data.group, data.relative) / fit.sigma
        noise = Noise(fit.sigma if moved else None, outlier_fraction=float(1.0 - weights.mean()))
        return observe(wall, data.points, data.inside, relative, noise, self.settings.observation)

    def judged(self, fit: MotionFit, changes: list[Change]) -> Iterator[Change]:
        """Return the changes with what each gains once a motion is fitted anew. The prior without a change is
        meshed on the same lattice: many points see the difference; where a lattice tears it, as a thin wall,
        that would spoil the comparison, and a finer one is taken, or nothing is judged.
        """
        if not changes:
            return
        for coarser in self.settings.trial_spacings:
            before = self.level_set(fit, coarser)
            unchanged = changed(before, None)
            if self.keeps(fit, unchanged):
                break
        else:
            return
        part = _thin_data(fit, self.settings.trial_points)
        whole = self.trial(fit, unchanged, part)

        def tried(change: Change) -> Change:
            price = change.price(len(part.points))
            least = price + self.settings.evidence - self.settings.trial_lead
            after = self.trial(fit, changed(before, change), part)
            lead = after.lead(whole, least, self.settings.early_rounds)
            return replace(change, gain=lead - price)

        yield from each(tried, changes)

    def best(self, fit: MotionFit) -> tuple[MotionFit, Change] | None:
        """Return the change of most evidence that keeps some in the whole fit, with that fit: its trial had
        neither the pose alone nor a second start to fall back to, and fewer points.
        """
        judged = self.judged(fit, list(self.proposals(fit)))
        earned = [change for change in judged if change.gain >= self.settings.evidence]
        if not earned:
            return None
        before = self.level_set(fit)
        for change in sorted(earned, key=lambda change: change.gain, reverse=True):
            after = fit_motion(*self.anew(fit, changed(before, change), fit.problem.data))
            after = with_doubt((fit.drift and fit_with_drift(after)) or after, fit.motion.doubt)
            gain = fit.energy - after.energy - change.price(len(fit.problem.data.points))
            if gain > 0.0 and self.explains(change, after):
                return after, replace(change, gain=gain)
        return None

    def explains(self, change: Change, after: MotionFit) -> bool:
        """Return whether the points that ask for a change lie on the new wall, in the median. Points that
        float in the mouth of a part that was never touched gain something by any wall near them, many points
        gain much, and yet it does not run through them.
        """
        wall = Wall(Surface(after.state.moved, after.problem.faces), self.settings.observation)
        distance = wall.look(change.odd)[0]
        cuts = self.settings.cuts
        near = float(np.median(np.abs(distance))) < cuts.deep * after.sigma if len(distance) else False
        return len(distance) >= cuts.witnesses and near

    def keeps(self, fit: MotionFit, remade: Surface) -> bool:
        """Return whether a lattice kept the prior with its topology, and not a shred of it that has the
        same.
        """
        kind = components_and_euler(remade.vertices, remade.faces)
        return kind == _prior_topology(fit) and remade.area > self.settings.least_area * posed_prior(fit).area

    def level_set(self, fit: MotionFit, coarser: float = 1.0) -> SignedDistance:
        """Return the level set of the prior in its pose, on a lattice that is so much coarser."""
        posed = posed_prior(fit)
        spacing = coarser * max(self.spacing, _mean_edge(posed))
        return signed_distance(posed.vertices, posed.faces, spacing, LatticeSettings().half_band * spacing)

    def trial(self, fit: MotionFit, posed: Surface, data: Data) -> TrialFit:
        """Return a motion that judges what the prior was made into. Its points share rows of the linear
        system by patches from fewer points on than in the fit that places the wall.
        """
        prior, faces, pose, points, settings = self.anew(fit, posed, data)
        rows = min(settings.iteration.most_rows, self.settings.trial_rows)
        iteration = replace(settings.iteration, most_rows=rows)
        return TrialFit(prior, faces, pose, points, replace(settings, iteration=iteration))

    def anew(
        self, fit: MotionFit, posed: Surface, data: Data
    ) -> tuple[Array, Ints, Array, Data, MotionSettings]:
        """Return what a motion of what the prior was made into is fitted from: vertices (n, d), faces (m, d),
        pose, data, settings.
        """
        motion = fit.motion
        prior = apply(np.asarray(np.linalg.inv(motion.T_map_prior)), posed.vertices)
        # in mm, not radii: points float as deep in any prior
        larger = fit.problem.size / rms_radius(posed.vertices)
        settings = fit.problem.settings
        contact = settings.contact
        contact = replace(contact, depth=contact.depth * larger, scatter=contact.scatter * larger)
        settings = replace(
            settings,
            selection=replace(settings.selection, smoothing_lengths=()),
            contact=contact,
        )
        return prior, posed.faces, motion.T_map_prior, data, settings


def _thin_data(fit: MotionFit, most: int) -> Data:
    """Return an even part of the points where they are many: a change of topology does not depend on
    detail.
    """
    data = fit.problem.data
    return data.at(data.part(most))


def posed_prior(fit: MotionFit) -> Surface:
    """Return the prior in its pose, before the motion."""
    return Surface(fit.motion.rest.at, fit.motion.faces)


def before_motion(fit: MotionFit, moved: Wall, points: Array) -> Array:
    """Return the points (n, d) near the moved wall before the motion: as its closest place was."""
    _, corners, weights = moved.look(points)
    shift = (fit.vertices - fit.motion.rest.at)[corners]
    return np.asarray(points - np.einsum("nc,ncd->nd", weights, shift))


def _prior_topology(fit: MotionFit) -> tuple[int, int]:
    """Return the number of components and the Euler number of the prior."""
    return components_and_euler(fit.motion.rest.at, fit.motion.faces)


def _mean_edge(surface: Surface) -> float:
    """Return the mean length of an edge: a lattice of this spacing changes the surface and keeps its
    detail.
    """
    corners = surface.vertices[surface.faces]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())
