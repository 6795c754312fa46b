"""Which landmarks of a case a pose and a motion are fitted to: all pairs, but for one that contradicts the
others.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..case import Case
from ..geometry.similarity import fit_similarity
from ..registration.landmarks import errors
from ..registration.odd_landmark import odd_landmark
from ..run_warning import RunWarning


def contradicted(case: Case) -> int | None:
    """Return the row, among the landmark pairs, of the one that contradicts all others; None where none does.

    Veins of another person are elsewhere, so that nothing is said of the landmarks of a template.
    """
    _, prior, measured = case.landmark_pairs()
    return odd_landmark(prior, measured) if case.prior_of == "patient" else None


def trusted_pairs(case: Case) -> tuple[list[str], Array, Array]:
    """Return what `Case.landmark_pairs` does, without a pair that contradicts all others."""
    names, prior, measured = case.landmark_pairs()
    odd = contradicted(case)
    keep = [k for k in range(len(names)) if k != odd]
    return [names[k] for k in keep], prior[keep], measured[keep]


def contradiction_of_landmarks(case: Case) -> list[RunWarning]:
    """Return a warning that names the landmark that is not used, where there is one."""
    odd = contradicted(case)
    return [] if odd is None else [RunWarning("landmark-not-used", describe_unused(case, odd))]


def describe_unused(case: Case, odd: int) -> str:
    """Say how far a landmark lies from where all others put it."""
    names, prior, measured = case.landmark_pairs()
    others = np.arange(len(names)) != odd
    matrix = fit_similarity(prior[others], measured[others], scale=False)
    gap = float(errors(prior[[odd]], measured[[odd]], matrix)[0])
    return (
        f"the landmark {names[odd]} is not used: it lies {gap:.0f} {case.units} from where the others, which "
        "agree, put it; was it marked there, and is that its name?"
    )
