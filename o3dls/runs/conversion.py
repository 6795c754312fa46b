"""One file into another format: surfaces, measured points, named places and poses.

Frame and units are said on both sides.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..adapters.mending import decimated, mended
from ..arrays import Array
from ..case import MILLIMETRES, SPACES
from ..errors import InputError
from ..geometry.similarity import TURN, apply
from ..io.case_coordinates import check_scale, overruled
from ..io.kinds import kind_of
from ..io.markups import Markups, read_markups, write_markups
from ..io.meshes.repair import closed_outward, joined_soup
from ..io.meshes.surface_file import SurfaceFile
from ..io.points import points_of, read_points_table, scaled
from ..io.surfaces import is_surface, read_surface_file, write_surface
from ..io.table import write_table
from ..io.text import read_bytes
from ..io.transforms import is_transform, read_transform, turned, write_transform
from .stated import needs_turn, scaled_units, settle_stated, settle_units

MARKUPS = (".json", ".fcsv")
# tables and clouds
POINTS = tuple(".csv .tsv .txt .asc .xlsx .xyz .xyzn .xyzrgb .pcd .pts .ply .vtk .vtp .vtu".split())  # noqa: SIM905


@dataclass(frozen=True)
class Mends:
    """These say what is done to a surface on its way: capped, repaired, decimated to so many faces."""

    cap: bool = False
    repair: bool = False
    faces: int | None = None


@dataclass(frozen=True)
class Spaces:
    """These are said of a conversion: units and frame of the source, and the frame to write in."""

    units: str | None
    frame: str | None
    to: str | None


def convert(
    source: str | Path,
    target: str | Path,
    *,
    format: str | None = None,
    units: str | None = None,
    frame: str | None = None,
    to: str | None = None,
    cap: bool = False,
    repair: bool = False,
    faces: int | None = None,
    **choice: Any,
) -> list[str]:
    """Write one file as another: a surface, points, named places or a pose; frame and units are said on both
    sides.

    Parameters
    ----------
    source : str or Path
        the file to read, its format told by its content.
    target : str or Path
        the file to write, its format told by its suffix; one that is there is replaced.
    format : str, default that of the suffix
        such as "carto_vtk", where a suffix stands for several formats.
    units : {"mm", "cm", "m", "um", "in", "px"}, default what the source states
        unit of the source, where it states none; what is written is in mm, or px.
    frame : {"LPS", "RAS", "unknown"}, default what the source states
        frame of the source, where it states none.
    to : {"LPS", "RAS"}, default the frame of the source
        frame to write in.
    cap : bool, default False
        close the openings of a surface.
    repair : bool, default False
        mend a surface: weld it, and leave out faces that are there twice, loose vertices and inner walls.
    faces : int, default None
        decimate a surface to so many triangles.
    **choice
        which surface is meant: options of a label volume, `part`, or `hidden` of CARTO's triangles; of a
        table `columns`, such as "bipolar=V1".

    Returns
    -------
    list of str
        sentences on what was read and what was written.

    Raises
    ------
    InputError
        where something contradicts the file, is missing, or does not apply to the kind of file.

    Examples
    --------
    >>> import o3dls
    >>> done = o3dls.convert("case/prior.ply", "ras.stl", frame="LPS", to="RAS", faces=2000)
    >>> len(o3dls.read_surface("ras.stl").faces) <= 2000
    True
    """
    source, target = Path(source), Path(target)
    for name, value, allowed in (
        ("units", units, tuple(MILLIMETRES)),
        ("frame", frame, SPACES),
        ("to", to, SPACES[:2]),
    ):
        if value is not None and value not in allowed:
            raise InputError(f"{name} = '{value}': must be one of {', '.join(allowed)}")
    said = Spaces(units, frame, to)
    if is_surface(source):
        return _convert_surface(source, target, said, format, Mends(cap, repair, faces), choice)
    suffix, pose = source.suffix.lower(), is_transform(source)
    if not pose and (kind := kind_of(read_bytes(source))) and suffix != ".xlsx":
        raise InputError(f"{source}: is {kind}")
    if suffix not in (*POINTS, *MARKUPS) and not pose:
        raise InputError(
            f"{source}: is not a surface, points (a table or a cloud), named places (.mrk.json, .fcsv) or "
            "pose (.tfm, .txt, .mat) that o3dls knows; is it damaged?"
        )
    columns = choice.pop("columns", None)
    chosen = any(value is not None and value is not False for value in choice.values())
    if cap or repair or faces is not None or format or chosen:
        raise InputError(
            f"{source}: is not a surface, so cap, repair, faces, format, label, part, box, layer and hidden "
            "do not apply to it"
        )
    if not pose and suffix not in MARKUPS:
        return _convert_points(source, target, said, columns)
    if columns is not None:
        raise InputError(f"{source}: is not a table of points, so columns do not apply to it")
    return (_convert_transform if pose else _convert_markups)(source, target, said)


def _convert_surface(
    source: Path, target: Path, said: Spaces, format: str | None, mends: Mends, choice: dict[str, Any]
) -> list[str]:
    file = read_surface_file(source, units=said.units, frame=said.frame, **choice)
    file = in_millimetres(source, file, said.units)
    surface = file.surface
    space = settle_stated(source, "frame", file.space, said.frame)
    done = [
        f"{source}: {len(surface.vertices)} vertices, {len(surface.faces)} faces, frame {space}, units "
        f"{file.units}",
        *(f"{source}: {note}" for note in file.notes),
    ]
    if said.to and surface.dimension == 2:
        raise InputError(f"{source}: is an outline in 2D, and LPS and RAS are frames in 3D; omit --to")
    if said.to and needs_turn(source, space, said.to):
        surface = surface.transformed(TURN)
    surface, joined = joined_soup(surface)
    done += [f"{source}: {joined}"] if joined else []
    if mends.repair:
        surface, changes = mended(surface, str(source))
        done += [f"{source}: {change}" for change in changes]
    if mends.cap:
        surface = closed_outward(surface, str(source), cap=True)
    if mends.faces is not None and mends.faces < len(surface.faces):
        surface = decimated(surface, mends.faces)
    space = said.to or space
    losses = write_surface(target, surface, space=space, units=file.units, format=format)
    # DIF is in LPS by definition, and its writer has turned the surface
    space = "LPS" if space == "RAS" and target.suffix.lower() == ".xml" else space
    return [
        *done,
        f"{target}: {len(surface.vertices)} vertices, {len(surface.faces)} faces, frame {space}, units "
        f"{file.units}",
        *(f"{target}: {loss}" for loss in losses),
    ]


def in_millimetres(source: Path, file: SurfaceFile, units: str | None) -> SurfaceFile:
    """Return the surface in mm where its units are stated by the file or by `units`.

    Else as it is, if its extent can be meant in mm.
    """
    settled = overruled(source, file, units)
    if settled is not file:
        return settled
    stated = settle_units(source, str(file.metadata.get("stated_units", file.units)), units)
    if stated == "unknown":
        if file.surface.dimension == 3:
            check_scale(source, file.surface.vertices)
        return file
    scale = MILLIMETRES[file.units if file.units in MILLIMETRES else stated]
    surface = file.surface.with_vertices(file.surface.vertices * scale)
    return replace(file, surface=surface, units=scaled_units(stated))


def _convert_markups(source: Path, target: Path, said: Spaces) -> list[str]:
    """Write Slicer's named places as Slicer's file or as a table `name,x,y,z`."""
    if said.units:
        raise InputError(f"{source}: Slicer's markups state their units; omit --units")
    marks = read_markups(source, said.frame)
    settle_stated(source, "frame", marks.space, said.frame)
    return _write_places(source, target, marks.in_space(said.to) if said.to else marks)


def _write_places(source: Path, target: Path, marks: Markups) -> list[str]:
    if target.suffix.lower() == ".json":
        write_markups(target, marks)
    elif target.suffix.lower() == ".csv":
        columns = {"name": np.array(marks.names), **dict(zip("xyz", marks.xyz.T, strict=True))}
        write_table(target, columns, {"space": marks.space, "units": "mm"})
    else:
        raise InputError(f"{target}: named places are written as .mrk.json or .csv")
    return [f"{source}: {len(marks.names)} named places", f"{target}: frame {marks.space}, units mm"]


def _convert_points(source: Path, target: Path, said: Spaces, meant: str | None) -> list[str]:
    """Convert tables of points or of named places; all columns are kept where the target is a table too."""
    table = read_points_table(source, columns=meant)
    points = points_of(table, 3)
    done = [f"{source}: {len(points)} points", *(f"{source}: {note}" for note in points.notes)]
    space = settle_stated(source, "frame", table.notes.get("space", "unknown"), said.frame)
    stated = settle_units(source, table.notes.get("units", "unknown"), said.units)
    if stated == "unknown":
        check_scale(source, points.xyz)
    points = scaled(points, MILLIMETRES.get(stated, 1.0))
    xyz = apply(TURN, points.xyz) if said.to and needs_turn(source, space, said.to) else points.xyz
    space, units = said.to or space, scaled_units(stated)
    columns = {**dict(zip("xyz", xyz.T, strict=True)), "type": points.type, **points.columns}
    if target.suffix.lower() == ".csv":
        write_table(target, {name: columns[name] for name in table.columns}, {"space": space, "units": units})
        return [*done, f"{target}: frame {space}, units {units}"]
    if target.suffix.lower() != ".json":
        raise InputError(f"{target}: points are written as .csv or .mrk.json")
    if units == "px":
        raise InputError(f"{target}: Slicer's markups are in mm, and {source} is in px")
    names = points.columns.get("name", np.full(len(points), ""))
    return _write_places(source, target, Markups(tuple(map(str, names)), xyz, space))


def _convert_transform(source: Path, target: Path, said: Spaces) -> list[str]:
    if said.units:
        raise InputError(f"{source}: a pose moves by mm; omit --units")
    matrix, stated = read_transform(source)
    space = settle_stated(source, "frame", stated, said.frame)
    if said.to and needs_turn(source, space, said.to):
        matrix = turned(matrix)
    write_transform(target, matrix, said.to or space)
    return [f"{source}: pose {_describe_pose(matrix)}", f"{target}: frame {said.to or space}"]


def _describe_pose(matrix: Array) -> str:
    return re.sub(r"\s+", " ", np.array2string(matrix, precision=3, suppress_small=True))
