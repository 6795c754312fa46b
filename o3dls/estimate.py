"""What we believe the surface is, and how we came to believe it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .arrays import Array
from .case import Case
from .errors import InputError, escaped
from .geometry.similarity import apply, rms_radius, scale_of
from .geometry.surface import Surface
from .run_warning import RunWarning

if TYPE_CHECKING:
    from .levelset.grid.distance import SignedDistance
    from .motion.recorded import Motion
    from .motion.result import MotionFit
    from .motion.wall.posterior import WallPosterior
    from .motion.wall.samples import SurfaceSamples
    from .noise.shifted_part import MapShift

SAME_PLACE = 1e-9  # diagonals: what one pose after another rounds
SHIFTED = "shifted"  # column of the points that an offset was taken out of
DEVIATIONS = ("sd_mm", "sd_px")  # fields of a surface: its deviation along the normal


@dataclass(frozen=True, eq=False)
class Estimate:
    """An estimate is a surface in the map frame with the motion that led to it, and a sentence on how it
    went.

    T_map_prior (d+1, d+1) is the similarity part; sigma the noise level found (case units); weights (k,) in
    [0, 1] are the probabilities that each mapping point touches the wall; trace holds one record per
    iteration; phi is the level set where there is one; fit is the motion's fit, which Deform.update and the
    stage `topology` go on from; map_shift is the offset of a part of the map that the estimate is free of.
    """

    surface: Surface
    T_map_prior: Array
    status: str
    converged: bool = True
    iterations: int = 0
    seconds: float = 0.0
    sigma: float | None = None
    weights: Array | None = None
    motion: Motion | None = None
    phi: SignedDistance | None = None
    fit: MotionFit | None = None
    map_shift: MapShift | None = None
    trace: tuple[Mapping[str, float], ...] = ()
    warnings: tuple[RunWarning, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)  # further results of the stage, JSON-ready

    def __repr__(self) -> str:
        noise = "" if self.sigma is None else f", noise {self.sigma:.3g}"
        ended = "converged" if self.converged else "did not converge"
        return f"Estimate({self.surface!r}{noise}, {ended}: {escaped(self.status)})"

    @property
    def scale(self) -> float:
        return scale_of(self.T_map_prior)

    def only_posed(self, prior: Surface) -> bool:
        """Return whether the surface is the prior under T_map_prior, and nothing else of it moved."""
        if not np.array_equal(self.surface.faces, prior.faces):
            return False
        apart = apply(self.T_map_prior, prior.vertices) - self.surface.vertices
        return bool(np.abs(apart).max() <= SAME_PLACE * self.surface.diagonal)

    def corrected(self, case: Case) -> Case:
        """The case as the estimate sees it: without the offset of a part of its points, which get the column
        `shifted` (1 for those of the part); the same one where no offset was taken out.
        """
        if self.map_shift is None:
            return case
        points = case.points
        shift = self.map_shift
        xyz = shift.without(points.xyz, points.taken, points.type == "landmark")
        columns = {**points.columns, SHIFTED: (xyz != points.xyz).any(axis=1).astype(np.float64)}
        return replace(case, points=replace(points, xyz=xyz, columns=columns))

    def covariance(self) -> Array:
        """Return the covariance (n, d, d) of where each vertex of the surface truly lies, in the case's unit
        squared: along the normal the square of the field `sd_mm`, in the wall what the motion leaves open.

        Raises InputError where the estimate has no posterior.
        """
        from .motion.wall.samples import wall_covariance

        return wall_covariance(self.surface, self._posterior(), self._deviation())

    def samples(self, n: int, seed: int = 0) -> SurfaceSamples:
        """Return surfaces that are as likely as one another, given the prior and the points.

        What is computed of each of them, such as a volume, has the distribution that the estimate leaves to
        it. The covariance of a vertex is that of `covariance`, vertices go together as the motion does, and
        doubtful wall is there as often as the field `existence` says. Equal seeds give equal samples.

        Parameters
        ----------
        n : int
            how many.
        seed : int, default 0
            where the random numbers begin.

        Returns
        -------
        SurfaceSamples
            `vertices` (n, v, d) in the map frame, in the case's unit; `exists` (n, v), where there is wall;
            `samples[k]` is one as a Surface.

        Raises
        ------
        InputError
            where the estimate has no posterior: it comes from a stage without a motion, or was kept by an
            earlier version.

        Examples
        --------
        >>> import numpy as np
        >>> import o3dls
        >>> run = o3dls.read_run("run")
        >>> samples = run.estimates["deform"].samples(50, seed=7)
        >>> volumes = [one.volume / 1000.0 for one in samples]
        >>> bool(np.std(volumes) > 0.0)
        True
        """
        from .motion.wall.samples import SurfaceSamples, sample_existence, sample_vertices
        from .reconstruction.settings import ReconstructionSettings

        if n < 1:
            raise InputError(f"n = {n}: must be at least 1")
        posterior, surface = self._posterior(), self.surface
        places, parts = np.random.default_rng(seed).spawn(2)
        vertices = sample_vertices(surface, posterior, self._deviation(), n, places)
        exists = np.ones((n, len(surface.vertices)), dtype=bool)
        likely = surface.fields.get("existence")
        if likely is not None:
            length = ReconstructionSettings().absent_length * rms_radius(surface.vertices)
            exists = sample_existence(surface, likely, length, posterior.where, n, parts)
        return SurfaceSamples(surface, vertices, exists)

    def _posterior(self) -> WallPosterior:
        """Return the posterior of the motion over the wall. Raises InputError where there is none."""
        from .motion.posterior import wall_posterior

        found = wall_posterior(self.motion)
        if found is None:
            raise InputError(
                "the estimate has no posterior in space; run a pipeline with the stage 'deform' again, with "
                "this version"
            )
        return found

    def _deviation(self) -> Array | None:
        fields = self.surface.fields
        return next((fields[name] for name in DEVIATIONS if name in fields), None)
