"""Stage `topology`: a vein more or less: changes of the prior that the points ask for, and the motion fitted
again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from ..case import Case
from ..estimate import Estimate
from ..geometry.surface import Surface
from ..plugins.stage import FINEST, Stage
from ..run_warning import RunWarning

if TYPE_CHECKING:
    from ..motion.result import MotionFit
    from ..topology.change import Change


class Topology(Stage):
    """Remove thin parts of the prior that the points contradict, add tubes that they trace.

    Only where the evidence supports it; then the motion is fitted again. Nothing is changed without a motion
    that was fitted, nor for a prior of several components.
    """

    name: ClassVar[str] = "topology"
    evidence: float = Field(
        default=5.0,
        ge=0.0,
        description="log evidence that a change of topology must have",
        json_schema_extra={"unit": "nats"},
    )
    spacing: float = Field(
        default=1.0,
        ge=FINEST,
        description="distance between nodes of the grid the prior is changed on, or its mean edge length",
        json_schema_extra={"unit": "mm"},
    )
    # each fits the motion again, and no heart is so many veins away from another
    most_changes: int = Field(default=4, ge=1, le=100, description="most changes of one prior")
    most_points: int = Field(
        default=2000,
        ge=1,
        le=100_000,  # far more than can be fitted again
        description="points above which this stage does nothing, since level_set is faster and reconstructs "
        "the wall with its topology",
    )

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..geometry.components import components_and_euler
        from ..topology.search import change_topology
        from ..topology.settings import TopologySettings

        if start.fit is None:
            return _keep_topology(start, "no motion was fitted before this stage")
        if len(start.fit.problem.data.points) > self.most_points:
            return _keep_topology(
                start, f"of more than {self.most_points} points level_set reconstructs the wall"
            )
        settings = TopologySettings(evidence=self.evidence, most_changes=self.most_changes)
        fit, changes = change_topology(start.fit, spacing=self.spacing, settings=settings)
        if changes:
            return _change_topology(case, start, fit, changes)
        components, _ = components_and_euler(fit.motion.rest.at, fit.motion.faces)
        if components > 1:
            return _keep_topology(start, f"the prior has {components} components, and this stage changes one")
        return _keep_topology(start, f"none has the {self.evidence:g} nats of evidence that it needs")


def _keep_topology(start: Estimate, why: str) -> Estimate:
    status = f"no change of topology: {why}"
    return replace(start, status=status, iterations=0, trace=(), facts={"changes": _earlier_changes(start)})


def _change_topology(case: Case, start: Estimate, fit: MotionFit, made: Sequence[Change]) -> Estimate:
    """Return the start with the fit of the changed prior."""
    from ..adapters.meshing import carry_fields
    from ..evaluation.removed_wall import removed_wall

    changes = [change.sentence(case.units) for change in made]
    surface = carry_fields(start.surface, Surface(fit.vertices, fit.motion.faces))
    warnings = (RunWarning("topology-changed", f"{change}: check it in the report") for change in changes)
    removes = case.dimension == 3 and any(change.removes for change in made)
    removed = removed_wall(start.surface, surface) if removes else {}
    found = replace(
        start,
        surface=replace(surface, fields={**surface.fields, f"sd_{case.units}": fit.sd}),
        status="; ".join(changes),
        converged=fit.converged,
        iterations=len(fit.trace),
        sigma=fit.sigma,
        weights=fit.weights,
        fit=fit,
        trace=fit.trace,
        warnings=(*start.warnings, *warnings),
        facts={
            "changes": [*_earlier_changes(start), *changes],
            "last_step": fit.facts["last_step"],
            **removed,
        },
    )
    # a motion that begins earlier, as that of `phases`, stays what it was
    whole = start.fit is not None and start.motion is start.fit.motion
    return replace(found, T_map_prior=fit.similarity, motion=fit.motion) if whole else found


def _earlier_changes(start: Estimate) -> list[str]:
    """Return the changes that an earlier stage made."""
    return list(start.facts.get("changes", []))
