"""What `o3dls change` computes of two finished runs of one heart: what changed beyond its interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...errors import InputError, did_you_mean
from ...evaluation.changes.map_values import RATIOS, MapValues, values_on_prior
from ...evaluation.changes.regions import ChangedRegion
from ...evaluation.changes.shape_change import ShapeChange, compare_shapes
from ...evaluation.changes.value_change import ValueChange, compare_values
from ...evaluation.electrical import ELECTRICAL, measured_values
from ...evaluation.measures.numbers import CM2, ML
from ...evaluation.regions import REGIONS, valve_of, word
from ...geometry.surface import Surface
from ..subject import Subject, read_subject
from .one_anatomy import InMap, bring_together
from .row_table import interval_of
from .wall_regions import landmarks_in_map, wall_regions

SAMPLES, SEED = 200, 0
FEWEST = 20  # values of a map


@dataclass(frozen=True)
class Row:
    """A row of the table has what it is, where, its unit, the number and its interval; NaN without one."""

    what: str
    where: str
    unit: str
    value: float
    low: float = np.nan
    high: float = np.nan


@dataclass(frozen=True, eq=False)
class Change:
    """A change has the names of both cases, the compared column, the rows of the table, the prior in the
    first map and its frame with what changed as fields, and how far (mm rms) two priors stay apart, None
    where it is one.
    """

    names: tuple[str, str]
    column: str
    rows: list[Row]
    surface: Surface
    frame: str
    apart: float | None


def change_of(
    folders: Sequence[Path], *, column: str = "bipolar", samples: int = SAMPLES, seed: int = SEED
) -> Change:
    """Compare the last surfaces of two finished runs of one heart, and the values of a column of their maps.

    Raises InputError where the runs cannot be compared.
    """
    subjects = [read_subject([folder]) for folder in folders]
    found = _check(subjects, column)
    before, after, apart = bring_together(subjects, samples, seed)
    prior, ratio = subjects[0].case.prior, column in RATIOS
    surface = Surface(before.vertices, prior.faces)
    wall = ~valve_of(surface, landmarks_in_map(subjects[0])) & after.known
    first, second = (
        _values_in(prior, side, points, ratio) for side, points in zip((before, after), found, strict=True)
    )
    values = compare_values(prior, surface, (first, second), wall, ratio=ratio, seed=seed)
    shape = None
    if apart is None:
        errors = (before.errors, after.errors)
        shape = compare_shapes(surface, after.vertices, errors, values.compared)
    rows = [
        *_rows_of_values(subjects[0], surface, values, column),
        *_rows_of_shape(surface, shape),
        _volume_row(subjects, samples, seed),
    ]
    surface = replace(surface, fields=_fields(column, values, shape))
    names = (subjects[0].case.name, subjects[1].case.name)
    return Change(names, column, rows, surface, subjects[0].case.frame, apart)


def _values_in(prior: Surface, side: InMap, points: tuple[Array, Array], ratio: bool) -> MapValues:
    moved = prior.with_vertices(side.vertices)
    return values_on_prior(prior, moved, points, side.errors_on_prior, ratio=ratio)


def _check(subjects: Sequence[Subject], column: str) -> list[tuple[Array, Array]]:
    """Return positions and values of the column in both maps. Raises InputError where runs do not fit."""
    for subject in subjects:
        if subject.case.dimension == 2 or subject.unit != "mm":
            raise InputError(
                f"{subject.folders[0]}: is in {subject.case.dimension}D and {subject.unit}: must be in 3D "
                "and mm"
            )
    first, second = (subject.folders[0] for subject in subjects)
    for whose, frames in (
        ("points", [subject.case.frame for subject in subjects]),
        ("prior", [subject.case.prior_frame for subject in subjects]),
    ):
        if "unknown" not in frames and frames[0] != frames[1]:
            raise InputError(
                f"{second}: its {whose} are in {frames[1]}, those of {first} in {frames[0]}: must be in one "
                "frame"
            )
    a, b = (subject.case.points.of("eam").xyz for subject in subjects)
    if a.shape == b.shape and np.array_equal(a, b):
        raise InputError(f"{second}: has the points of {first}: must be another map")
    if column not in ELECTRICAL:
        raise InputError(f"no column '{column}'{did_you_mean(column, list(ELECTRICAL))}")
    measured = [measured_values(subject.case.points) for subject in subjects]
    common = [name for name in ELECTRICAL if all(name in one for one in measured)]
    for subject, one in zip(subjects, measured, strict=True):
        if column not in one:
            more = f": must be one that both have, such as {common[0]}" if common else ""
            held = ", ".join(one) or "none"  # of the columns that can be compared
            raise InputError(
                f"{subject.folders[0]}: its points have no column '{column}'; they have {held}{more}"
            )
        if len(one[column][1]) < FEWEST:
            raise InputError(
                f"{subject.folders[0]}: {len(one[column][1])} of its points have a value of '{column}': must "
                f"be at least {FEWEST}"
            )
    return [one[column] for one in measured]


def _rows_of_values(subject: Subject, surface: Surface, values: ValueChange, column: str) -> list[Row]:
    unit, ratio = ELECTRICAL[column], column in RATIOS
    area = surface.vertex_areas
    what = f"{'ratio' if ratio else 'difference'} everywhere"
    rows = [
        Row(what, "wall", "1" if ratio else unit, *map(float, values.everywhere)),
        Row("area compared", "wall", "cm²", float(area @ values.compared) / CM2),
    ]
    sampled = np.sum([one.areas for one in values.regions], axis=0) if values.regions else np.zeros(1)
    whole = float(sum(one.area for one in values.regions))
    rows.append(Row("area changed", "wall", "cm²", whole / CM2, *interval_of(sampled / CM2)))
    regions = wall_regions(subject, surface) if values.regions else None
    for k, one in enumerate(values.regions, 1):
        where = f"change {k}"
        if regions is not None:
            most = np.bincount(regions[one.inside], area[one.inside], len(REGIONS)).argmax()
            where += f", {word(int(most))}"
        rows.append(Row("area", where, "cm²", one.area / CM2, *interval_of(one.areas / CM2)))
        rows += _rows_of_region(one, values, where, column)
    return rows


def _rows_of_region(one: ChangedRegion, values: ValueChange, where: str, column: str) -> list[Row]:
    """Return what a region had and has in the mean, of logarithms where values are compared by ratio."""
    unit, ratio = ELECTRICAL[column], column in RATIOS
    seen = values.before[one.inside]
    before = float(np.exp(np.log(seen).mean()) if ratio else seen.mean())
    change, low, high = (
        before * np.expm1(x) if ratio else x for x in (one.change, *interval_of(one.changes))
    )
    return [
        Row(f"{column} before", where, unit, before),
        Row(f"{column} after", where, unit, before + change),
        Row(f"change of {column}", where, unit, change, low, high),
    ]


def _rows_of_shape(surface: Surface, shape: ShapeChange | None) -> list[Row]:
    if shape is None:
        return []
    area = surface.vertex_areas
    rows = [Row("area displaced", "wall", "cm²", float(area @ shape.changed) / CM2)]
    for name, sign in (("outward", 1.0), ("inward", -1.0)):
        way = np.where(shape.changed, sign * shape.change, 0.0)
        k = int(way.argmax())
        if way[k] > 0.0:
            ends = sorted((sign * float(shape.low[k]), sign * float(shape.high[k])))
            rows.append(Row("largest displacement", name, "mm", float(way[k]), *ends))
    return rows


def _volume_row(subjects: Sequence[Subject], samples: int, seed: int) -> Row:
    """Return the change of the volume that the last surfaces enclose."""
    first, second = (subject.last.estimate for subject in subjects)
    drawn = [
        np.array([one.volume for one in estimate.samples(samples, seed + k)]) / ML
        for k, estimate in enumerate((first, second))
    ]
    naive = (second.surface.volume - first.surface.volume) / ML
    return Row("change of volume", "wall", "ml", naive, *interval_of(drawn[1] - drawn[0]))


def _fields(column: str, values: ValueChange, shape: ShapeChange | None) -> dict[str, Array]:
    fields = {
        f"{column}_before": values.before,
        f"{column}_after": values.after,
        f"change_{column}": values.change,
        "change_low": values.low,
        "change_high": values.high,
        "changed": values.changed,
    }
    if shape is not None:
        fields |= {
            "displacement_mm": shape.change,
            "displacement_low": shape.low,
            "displacement_high": shape.high,
            "displaced": np.where(values.compared, shape.changed.astype(np.float64), np.nan),
        }
    return fields
