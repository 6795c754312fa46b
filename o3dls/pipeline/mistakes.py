"""What can be wrong with a pipeline as a whole: folds, the order of stages, writers that collide."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..errors import did_you_mean

if TYPE_CHECKING:
    from .pipeline import Pipeline


def mistakes(pipeline: Pipeline, most_folds: int) -> list[str]:
    """What is wrong with a whole pipeline, one sentence each; its parts have checked themselves."""
    found = [] if pipeline.stages else ['the pipeline has no stage: add a [[stage]] with use = "icp"']
    if pipeline.folds not in range(most_folds + 1) or pipeline.folds == 1:
        found.append(
            f"folds = {pipeline.folds!r}: must be 0 (no cross-validation) or a whole number within [2, "
            f"{most_folds}]"
        )
    found += order_mistakes([(stage.name, stage.estimate_name, stage.after) for stage in pipeline.stages])
    for writer in pipeline.writes:
        found += [
            f"{writer.name}: no estimate '{n}'{did_you_mean(n, pipeline.names)}"
            for n in writer.refers_to
            if n not in pipeline.names
        ]
    targets = [" ".join(writer.target(pipeline.names[-1])) for writer in pipeline.writes]
    twice = [target for target in dict.fromkeys(targets) if targets.count(target) > 1]
    return found + [
        f"{target}: two writers would overwrite each other's files: leave one out" for target in twice
    ]


def order_mistakes(steps: Sequence[tuple[str, str, str | None]]) -> list[str]:
    """What is wrong with the order of stages.

    They are given as (stage, name of its estimate, name of the estimate it starts after).
    """
    found = []
    names = ["start", *(name for _, name, _ in steps)]
    for k, (stage, name, after) in enumerate(steps, 1):
        if name in names[:k]:
            found.append(f"{stage}: a second estimate named '{name}': give it another name with as = \"...\"")
        elif after in names[k:]:
            found.append(f"{name}.after = '{after}': is not made before {name}; name an earlier estimate")
        elif after is not None and after not in names:
            found.append(f"{name}.after = '{after}': no such estimate{did_you_mean(after, names)}")
    return found
