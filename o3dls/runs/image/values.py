"""Values of the prior's image on its wall and on the result, beside the electrical ones; and a table of the
points with what the image has at the place of each.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...evaluation.interpolation import REACH
from ...evaluation.projection import project
from ...evaluation.transfer import between
from ...evaluation.wall_image import Blood, Layer, values_on_wall
from ...geometry.label_fields import read_at
from ...geometry.surface import Surface
from ...io.atomic import write_file
from ...io.grey.of_case import log_gap, open_kept_image
from ...io.manifest import noted
from ...io.surfaces import write_surface
from ...io.table import write_table
from ...places import make_folder
from ..estimate_files import IN_WALL
from ..export.placed import recorded
from ..folder import read_run
from ..run import Run

FOLDER = "wall"
MEASURED = ("name", "bipolar", "unipolar", "lat")


@dataclass(frozen=True, eq=False)
class ImageValues:
    """These are the values of an image on the prior (in its frame) and on the result (in the map's), in the
    fields `image_value` and `image_ratio`; `points` are columns of a table with a row for each eam point.
    """

    prior: Surface
    result: Surface
    points: dict[str, Any]
    blood: Blood


def with_named_image(folder: Path, image: str | Path | None) -> Run:
    """Read a run, with another image of its prior where one is named. Raises InputError where it has none."""
    run = read_run(folder)
    if image is not None:
        run = replace(run, case=replace(run.case, image={"path": str(Path(image).absolute())}))
    if not run.case.image:
        raise InputError(f"{folder}: the run's case has no image of its prior; name one with --image")
    if image is None and not Path(run.case.image["path"]).exists():
        raise InputError(f"the image is no longer at {run.case.image['path']}; name where it is by --image")
    if run.case.dimension != 3:
        raise InputError(f"{folder}: the run is of a case in 2D: an image is in 3D")
    return run


def image_values(run: Run, layer: Layer) -> ImageValues:
    """Sample the image of a run's case on the wall of its prior, and carry the values with the motion of the
    final estimate to the result, and what was measured to the prior. Raises InputError where the image cannot
    be read.
    """
    case, estimate = run.case, run.estimates[run.final]
    motion = recorded(case, estimate)
    image = open_kept_image(case)
    log_gap(image, case)
    on_wall, blood = values_on_wall(image, case.prior, layer)
    measured = between(estimate.surface, case.prior, target_motion=motion)
    prior = replace(measured, fields={**measured.fields, **on_wall.fields})
    result = between(on_wall, estimate.surface, source_motion=motion)
    return ImageValues(prior, result, _tabulate_points(run, on_wall, result), blood)


def _tabulate_points(run: Run, on_wall: Surface, result: Surface) -> dict[str, Any]:
    """Return a row for each eam point: where it is on the map and on the image, what was measured, and what
    the image has on the wall at its place.
    """
    motion = recorded(run.case, run.estimates[run.final])
    points = run.points.of("eam")
    places = motion.inverse(points.xyz)
    at = project(places, on_wall)
    corners = on_wall.faces[at.face]
    fields = {
        **on_wall.fields,
        "sd_mm": motion.deviation,
        "sd_in_wall_mm": motion.moved.fields.get(IN_WALL, np.full(len(on_wall.vertices), np.nan)),
    }
    near = at.distance <= REACH
    found = {
        name: np.where(near, read_at(name, values, corners, at.weights), np.nan)
        for name, values in fields.items()
    }
    columns = {name: points.columns[name] for name in MEASURED if name in points.columns}
    coordinates = dict(zip("xyz", points.xyz.T, strict=True))
    coordinates |= {f"image_{axis}": values for axis, values in zip("xyz", places.T, strict=True)}
    distance = points.columns[f"distance_{run.final}_mm"]
    return coordinates | columns | found | {"distance_mm": distance, "prior_only": _at(points.xyz, result)}


def _at(xyz: Array, result: Surface) -> Array:
    """Return the field `prior_only` of the result at the places nearest to points; NaN where it has none."""
    values = result.fields.get("prior_only", np.full(len(result.vertices), np.nan))
    at = project(xyz, result)
    return np.asarray(np.round(read_at("prior_only", values, result.faces[at.face], at.weights)))


def write_image_values(
    folder: str | Path, layer: Layer, out: str | Path | None = None, image: str | Path | None = None
) -> tuple[Path, ImageValues]:
    """Write what `image_values` finds of a finished run: prior.vtp, result.vtp, points.csv and wall.json,
    into `out`, by default the run's folder wall. `image`: another one of the prior.

    Raises InputError where the run has no image and none is given, or it cannot be read.
    """
    folder = Path(folder)
    run = with_named_image(folder, image)
    found = image_values(run, layer)
    target = folder / FOLDER if out is None else Path(out)
    within = folder if out is None else None
    facts = {
        "image": dict(run.case.image),
        "estimate": run.final,
        "layer_mm": [layer.low, layer.high],
        "take": layer.take,
        "blood": asdict(found.blood),
        "frames": {"prior.vtp": run.case.prior_frame, "result.vtp": run.case.frame},
    }
    with noted(folder):
        make_folder(target)
        write_surface(target / "prior.vtp", found.prior, space=run.case.prior_frame)
        write_surface(target / "result.vtp", found.result, space=run.case.frame)
        write_table(target / "points.csv", found.points, {"space": run.case.frame, "units": "mm"})
        write_file(target / "wall.json", json.dumps(facts, indent=1) + "\n", within=within)
    return target, found
