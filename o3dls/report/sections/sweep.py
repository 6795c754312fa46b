"""How the result depends on one parameter, where the runs of a report differ in just that: fitted against
unseen error.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...runs.record import Provenance
from ..drawing.charts import Series, axis_over, grouped, line_chart
from ..markup import join, tag
from ..section import Section
from ..subject import HEADLINE, SETS, Subject

FEWEST = 3


def sweep_section(subject: Subject) -> Section | None:
    """Draw a curve for each set of points over the one parameter that differs between at least three runs."""
    found = swept([run.provenance for run in subject.runs])
    if found is None:
        return None
    name, values = found
    finals = subject.finals
    order = np.argsort(values)
    sets = [group for group in HEADLINE if all(group in result.scores for result in finals)]
    x = np.array(values)[order]
    curves = [
        Series(SETS[s], k, x, np.array([r.scores[s][f"mean_{subject.unit}"] for r in finals])[order])
        for k, s in enumerate(sets)
    ]
    log = bool(x[0] > 0 and x[-1] > 10 * x[0])
    chart = line_chart(
        f"Mean distance over {name}",
        curves,
        axis_over(name, [x], zero=False, log=log),
        axis_over(f"mean distance, {subject.unit}", [c.y for c in curves]),
    )
    said = "Where the fitted error falls and the others rise, the surface overfits the noise."
    note = tag("p", said, class_="soft")
    return Section("sweep", f"Sensitivity to {name}", join(grouped(chart), note))


def swept(made: Sequence[Provenance]) -> tuple[str, list[float]] | None:
    """Return the name and values of the one parameter of a stage in which pipelines differ; None where it
    is not one, or no number.
    """
    flat = [{**one.pipeline, "stage": None, "write": None, **one.parameters} for one in made]
    keys = dict.fromkeys(key for one in flat for key in one)
    differing = [key for key in keys if len({repr(one.get(key)) for one in flat}) > 1]
    values = [one.get(differing[0]) for one in flat] if len(differing) == 1 and "." in differing[0] else []
    numbers = [
        float(value) for value in values if isinstance(value, int | float) and not isinstance(value, bool)
    ]
    return (differing[0], numbers) if len(numbers) >= FEWEST and len(set(numbers)) == len(made) else None
