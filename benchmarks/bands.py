"""Whether deviations are what errors are, and whether wall is there as often as it is said to be.

The table has a row for the mapped and one for the unmapped wall of each kind of case; shares are by area, in
the mean of the cases. `within 68 %`, `within 95 %`: of wall that is there, the share within these bands; `of
all`: the same of all wall. `deviations`: within how many of them 50, 80, 90, 95 and 99 % of the errors of all
wall are. `said`, `is`: the share of the wall that is said to be there, and that is. The classes of existence
under it are of all cases together.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.scores import Record, Scores, point_distances
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import distances
from o3dls.evaluation.interpolation import REACH
from o3dls.evaluation.statistics import BAND_68, BAND_95
from o3dls.geometry.surface import Surface

WORST = 0.01  # of the wall, by area
THERE = 5.0  # mm: the radius of a narrow vein
QUANTILES = (50, 80, 90, 95, 99)  # percent
PARTS = ("mapped", "unmapped")
HEAD = ("cases", "wall", "number", "within 68 %", "within 95 %", "of all", "deviations", "said", "is")
LIKELY = (0.4, 0.6, 0.8, 0.9, 0.95, 1.0)  # largest existence of each class of wall


def bands(case: Case, estimate: Estimate) -> Scores:
    """Share of the mapped and of the unmapped wall, by area, whose distance from the true one is within the
    band that should hold 68 and 95 % of it, of all of it and of what is `there`; deviations within which
    QUANTILES of the errors are; share that is there, and that is said to be; the same for each class of
    existence; share of the wall that is unmapped, which a report hatches, and of the WORST of it; share of
    the WORST in the tenth with the largest deviation. Empty for an estimate without deviation.
    """
    assert case.truth is not None
    assert case.truth.surface is not None
    surface = estimate.surface
    found = Scores()
    sd = surface.fields.get(f"sd_{case.units}")
    if sd is None:
        return found
    error = distances(surface.vertices, case.truth.surface)
    existence = surface.fields.get("existence", np.ones(len(error)))
    area, there = surface.vertex_areas, is_there(surface, case.truth.surface)
    near = point_distances(case, surface.vertices) <= REACH
    for name, part in (("mapped", near), ("unmapped", ~near)):
        if area[part].sum() <= 0.0:
            continue
        for percent, width in ((68, BAND_68), (95, BAND_95)):
            within = error <= width * sd
            found[f"{name}{percent}"] = _share(within, area * part)
            if there[part].any():
                found[f"{name}_there{percent}"] = _share(within, area * (part & there))
        quantiles = _find_quantiles((error / sd)[part], area[part], np.array(QUANTILES) / 100)
        found |= {f"{name}_within_{q}": float(one) for q, one in zip(QUANTILES, quantiles, strict=True)}
        found |= {f"{name}_there": _share(there, area * part), f"{name}_said": _share(existence, area * part)}
    found |= _sort_by_existence(existence, there, area / area.sum())
    worst, unsure = (_choose_largest(value, area, share) for value, share in ((error, WORST), (sd, 0.1)))
    found |= {"worst_hatched": _share(~near, area * worst), "worst_unsure": _share(unsure, area * worst)}
    return found | {"hatched": _share(~near, area)}


def is_there(surface: Surface, truth: Surface) -> NDArray[np.bool_]:
    """Whether each vertex (n,) is on wall that the truth has, too: of the place of the truth next to it, the
    next place on the surface is within THERE of it. From a wall that is off, however far, one comes back; the
    truth next to a vein that does not exist lies at its mouth, and next to one that is too long at its end.
    Of priors whose wall is all there, this holds for 94 to 100 % of unmapped wall, as the table shows.
    """
    from o3dls.geometry.closest_point import ClosestPoint

    foot = ClosestPoint(truth.vertices, truth.faces).query(surface.vertices)[2]
    back = ClosestPoint(surface.vertices, surface.faces).query(foot)[2]
    return np.asarray(np.linalg.norm(back - surface.vertices, axis=1) <= THERE)


def _sort_by_existence(existence: Array, there: NDArray[np.bool_], share: Array) -> Scores:
    """How much wall, of all, is in each class of LIKELY, is said to be there, and is."""
    found = Scores()
    classes = np.searchsorted(LIKELY, existence)
    for k, most in enumerate(LIKELY):
        for name, value in (("wall", 1.0), ("said", existence), ("there", there)):
            found[f"{name}_{100.0 * most:.0f}"] = float((share * value)[classes == k].sum())
    return found


def _share(part: Array | NDArray[np.bool_], area: Array) -> float:
    return float(area @ part / area.sum())


def _find_quantiles(values: Array, weights: Array, shares: Array) -> Array:
    """The values (m,) below which these shares (m,) of the weights are."""
    order = np.argsort(values)
    return np.interp(shares, weights[order].cumsum() / weights.sum(), values[order])


def _choose_largest(values: Array, area: Array, share: float) -> NDArray[np.bool_]:
    """Which vertices (n,) have the largest values, as many as this share of the area holds, at least one."""
    order = np.argsort(-values, kind="stable")
    chosen = np.zeros(len(values), dtype=bool)
    chosen[order[: max(1, int((area[order].cumsum() <= share * area.sum()).sum()))]] = True
    return chosen


def bands_table(records: Sequence[Record]) -> list[str]:
    """The lines of the table in Markdown, and of the classes of existence; records of earlier versions, which
    do not say what is there, are left out.
    """
    held = [
        record for record in records if f"wall_{100.0 * LIKELY[0]:.0f}" in record["truth"].get("bands", {})
    ]
    if not held:
        return []
    kinds = {"all": held, "all but altered": [one for one in held if kind_of(one) != "altered"]}
    for record in held:
        kinds.setdefault(kind_of(record), []).append(record)
    rows = [_describe_bands(kind, part, members) for kind, members in kinds.items() for part in PARTS]
    lines = [HEAD, ("---",) * len(HEAD), *(row for row in rows if row)]
    existing = _describe_existence([record["truth"]["bands"] for record in held])
    altered = _describe_altered([record for record in held if kind_of(record) == "altered"])
    return ["", *("| " + " | ".join(line) + " |" for line in lines), "", *existing, *altered]


def kind_of(record: Record) -> str:
    """The kind of a case: the first word of its group."""
    return str(record["group"]).split("_", 1)[0]


def _describe_bands(kind: str, part: str, records: Sequence[Record]) -> tuple[str, ...]:
    """A row of the table; empty where no case has such wall."""
    held = [one["truth"]["bands"] for one in records if f"{part}68" in one["truth"]["bands"]]
    if not held:
        return ()

    def mean(key: str) -> float:
        known = [one[f"{part}{key}"] for one in held if f"{part}{key}" in one]
        return float(np.mean(known)) if known else np.nan

    deviations = ", ".join(f"{mean(f'_within_{percent}'):.2f}" for percent in QUANTILES)
    shares = [f"{100.0 * mean(key):.1f}" for key in ("_there68", "_there95")]
    whole = f"{100.0 * mean('68'):.1f}, {100.0 * mean('95'):.1f}"
    existing = [f"{100.0 * mean(key):.1f}" for key in ("_said", "_there")]
    return (kind, part, str(len(held)), *shares, whole, deviations, *existing)


def _describe_altered(records: Sequence[Record]) -> list[str]:
    """What 95 % bands hold of mapped wall by what is altered, the second word of a group; the least first."""
    found = dict[str, list[float]]()
    for record in records:
        found.setdefault(str(record["group"]).split("_")[1], []).append(
            record["truth"]["bands"]["mapped_there95"]
        )
    shares = sorted((100.0 * float(np.mean(held)), kind, len(held)) for kind, held in found.items())
    listed = ", ".join(f"{kind} {share:.1f} ({count})" for share, kind, count in shares)
    return [f"altered, mapped, within 95 %: {listed}"] if listed else []


def _describe_existence(held: Sequence[Scores]) -> list[str]:
    """How much wall of each class of existence is said to be there, and is; classes without wall are left
    out.
    """
    found = []
    for most in LIKELY:
        wall, said, there = (
            sum(one[f"{name}_{100.0 * most:.0f}"] for one in held) for name in ("wall", "said", "there")
        )
        if wall > 0.0:
            found.append(
                f"existence up to {most:g}: {100.0 * wall / len(held):.2f} % of the wall, "
                f"{100.0 * said / wall:.0f} % of it is said to be there, {100.0 * there / wall:.0f} % is"
            )
    return found
