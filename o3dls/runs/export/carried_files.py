"""Each kind of file carried through a motion: what it holds is read, moved, and written with the deviation at
each place.

A function takes the file to read, the one to write, the way, and units and frame where the file states none.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Mask
from ...case import MILLIMETRES
from ...errors import InputError
from ...geometry.similarity import TURN, apply, inverse
from ...io.atomic import write_file
from ..conversion import in_millimetres
from ..stated import settle_stated, settle_units
from .facts import log_sentences
from .way import Carried, Way

MOST_LABEL = 255
TABLES = (".csv", ".tsv", ".xlsx")
TAKEN = (
    "what is carried: surfaces, lines in VTK, label volumes, Slicer's markups, tables and clouds of points"
)
MOST_VOXELS = 1 << 24


def carry_surface(source: Path, target: Path, way: Way, units: str | None, frame: str | None) -> Carried:
    """Carry a surface, with its fields. Raises InputError."""
    from ...io.meshes.surface_file import unused
    from ...io.surfaces import read_surface_file, write_surface

    file = in_millimetres(source, read_surface_file(source, units=units, frame=frame), units)
    if file.surface.dimension != 3:
        raise InputError(f"{source}: is an outline in 2D; the run is in 3D")
    space = settle_stated(source, "frame", file.space, frame)
    found = way(file.surface.vertices, space)
    more = {unused(name, file.surface.fields): values for name, values in found.columns.items()}
    surface = file.surface.with_vertices(found.xyz)
    surface = replace(surface, fields={**surface.fields, **more})
    losses = write_surface(target, surface, space=way.space_of(space))
    log_sentences(target, losses)
    return found


def carry_lines(source: Path, target: Path, way: Way, units: str | None, frame: str | None) -> Carried:
    """Carry lines, with their values. Raises InputError."""
    from ...io.clouds.lines import encode_lines, read_lines
    from ...io.text import read_bytes

    lines = read_lines(source, read_bytes(source))
    assert lines is not None  # told before
    space = settle_stated(source, "frame", lines.space, frame)
    found = way(lines.xyz * _unit(source, lines.units, units), space)
    values = {**lines.values, **found.columns}
    moved = replace(lines, xyz=found.xyz, values=values, space=way.space_of(space), units="mm")
    write_file(target, encode_lines(moved))
    return found


def carry_table(source: Path, target: Path, way: Way, units: str | None, frame: str | None) -> Carried:
    """Carry points or named places, with their columns. Raises InputError."""
    from ...io.points import read_points_table
    from ...io.table import write_table

    try:
        table = read_points_table(source)
    except InputError as error:
        if source.suffix.lower() in TABLES:
            raise
        raise InputError(f"{error} ({TAKEN})") from error
    space = settle_stated(source, "frame", table.notes.get("space", "unknown"), frame)
    xyz = np.column_stack([table.numbers(axis) for axis in "xyz"])
    found = way(xyz * _unit(source, table.notes.get("units", "unknown"), units), space)
    others = {name: table.values(name) for name in table.columns if name not in ("x", "y", "z")}
    columns = {**dict(zip("xyz", found.xyz.T, strict=True)), **others, **found.columns}
    write_table(target, columns, {"space": way.space_of(space), "units": "mm"})
    return found


def _unit(source: Path, stated: str, given: str | None) -> float:
    """Return how many mm a unit has; mm where nothing is said."""
    return MILLIMETRES.get(settle_units(source, stated, given), 1.0)


def carry_markups(source: Path, target: Path, way: Way, units: str | None, frame: str | None) -> Carried:
    """Carry every control point; what else a list of Slicer's holds, such as that it is a curve, stays.
    Raises InputError.
    """
    from ...io.markups import Markups, read_markups, write_markups

    if units:
        raise InputError(f"{source}: named places state their units; omit --units")
    marks = read_markups(source, frame)
    if not len(marks.xyz):
        raise InputError(f"{source}: holds no place")
    settle_stated(source, "frame", marks.space, frame)
    found = way(marks.xyz, marks.space)
    space = way.space_of(marks.space)
    if space == "unknown":
        raise InputError(f"{source}: neither it nor the run says its frame; state it with --frame")
    write_markups(target, Markups(marks.names, found.xyz, space))
    _complete_markups(source, target, found)
    return found


def _complete_markups(source: Path, target: Path, found: Carried) -> None:
    """Say the deviation in the description of each point, and keep the kinds of the lists of the source."""
    from ...io.documents import parse_json
    from ...io.text import decode, read_bytes

    text = decode(read_bytes(source), source)
    tree = parse_json(text, str(source)) if text.lstrip()[:1] == "{" else {}
    written = json.loads(target.read_text(encoding="utf-8"))
    (item,) = written["markups"]
    points = item["controlPoints"]
    for point, sd, known in zip(points, found.sd, found.columns["motion_known"], strict=True):
        point["description"] = f"sd {sd:.2f} mm" + ("" if known else ", not known")
    lists = tree.get("markups") if isinstance(tree, dict) else None
    if isinstance(lists, list):
        given = [part.get("controlPoints", []) for part in lists]
        placed = [one if isinstance(one, list) else [one] for one in given]  # as the reader takes them
        counts = [sum(one.get("positionStatus", "defined") == "defined" for one in part) for part in placed]
        ends = np.cumsum(counts)
        written["markups"] = [
            {**item, "type": part.get("type", "Fiducial"), "controlPoints": points[end - count : end]}
            for part, count, end in zip(lists, counts, ends.tolist(), strict=True)
        ]
    write_file(target, json.dumps(written, indent=1) + "\n")


def carry_labels(source: Path, target: Path, way: Way, units: str | None, frame: str | None) -> Carried:
    """Carry a label volume: each voxel of a grid on the other side takes the label of the voxel that it came
    from. Its grid has the axes and the voxels of the source, around what the labels came to.
    Raises InputError.
    """
    from ...io.images.registry import read_image
    from ...io.images.volumes import write_volume
    from ...io.text import read_bytes

    if units:
        raise InputError(f"{source}: volumes are in mm; omit --units")
    image = read_image(source, read_bytes(source), frame)
    labels = np.asarray(image.values)
    if labels.ndim != 3:
        raise InputError(f"{source}: has {labels.ndim} axes: a label volume is one volume in 3D")
    if not np.isin(labels, np.arange(MOST_LABEL + 1)).all():
        raise InputError(
            f"{source}: is not a volume of labels from 0 to {MOST_LABEL}; resample an image by the transform "
            "of o3dls export RUN --format itk"
        )
    if not labels.any():
        raise InputError(f"{source}: holds no label")
    space = settle_stated(source, "frame", image.space, frame)
    where = np.argwhere(_outermost(labels != 0))[:, ::-1]
    found = way(apply(image.affine, where), space)
    arrived = way.space_of(space)
    affine, shape = _grid_around(found.xyz, image.affine, turned={space, arrived} == {"LPS", "RAS"})
    nodes = apply(affine, np.indices(shape).reshape(3, -1).T)
    origin = way.back.places(nodes, arrived)
    origin = apply(TURN, origin) if {way.frame_from, space} == {"LPS", "RAS"} else origin
    index = np.rint(apply(inverse(image.affine), origin)).astype(np.int64)
    carried = _pick(labels.transpose(2, 1, 0), index).reshape(shape)
    write_volume(target, carried.astype(np.uint8), affine, space=arrived)
    return found


def _outermost(mask: Mask) -> Mask:
    """Return the voxels of a mask that touch its outside."""
    from scipy.ndimage import binary_erosion

    return np.asarray(mask & ~binary_erosion(mask))


def _grid_around(xyz: Array, affine: Array, *, turned: bool) -> tuple[Array, tuple[int, ...]]:
    """Return a grid of the same axes and voxels as `affine` (4, 4) around places (n, 3)."""
    axes = (TURN @ affine if turned else affine).copy()
    local = apply(inverse(axes), xyz)
    low = np.floor(local.min(axis=0)) - 1.0
    shape = (np.ceil(local.max(axis=0)) + 1.0 - low).astype(int) + 1
    if shape.prod() > MOST_VOXELS:
        raise InputError(
            f"carry: the labels would take {shape.prod():.3g} voxels: must be below {MOST_VOXELS:.3g}"
        )
    axes[:3, 3] = apply(axes, low[None])[0]
    return axes, tuple(shape.tolist())


def _pick(values: NDArray[Any], index: NDArray[np.int64]) -> NDArray[Any]:
    """Return the values at indices (n, 3), 0 outside."""
    inside = ((index >= 0) & (index < values.shape)).all(axis=1)
    found = np.zeros(len(index), dtype=values.dtype)
    found[inside] = values[tuple(index[inside].T)]
    return found
