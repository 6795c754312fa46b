"""Whether the stages of a run came to rest."""

from __future__ import annotations

from ...runs.run import Run
from ..subject import Subject
from .check import Check, count_words

STILL = 0.1  # of the noise: a motion that moves less in a round counts as at rest
NAME, LIMIT = "Converged", f"up to {STILL:.0%} of the noise"


def check_convergence(subject: Subject) -> Check:
    """Compare the last step of a motion with the noise: one that hardly moves any more is near its end."""
    run = subject.last.run
    steps = _last_steps(run)
    if not steps:
        return Check(NAME, "good", "all stages converged", "all stages", LIMIT)
    moving = [key for key, step in steps.items() if step is None or step > STILL]
    if moving:
        said = "; ".join(f"{key} ({run.estimates[key].status})" for key in moving)
        return Check(NAME, "amber", f"not converged: {said}", count_words(moving, "stage"), LIMIT)
    most = max(step for step in steps.values() if step is not None)
    said = f"{', '.join(steps)} still moved, by {most:.1%} of the noise in a round"
    return Check(NAME, "good", f"{said}, which counts as at rest", f"to {most:.0%} of the noise", LIMIT)


def _last_steps(run: Run) -> dict[str, float | None]:
    """Return, by estimate that has not converged, the last step of its motion over the noise; None where no
    stage has said it. A stage that leaves the motion alone has that of the one before.
    """
    step: float | None = None
    found = {}
    for key, one in run.estimates.items():
        if one.sigma and "last_step" in one.facts:
            step = float(one.facts["last_step"]) / one.sigma
        if not one.converged:
            found[key] = step
    return found
