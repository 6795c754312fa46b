"""What `o3dls activation` and the report compute of a finished run: when the wave comes by, how fast, and
which way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import Array, Mask
from ...errors import InputError
from ...evaluation.electrical import measured_values
from ...evaluation.interpolation import to_surface
from ...evaluation.measures.intervals import LEVEL
from ...evaluation.measures.numbers import CM2, named_parts, slopes
from ...evaluation.regions import REGIONS, valve_of, word
from ...geometry.surface import Surface
from ..subject import Subject, read_subject
from .row_table import interval_of
from .wall_regions import landmarks_in_map, wall_regions

if TYPE_CHECKING:
    from ...evaluation.activation.activation_map import ActivationMap

SAMPLES, SEED = 200, 0
LEAST_SHARE = 0.02  # of the mapped wall: of less a region says nothing
FULL_CYCLE = 0.85  # of the times' range: so far apart are neighbours where early meets late
NEAR = 10.0  # mm, neighbours
TIME, TIME_SD, SPEED = "activation", "activation_sd", "conduction_speed"  # fields as the report shows them
SHOWN = {TIME: "lat", TIME_SD: "lat_sd", SPEED: "speed"}  # and as they are here


@dataclass(frozen=True)
class Row:
    """A row of the table has what it is, where, its unit, the number without the model (naive), the number
    and its interval; NaN where there is none.
    """

    what: str
    where: str
    unit: str
    naive: float
    value: float
    low: float = np.nan
    high: float = np.nan


@dataclass(frozen=True, eq=False)
class Activation:
    """An activation has the case's name, the cycle length in ms if one was given, the rows of the table, the
    last surface with its fields and frame, and sentences of what to look at.
    """

    name: str
    cycle: float | None
    rows: list[Row]
    surface: Surface
    frame: str
    remarks: list[str]


def activation_of(
    folder: Path, *, cycle: float | None = None, samples: int = SAMPLES, seed: int = SEED
) -> Activation:
    """Map the activation of the last surface of a finished run by its points' column `lat`.

    Raises InputError where the run is in 2D or pixels, has no posterior in space, or its points no times.
    """
    if cycle is not None and cycle <= 0.0:
        raise InputError(f"cycle = {cycle:g} ms: must be more than 0")
    try:
        return _map_subject(read_subject([folder]), cycle, samples, seed)
    except InputError as error:
        raise InputError(f"{folder}: {error}") from error


@lru_cache(maxsize=1)  # the pictures and the section below them show the same map
def shown_activation(subject: Subject) -> Activation | None:
    """Map the activation of a subject for its report; None where that is not asked for or cannot be done, as
    in `activation_of`, or too few of its points have a time.
    """
    if not subject.activation:
        return None
    try:
        return _map_subject(subject, None, SAMPLES, SEED)
    except InputError:
        return None


def with_activation(subject: Subject, surfaces: Mapping[str, Surface]) -> dict[str, Surface]:
    """Return surfaces by the names of their estimates, the last with its activation as fields, where there is
    one.
    """
    if (found := shown_activation(subject)) is None:
        return dict(surfaces)
    last = surfaces[subject.last.name]
    near = cKDTree(found.surface.vertices).query(last.vertices)[1]  # it may have fewer faces
    fields = {name: found.surface.fields[own][near] for name, own in SHOWN.items()}
    return {**surfaces, subject.last.name: replace(last, fields={**last.fields, **fields})}


def _map_subject(subject: Subject, cycle: float | None, samples: int, seed: int) -> Activation:
    """Map the activation of the last surface of a subject; as `activation_of`."""
    if subject.case.dimension == 2 or subject.unit != "mm":
        raise InputError(f"is in {subject.case.dimension}D and {subject.unit}: must be in 3D and mm")
    estimate = subject.last.estimate
    found = measured_values(estimate.corrected(subject.case).points, ["lat"])
    if "lat" not in found:
        raise InputError("its points have no column 'lat': must have activation times in ms")
    # imported late: a page without an activation, as most are, should not wait for it
    from ...evaluation.activation.activation_map import map_activation

    surface, (xyz, times) = estimate.surface, found["lat"]
    wall = ~valve_of(surface, landmarks_in_map(subject))
    errors = estimate.samples(samples, seed).vertices - surface.vertices
    activation = map_activation(surface, xyz, times, wall=wall, errors=errors, cycle=cycle)
    names = {k: word(k) for k in range(len(REGIONS))}
    regions = named_parts(wall_regions(subject, surface), names, wall)
    rows = _list_rows(activation, regions, to_surface(xyz, times, surface), samples, seed)
    remarks = _remark_on(activation, xyz, times)
    fields = replace(surface, fields=_make_fields(activation))
    return Activation(subject.case.name, cycle, rows, fields, subject.case.frame, remarks)


def _list_rows(
    found: ActivationMap, regions: Mapping[str, Mask], naive: Array, samples: int, seed: int
) -> list[Row]:
    """Return the rows of the wall, then of each region that enough of is mapped."""
    surface = found.posterior.harmonics.surface
    area, told = surface.vertex_areas, found.has_velocity
    times, speeds = found.samples(samples, seed + 1)
    naive_speed = 1.0 / np.maximum(np.linalg.norm(slopes(surface, naive), axis=1), 1e-9)
    rows = list[Row]()
    for name, inside in regions.items():
        mapped = inside & found.known
        share = float(area @ mapped) / max(float(area @ found.known), 1e-9)
        if share < LEAST_SHARE:
            continue
        rows.append(Row("area mapped", name, "cm²", np.nan, float(area @ mapped) / CM2))
        if found.cycle is None:
            rows += _list_times(found, mapped, name, naive, times)
        some = inside & told
        rows.append(Row("area with a velocity", name, "cm²", np.nan, float(area @ some) / CM2))
        if some.any():
            weights = area[some]
            drawn = np.array([_find_median(one[some], weights) for one in speeds])
            plain = _find_median(naive_speed[some], weights)
            value = _find_median(found.velocity.speed[some], weights)
            rows.append(Row("speed, median", name, "m/s", plain, value, *interval_of(drawn)))
    return rows


def _list_times(found: ActivationMap, mapped: Mask, name: str, naive: Array, times: Array) -> list[Row]:
    """Return the earliest and the latest time of a part of the wall (n,), and how far they are apart."""
    sampled, mean = times[:, mapped], found.time[mapped]
    first, last = sampled.min(axis=1), sampled.max(axis=1)
    seen = naive[mapped]
    plain = float(np.nanmin(seen)), float(np.nanmax(seen))
    rows = [
        Row("earliest", name, "ms", plain[0], float(mean.min()), *interval_of(first)),
        Row("latest", name, "ms", plain[1], float(mean.max()), *interval_of(last)),
        Row(
            "activation time",
            name,
            "ms",
            plain[1] - plain[0],
            float(np.ptp(mean)),
            *interval_of(last - first),
        ),
    ]
    if name == "wall":
        at = found.posterior.harmonics.surface.vertices[mapped]
        for what, site, drawn in (
            ("earliest site within", mean.argmin(), sampled.argmin(axis=1)),
            ("latest site within", mean.argmax(), sampled.argmax(axis=1)),
        ):
            away = np.linalg.norm(at[drawn] - at[site], axis=1)
            rows.append(Row(what, name, "mm", np.nan, float(np.quantile(away, LEVEL))))
    return rows


def _find_median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def _remark_on(found: ActivationMap, xyz: Array, times: Array) -> list[str]:
    """Return sentences of times that look wrong, and of early wall beside late wall."""
    said = list[str]()
    doubted = int((found.trust < 0.5).sum())
    if doubted:
        do = (
            "does not fit those about it and counts"
            if doubted == 1
            else "do not fit those about them and count"
        )
        said.append(f"{doubted} of {len(found.rows)} times {do} for little.")
    trusted = found.rows[found.trust >= 0.5]
    if found.cycle is None and _meets_late(xyz[trusted], times[trusted]):
        said.append(
            f"Early wall ({times[trusted].min():.0f} ms) lies beside late wall "
            f"({times[trusted].max():.0f} ms): where the wave goes round and round, give its cycle length, "
            "--cycle."
        )
    return said


def _meets_late(xyz: Array, times: Array) -> bool:
    """Return whether several points of the earliest tenth of the range lie beside some of the latest."""
    span = np.ptp(times)
    margin = 0.5 * (1.0 - FULL_CYCLE) * span
    early, late = times < times.min() + margin, times > times.max() - margin
    apart = np.linalg.norm(xyz[early][:, None] - xyz[late][None], axis=2)
    return int((apart < NEAR).any(axis=1).sum()) >= 3


def _make_fields(found: ActivationMap) -> dict[str, Array]:
    told, known = found.has_velocity, found.known
    fields = {"lat": np.where(known, found.time, np.nan), "lat_sd": np.where(known, found.sd, np.nan)}
    speed = found.velocity
    fields |= {
        name: np.where(told, values, np.nan)
        for name, values in (("speed", speed.speed), ("speed_low", speed.low), ("speed_high", speed.high))
    }
    return fields | {"velocity": found.vectors, "untold": found.told.astype(np.float64)}
