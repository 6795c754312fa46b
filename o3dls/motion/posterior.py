"""The posterior of a motion over its wall, wherever the motion comes from: a fit, a template, or a folder."""

from __future__ import annotations

from functools import lru_cache

from ..geometry.spread import spread
from .field.covariance import Places
from .motion import FittedMotion
from .recorded import Motion, RecordedMotion
from .template import Chain
from .wall.kept import KeptPosterior
from .wall.posterior import WallPosterior
from .wall.settings import SETTINGS


def wall_posterior(motion: Motion | None) -> WallPosterior | None:
    """Return the posterior of a motion's wall; None where it has none, or its run did not keep it."""
    kept = _kept(motion)
    return kept.posterior if kept is not None else _fitted_posterior(motion)


def kept_posterior(motion: Motion | None) -> KeptPosterior | None:
    """Return what a run folder keeps of a motion's posterior; None where there is none."""
    kept = _kept(motion)
    if kept is not None:
        return kept
    found = _fitted_posterior(motion)
    return None if found is None else KeptPosterior.of(found)


def _kept(motion: Motion | None) -> KeptPosterior | None:
    return motion.kept if isinstance(motion, RecordedMotion) else None


@lru_cache(maxsize=4)  # estimates of one run share their motion
def _fitted_posterior(motion: Motion | None) -> WallPosterior | None:
    if isinstance(motion, Chain):  # what leads to the template's shape is known
        return _fitted_posterior(motion.then)
    if not isinstance(motion, FittedMotion):
        return None
    rest, some = motion.rest, spread(motion.rest.at, SETTINGS.nodes)
    nodes = Places(rest.at[some], rest.normals[some])
    field = motion.field.mean(nodes)
    return WallPosterior(
        field=motion.field,
        nodes=nodes,
        where=motion.mean(nodes.at, field),
        unfollowed=motion.unfollowed(nodes.at, field),
        inflation=motion.inflation,
    )
