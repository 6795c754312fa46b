"""What a run folder keeps of the posterior of a motion: the rows of the linear system that it solves, so that
it is the same posterior again, and not an excerpt.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from ...arrays import Array
from ..field.covariance import Covariance, FieldPrior, Observed, Places
from ..field.gaussian_process import FieldPosterior, solve
from .posterior import WallPosterior
from .settings import SETTINGS


@dataclass(frozen=True, eq=False)
class KeptPosterior:
    """A kept posterior has the arrays that determine it: the covariance of the motion before points are seen,
    k observations with their residuals and the covariance of their errors, and the m nodes of the wall.

    lengths (2,): how many of `correlation` are of vector fields and of fields along the normal; scales (5,):
    radius, anchor_length, translation, rotation and scale of `Covariance`; errors (k,), or (k, k) where
    points share errors.
    """

    centre: Array
    correlation: Array
    lengths: Array
    anchors: Array
    scales: Array
    sds: Array
    at: Array
    directions: Array
    normal_part: Array
    residual: Array
    errors: Array
    nodes: Array
    normals: Array
    where: Array
    unfollowed: Array
    inflation: Array

    @classmethod
    def of(cls, posterior: WallPosterior) -> KeptPosterior:
        """Take the arrays out of a posterior."""
        field = posterior.field
        cov, seen, solved = field.prior.covariance, field.observed, field.solved
        whole = solved.factor @ solved.factor.T
        errors = whole - field.prior.between(seen, seen)
        own = np.diag(errors).copy()
        if np.abs(errors - np.diag(own)).max() < SETTINGS.least_shared * float(np.diag(whole).max()):
            errors = own
        return cls(
            centre=cov.centre,
            correlation=cov.lengths,
            lengths=np.array([len(cov.vector), len(cov.normal)], dtype=np.float64),
            anchors=cov.anchors,
            scales=np.array([cov.radius, cov.anchor_length, cov.translation, cov.rotation, cov.scale]),
            sds=field.prior.sds,
            at=seen.at,
            directions=seen.directions,
            normal_part=seen.normal_part,
            residual=whole @ solved.alpha,
            errors=errors,
            nodes=posterior.nodes.at,
            normals=posterior.nodes.normals,
            where=posterior.where,
            unfollowed=posterior.unfollowed,
            inflation=np.array([posterior.inflation]),
        )

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array], dimension: int) -> KeptPosterior:
        """Take arrays as `arrays` gives them. Raises ValueError where one is missing or does not fit."""
        found = {one.name: np.asarray(arrays[one.name]) for one in fields(cls) if one.name in arrays}
        if missing := [one.name for one in fields(cls) if one.name not in found]:
            raise ValueError(f"it has no {missing[0]}")
        if not all(one.dtype.kind in "fi" and np.isfinite(one).all() for one in found.values()):
            raise ValueError("it holds what is no number")
        kept = cls(**{name: one.astype(np.float64) for name, one in found.items()})
        if wrong := kept._find_misshapen(dimension):
            raise ValueError(f"{wrong} has another shape than the rest")
        return kept

    def arrays(self) -> dict[str, Array]:
        """Return the arrays by name."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    @cached_property
    def posterior(self) -> WallPosterior:
        """The posterior, solved for again. Raises SolverError where the arrays are of none."""
        split = int(self.lengths[0])
        covariance = Covariance(
            self.centre,
            tuple(map(float, self.correlation[:split])),
            tuple(map(float, self.correlation[split:])),
            float(self.scales[0]),
            self.anchors,
            *map(float, self.scales[1:]),
        )
        prior = FieldPrior(covariance, self.sds)
        seen = Observed(self.at, self.directions, self.normal_part)
        errors = np.diag(self.errors) if self.errors.ndim == 1 else self.errors
        solved, _ = solve(prior.between(seen, seen) + errors, self.residual)
        places = Places(self.nodes, self.normals)
        field = FieldPosterior(prior, seen, solved)
        return WallPosterior(field, places, self.where, self.unfollowed, float(self.inflation[0]))

    def _find_misshapen(self, dim: int) -> str:
        """Return the name of an array that does not fit the others; empty where all do."""
        k, m, anchors = len(self.at), len(self.nodes), len(self.anchors)
        shapes = dict.fromkeys(("nodes", "normals", "where", "unfollowed"), (m, dim))
        shapes |= {"at": (k, dim), "directions": (k, dim), "normal_part": (k,), "residual": (k,)}
        shapes |= {"centre": (dim,), "scales": (5,), "inflation": (1,), "lengths": (2,)}
        shapes |= {"correlation": (int(self.lengths.sum()),), "anchors": (anchors, dim)}
        shapes |= {"sds": (int(self.lengths.sum()) + 2 + (anchors > 0),)}
        if self.errors.shape not in ((k,), (k, k)):
            return "errors"
        return next((name for name, shape in shapes.items() if getattr(self, name).shape != shape), "")
