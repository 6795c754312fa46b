"""What points and lesions of a map have to do with a field of its wall, such as what its image shows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...case import Points
from ...errors import InputError, did_you_mean
from ...evaluation.electrical import ELECTRICAL
from ...evaluation.interpolation import REACH
from ...evaluation.measures.intervals import LEVEL, Measure, summarise
from ...evaluation.measures.lesions import Lesions, Scar, draw_lesions
from ...evaluation.measures.line import crossing, fit_line
from ...evaluation.measures.numbers import Quantity
from ...evaluation.measures.readings import read_at_points
from ...evaluation.projection import project
from ...evaluation.wall_image import RATIO
from ...io.points import read_points
from ...io.surfaces import read_surface
from ...motion.wall.samples import SurfaceSamples
from ...quantities import VOLTAGES
from ...runs.image.values import FOLDER
from ..subject import Subject
from ..surfaces.beliefs import BELIEVED, beliefs

FROM_IMAGE = Path(FOLDER) / "result.vtp"
POINTS = "points"  # where a line is measured
Field = tuple[str, Array]


def wall_field(subject: Subject, name: str | None) -> Field | None:
    """Return a field of the last surface that came with the prior, or that `o3dls wall` has written, with its
    name; by default the ratio of an image, where there is one. Raises InputError where there is none of that
    name.
    """
    surface = subject.last.estimate.surface
    fields = dict(surface.fields)
    for folder in subject.folders[-1:]:
        if (folder / FROM_IMAGE).is_file():
            seen = read_surface(folder / FROM_IMAGE)
            fields |= seen.fields if np.array_equal(seen.faces, surface.faces) else {}
    wanted = name or RATIO
    if wanted in fields:
        return wanted, np.asarray(fields[wanted], dtype=np.float64)
    if name is None:
        return None
    raise InputError(
        f"{subject.folders[-1]}: its wall has no field '{name}'{did_you_mean(name, list(fields))}"
    )


def measure_line(
    subject: Subject,
    samples: SurfaceSamples,
    values: tuple[str, tuple[float, ...]],
    field: Field,
    rng: np.random.Generator,
) -> list[Measure]:
    """Measure the slope of a column of the points over a field of the wall, and where the line has each of
    its thresholds: of the logarithms of voltages. Empty where too few points have both.
    """
    column, thresholds = values
    points, weights = _mapping_points(subject)
    measured = points.numbers(column)
    measured[weights < BELIEVED] = np.nan
    name, of_wall = field
    log = column in VOLTAGES
    if log:
        measured = np.log(np.where(measured > 0.0, measured, np.nan))
    noise = (subject.last.estimate.sigma or 0.0) * points.relative_noise()
    line = fit_line(measured, read_at_points(samples, of_wall, points.xyz, noise, rng))
    if line is None:
        return []
    said = f"slope of {'ln ' if log else ''}{column} over {name}"
    slope = Quantity(said, POINTS, "1")
    found = [Measure(slope, float(line.naive[1]), float(line.found[1]), *line.slope_interval(LEVEL))]
    for threshold in thresholds:
        at = float(np.log(threshold)) if log else threshold
        where = Quantity(f"{name} at {threshold:g} {ELECTRICAL[column]}", POINTS, "1")
        ends = line.crossing_interval(at, LEVEL)
        found.append(Measure(where, crossing(line.naive, at), crossing(line.found, at), *ends))
    return found


def _mapping_points(subject: Subject) -> tuple[Points, Array]:
    """Return the points that map the wall, free of an offset of a part of them, and how likely each (n,)
    touches the last surface; NaN where that is not known.
    """
    last = subject.last
    points = last.estimate.corrected(last.run.case).points
    mapping = points.type == "eam"
    return points.select(mapping), beliefs(last.run, last.key)[mapping]


def measure_lesions(
    subject: Subject,
    samples: SurfaceSamples,
    path: Path,
    scars: Mapping[str, tuple[Array, bool]],
    rng: np.random.Generator,
) -> list[Measure]:
    """Measure gaps and distances of the lesions of a file, to scars (field that is below 0 there, and whether
    it goes with the wall) by name. Raises InputError where it cannot be read or none lies near the wall.
    """
    lesions = read_lesions(path, subject.last.estimate.sigma or 0.0)
    far = project(lesions.xyz, samples.surface).distance
    if far.max() > REACH:
        worst = int(far.argmax())
        raise InputError(
            f"{path}: lesion '{lesions.names[worst]}' lies {far[worst]:.0f} mm from the wall: must be in "
            f"mm, in the frame of the map, and within {REACH:g} mm of it"
        )
    naive, drawn = draw_lesions(samples, lesions, {name: Scar(*one) for name, one in scars.items()}, rng)
    return [summarise(quantity, naive[quantity], values) for quantity, values in drawn.items()]


def read_lesions(path: Path, noise: float) -> Lesions:
    """Read lesions from a table with columns x, y, z, in mm and in the frame of the map: of a points table
    those of type `ablation`, if there are any. Columns `name`, `line` and `sigma` where it has them; noise:
    sd in mm of those without. Raises InputError where a name comes twice.
    """
    points = read_points(path)
    if (points.type == "ablation").any():
        points = points.of("ablation")
    given = points.numbers("sigma")
    sd = np.where(np.isfinite(given), given, noise)
    if (sd < 0.0).any():
        raise InputError(f"{path}: sigma of lesion {int(np.argmin(sd)) + 1} is below 0: must be an sd in mm")
    names = tuple(str(k + 1) for k in range(len(points)))
    if "name" in points.columns:
        names = tuple(str(one) or own for one, own in zip(points.columns["name"], names, strict=True))
    if len(twice := [one for one in set(names) if names.count(one) > 1]):
        raise InputError(f"{path}: lesion '{min(twice)}' is there twice: each needs a name of its own")
    return Lesions(names, points.xyz, sd, tuple(map(str, points.columns.get("line", ()))))
