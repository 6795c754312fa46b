"""The steps of a run, as its log tells them to who shows how far it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .pipeline import Pipeline

# what the log says at the end of a stage and of a fold, and at the beginning of a file
STEPS = ("%s: %s (%.2f s)", "fold %d of %d: %d points left out", "writing %s")


def count_steps(plan: Pipeline) -> int:
    """Return how many steps a run of a pipeline has."""
    return len(plan.stages) + plan.folds + len(plan.writes)
