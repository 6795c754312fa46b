"""One file into another format: surfaces, measured points, named places and poses; frame and units said on both sides."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .errors import InputError
from .geometry import Array, Surface
from .io.case_folder import check_scale
from .io.case_settings import MILLIMETRES
from .io.markups import Markups, read_markups, write_markups
from .io.mesh import is_surface, read_surface_file, write_surface
from .io.points import points_of, read_points_table, write_points
from .io.repair import closed_outward, welded
from .io.surface_file import SPACES, SurfaceFile
from .io.table import read_table, write_table
from .io.transforms import TURN, read_transform, turned, write_transform

MARKUPS = (".json", ".fcsv")
TRANSFORMS = (".tfm", ".txt")


def convert(
    source: str | Path, target: str | Path, *,
    format: str | None = None, units: str | None = None, frame: str | None = None, to: str | None = None,
    cap: bool = False, faces: int | None = None, **choice: Any,
) -> list[str]:  # fmt: skip
    """Write `source` as `target`; the format of the one is told by its content, of the other by its suffix (or `format`).

    units, frame: what the source is in where it does not say so itself. to: the frame to write, LPS or RAS. cap: close openings.
    faces: decimate to so many. choice: label, part, box, hidden of the reader. Gives sentences on what was done. Raises InputError where
    something contradicts the file, is missing, or means nothing for the kind of file.
    """
    source, target = Path(source), Path(target)
    for name, value, allowed in (("units", units, tuple(MILLIMETRES)), ("frame", frame, SPACES), ("to", to, SPACES[:2])):
        if value is not None and value not in allowed:
            raise InputError(f"{name} = '{value}': must be one of {', '.join(allowed)}")
    if is_surface(source):
        return _surface(source, target, format, units, frame, to, cap=cap, faces=faces, choice=choice)
    if cap or faces is not None or format or any(value is not None for value in choice.values()):
        raise InputError(f"{source}: is no surface, so cap, faces, format, label, part, box and hidden mean nothing for it")
    if source.suffix in TRANSFORMS:
        return _transform(source, target, frame, to)
    return _markups(source, target, units, frame, to) if source.suffix in MARKUPS else _points(source, target, units, frame, to)


def _surface(
    source: Path, target: Path, format: str | None, units: str | None, frame: str | None, to: str | None, *,
    cap: bool, faces: int | None, choice: dict[str, Any],
) -> list[str]:  # fmt: skip
    file = in_millimetres(source, read_surface_file(source, **choice), units)
    surface, space = file.surface, _settled(source, "frame", file.space, frame)
    done = [f"{source}: {len(surface.vertices)} vertices, {len(surface.faces)} faces, frame {space}, units {file.units}"]
    if to and _turns(source, space, to):
        surface = surface.transformed(TURN)
    if cap:
        surface = closed_outward(surface, str(source), cap=True)
    if faces is not None and faces < len(surface.faces):
        surface = decimated(surface, faces)
    write_surface(target, surface, space=to or space, units=file.units, format=format)
    return [*done, f"{target}: {len(surface.vertices)} vertices, {len(surface.faces)} faces, frame {to or space}, units {file.units}"]


def in_millimetres(source: Path, file: SurfaceFile, units: str | None) -> SurfaceFile:
    """The surface in mm where its units are stated by the file or by `units`; else as it is, if its extent can be meant in mm."""
    stated = _settled(source, "units", file.units, units)
    if stated == "unknown":
        if file.surface.dimension == 3:
            check_scale(source, file.surface.vertices)
        return file
    if stated not in MILLIMETRES:
        raise InputError(f"{source}: states units '{stated}': must be one of {', '.join(MILLIMETRES)}; say which with --units")
    surface = file.surface.with_vertices(file.surface.vertices * MILLIMETRES[stated])
    return replace(file, surface=surface, units="px" if stated == "px" else "mm")


def _settled(source: Path, what: str, stated: str, given: str | None) -> str:
    """What the file states, or what is given where it states nothing. Raises InputError where the two differ."""
    if given and stated not in ("unknown", given):
        raise InputError(f"{source}: states {what} {stated}, and {given} was given; leave --{what} away if the file is right")
    return given or stated


def _turns(source: Path, space: str, to: str) -> bool:
    """Whether coordinates must be turned. Raises InputError where the frame is not known."""
    if space not in ("LPS", "RAS"):
        raise InputError(f"{source}: its frame is not known, so it cannot be brought to {to}; state it with --frame")
    return space != to


def decimated(surface: Surface, faces: int) -> Surface:
    """About `faces` triangles by quadric edge collapse that keeps the topology; fields are read at the closest points of the original."""
    import pymeshlab

    from .extract import carry_fields

    if faces < 4 or surface.dimension != 3:
        raise InputError(f"faces = {faces}: only surfaces in 3D are decimated, to at least 4 triangles")
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(surface.vertices, surface.faces.astype(np.int32)))
    meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=faces, preservetopology=True, preservenormal=True, preserveboundary=True)
    meshes.meshing_remove_unreferenced_vertices()
    mesh = meshes.current_mesh()
    if mesh.face_number() > faces:
        raise InputError(
            f"the surface cannot be decimated to {faces} triangles without changing its topology; {mesh.face_number()} are left"
        )
    return carry_fields(surface, welded(Surface(mesh.vertex_matrix(), mesh.face_matrix())))


def _markups(source: Path, target: Path, units: str | None, frame: str | None, to: str | None) -> list[str]:
    """Slicer's named places to Slicer's file or to a table `name,x,y,z`."""
    if units:
        raise InputError(f"{source}: Slicer's markups state their units; leave --units away")
    marks = read_markups(source)
    _settled(source, "frame", marks.space, frame)
    return _write_places(source, target, marks.in_space(to) if to else marks)


def _write_places(source: Path, target: Path, marks: Markups) -> list[str]:
    if target.suffix == ".json":
        write_markups(target, marks)
    elif target.suffix == ".csv":
        columns = {"name": np.array(marks.names), **dict(zip("xyz", marks.xyz.T, strict=True))}
        write_table(target, columns, {"space": marks.space, "units": "mm"})
    else:
        raise InputError(f"{target}: named places are written as .mrk.json or .csv")
    return [f"{source}: {len(marks.names)} named places", f"{target}: frame {marks.space}, units mm"]


def _points(source: Path, target: Path, units: str | None, frame: str | None, to: str | None) -> list[str]:
    """Tables of points or of named places; columns and types are kept where the target is a table too."""
    table = read_points_table(source)
    space = _settled(source, "frame", table.notes.get("space", "unknown"), frame)
    stated = _settled(source, "units", table.notes.get("units", "unknown"), units)
    if stated == "unknown":
        check_scale(source, np.column_stack([table.numbers(axis) for axis in "xyz"]))
    points = points_of(table, 3)
    turn = np.array([-1.0, -1.0, 1.0]) if to and _turns(source, space, to) else np.ones(3)
    points = replace(points, xyz=points.xyz * turn * MILLIMETRES.get(stated, 1.0))
    if target.suffix == ".json":
        names = points.columns.get("name", np.full(len(points), ""))
        return _write_places(source, target, Markups(tuple(map(str, names)), points.xyz, to or space))
    if target.suffix != ".csv":
        raise InputError(f"{target}: points are written as .csv or .mrk.json")
    if "type" in table.columns or "name" not in table.columns:
        write_points(target, points, space=to or space, units="unknown" if stated == "unknown" else "mm")
    else:
        columns = read_table(source, ("name",)).columns
        write_table(target, {"name": np.array(columns["name"]), **dict(zip("xyz", points.xyz.T, strict=True))}, {"space": to or space})
    return [f"{source}: {len(points)} points", f"{target}: frame {to or space}"]


def _transform(source: Path, target: Path, frame: str | None, to: str | None) -> list[str]:
    matrix, stated = read_transform(source)
    space = _settled(source, "frame", stated, frame)
    if to and _turns(source, space, to):
        matrix = turned(matrix)
    write_transform(target, matrix, to or space)
    return [f"{source}: pose {_sentence(matrix)}", f"{target}: frame {to or space}"]


def _sentence(matrix: Array) -> str:
    return re.sub(r"\s+", " ", np.array2string(matrix, precision=3, suppress_small=True))
