"""What a fit of the motion gives: state of the iteration, surface, deviation, history."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array, Ints
from ..geometry.similarity import fit_similarity
from ..noise.contact import Contact
from .marginal_likelihood import Scales

if TYPE_CHECKING:
    from .problem import Problem
from .motion import Motion


@dataclass(frozen=True, eq=False)
class State:
    """What one iteration hands to the next: vertices (n, d) where feet are sought, as moved by the field,
    scales, mixture, belief.

    patches (k,): which row each point falls into, once that stays: points that change rows would keep the
    surface from standing still.
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

    energy is the free energy in nats: lower is likelier, comparable between fits of the same points. The
    trace has its terms: what residuals cost, what the fields could have explained, and the beliefs.
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
        share = self.motion.share
        faired = self.facts["faired"]
        moving = self.facts["moving"]
        on = (
            f"stopped after {len(self.trace)} iterations while the surface still moved {moving:.2g} "
            f"{unit} a round"
        )
        said = ["converged" if self.converged else on]
        said += [
            f"noise {self.sigma:.3g} {unit}, {100 * self.facts['off_wall']:.0f} % of the points off the wall"
        ]
        if share < 0.95:
            posed = (
                ""
                if np.array_equal(self.motion.alone, np.eye(len(self.motion.alone)))
                else ", else the pose of points and landmarks"
            )
            said += [
                f"the points show a motion beyond the pose with probability {share:.2f}, and the prior "
                f"follows it that far{posed}"
            ]
        if faired:
            said += [
                f"the points show the prior to be rough, so it was smoothed over {faired:.2g} {unit} "
                "before it was moved"
            ]
        if odd := int(self.facts.get("let_go", 0)):
            said += [f"{odd} points that seemed to draw the wall out were let go until it stood without them"]
        if folded := int(self.facts["folded_faces"]):
            left = int(self.facts["still_folded_faces"])
            faces, were = ("face", "was") if folded == 1 else ("faces", "were")
            mended = (
                f", of which {left} could not be mended"
                if left
                else f" and {were} mended from the surroundings"
            )
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
        return np.asarray(
            self.state.weights[(data.group == 0) & ~data.inside if data.mapping is None else data.mapping]
        )

    @property
    def similarity(self) -> Array:
        """Least-squares similarity (d+1, d+1) of the fitted motion."""
        return fit_similarity(self.motion.vertices, self.vertices)
