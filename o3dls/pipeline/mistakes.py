"""What can be wrong with a pipeline as a whole: folds, the order of stages, writers that collide."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import did_you_mean
from ..plugins.stage import Stage
from ..runs.writers import Writer

MOST_FOLDS = 50


def mistakes(
    stages: Sequence[Stage], writes: Sequence[Writer], names: Sequence[str], folds: int, keep_last: object
) -> list[str]:
    """Return what is wrong with a whole pipeline, one sentence each; its parts have checked themselves.

    names: of its estimates in order.
    """
    found = [] if stages else ['the pipeline has no stage: add a [[stage]] with use = "icp"']
    if folds not in range(MOST_FOLDS + 1) or folds == 1:
        found.append(
            f"folds = {folds!r}: must be 0 (no cross-validation) or a whole number within [2, {MOST_FOLDS}]"
        )
    if type(keep_last) is not bool:
        found.append(f"keep_last = {keep_last!r}: must be true or false")
    found += order_mistakes([(stage.name, stage.estimate_name, stage.after) for stage in stages])
    for writer in writes:
        found += [
            f"{writer.name}: no estimate '{n}'{did_you_mean(n, list(names))}"
            for n in writer.refers_to
            if n not in names
        ]
    targets = [" ".join(writer.target(names[-1])) for writer in writes]
    twice = [target for target in dict.fromkeys(targets) if targets.count(target) > 1]
    return found + [
        f"{target}: two writers would overwrite each other's files: leave one out" for target in twice
    ]


def order_mistakes(steps: Sequence[tuple[str, str, str | None]]) -> list[str]:
    """Return what is wrong with the order of stages.

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
