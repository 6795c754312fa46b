"""Whether the scale that ICP finds between image and map is that of one heart."""

from __future__ import annotations

import numpy as np

from ..subject import Subject
from .check import Check, count_decimals

SIZE = 0.13  # of the logarithm of a scale: no heart is an eighth larger or smaller than it was imaged


def check_size(subject: Subject) -> Check:
    """Check the scale that ICP finds between image and map, which are both in millimetres."""
    name, found = "Size", found_scale(subject)
    if found is None:
        said = "there is no ICP, the prior is a template, or lengths are not in mm"
        return Check(name, "none", said, "does not apply")
    stage, scale = found
    off = abs(np.log(scale)) > SIZE
    low, high = np.exp(-SIZE), np.exp(SIZE)
    digits = count_decimals(scale, (low, high), 2)
    asked = ": are units, heart phase and patient the same?" if off else ""
    said = f"{stage} makes the prior {scale:.{digits}f} times as large{asked}"
    limit = f"from x {low:.{digits}f} to x {high:.{digits}f}"
    return Check(name, "amber" if off else "good", said, f"x {scale:.{digits}f}", limit)


def found_scale(subject: Subject) -> tuple[str, float] | None:
    """Return the name of the ICP, the baseline's if it is one, and its scale; None where it would say nothing
    of the heart: of a template, and of a case in pixels.
    """
    first = next((one for one in subject.results.values() if one.key.startswith("icp")), None)
    first = subject.first if subject.first and subject.first.key.startswith("icp") else first
    if first is None or subject.case.prior_of != "patient" or subject.unit != "mm":
        return None
    return first.name, float(np.cbrt(np.linalg.det(first.estimate.T_map_prior[:3, :3])))
