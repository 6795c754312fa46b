"""How much likelier one surface is than another, in as few rounds of fitting its motion as tell."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import chain, count
from threading import Lock

from ..arrays import Array, Ints
from ..motion.field.observations import Data
from ..motion.fit import Round, run_rounds
from ..motion.iteration import begin
from ..motion.problem import motion_problem
from ..motion.settings import MotionSettings
from ..parallel import both, once, one_blas_thread


class TrialFit:
    """A trial fit compares the energies of one surface and another: its rounds are run as they are asked for,
    until the surface stands still or the energy does, without what `fit_motion` weighs after them. Parameters
    and errors as there.
    """

    def __init__(
        self, vertices: Array, faces: Ints, pose: Array, data: Data, settings: MotionSettings
    ) -> None:
        self._problem = once(lambda: motion_problem(vertices, faces, pose, data, settings))
        self._rounds = self._start_rounds(settings.selection.steady_energy)
        self._tuned = min(settings.iteration.tune_at)
        self._energies: list[float] = []
        self._lock = Lock()

    def _start_rounds(self, steady: float) -> Iterator[Round]:
        problem = self._problem()
        yield from run_rounds(problem, begin(problem), enough=steady)

    def energy(self, k: int) -> float:
        """Return the free energy (nats) of round k, or of the last one, if that was earlier; several threads
        may ask.
        """
        with self._lock, one_blas_thread():
            while len(self._energies) <= k and (reached := next(self._rounds, None)) is not None:
                self._energies.append(reached.record["energy"])
        return self._energies[min(k, len(self._energies) - 1)]

    def lead(self, other: TrialFit, least: float, early: tuple[int, ...]) -> float:
        """Return by how much (nats) this fit's last energy is below the other's; or that of a round, the
        first of some `early` ones and of those after tuning in which it is less than `least`.
        """
        for k in chain(early, count(self._tuned + 1)):
            own, others = both(partial(self.energy, k), partial(other.energy, k))
            found = others - own
            if found < least or k >= max(len(self._energies), len(other._energies)):
                break
        return found
