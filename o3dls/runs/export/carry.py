"""Files carried through the motion of a run: surfaces, clouds, lines, label volumes and named places."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

from ...errors import InputError, did_you_mean
from ...io.atomic import staged_files
from ...places import make_folder
from .carried_files import carry_labels, carry_lines, carry_markups, carry_surface, carry_table
from .facts import log_sentences
from .way import Carried, To, Way, way_of

Carry = Callable[[Path, Path, Way, str | None, str | None], Carried]

SUFFIXES = {"surface": ".vtp", "lines": ".vtk", "labels": ".nrrd", "markups": ".mrk.json", "table": ".csv"}


def carry(
    folder: str | Path,
    source: str | Path,
    to: To,
    out: str | Path | None = None,
    *,
    estimate: str | None = None,
    units: str | None = None,
    frame: str | None = None,
) -> Path:
    """Write a file as it lies on the other side of a finished run.

    Parameters
    ----------
    folder : str or Path
        the run, whose motion takes things from the prior's image to the map.
    source : str or Path
        a surface, a cloud or table of points, lines in VTK, a label volume, or Slicer's markups, told by its
        content.
    to : {"map", "image"}
        where it is carried: from the prior's image to the map, or back.
    out : str or Path, default in the run's folder export/
        the file to write; one that is there is replaced.
    estimate : str, default the last
        the estimate whose motion is meant.
    units : {"mm", "cm", "m", "um", "in"}, default what the source states, else mm
        unit of the source.
    frame : {"LPS", "RAS"}, default what the source states, else that of its side
        frame of the source.

    Returns
    -------
    Path
        the file that was written, in mm and in the frame of the other side, with `sd_mm` and `motion_known`
        at each place, where the format has room for them.

    Raises
    ------
    InputError
        where the estimate has no motion, or the file is of no such kind.

    Examples
    --------
    >>> import o3dls
    >>> done = o3dls.carry("run", "case/prior.ply", to="map", out="prior_on_map.vtp")
    >>> sorted(o3dls.read_surface(done).fields)
    ['motion_known', 'sd_mm']
    """
    from ..folder import check_not_of_a_run, read_run

    source = Path(source)
    if to not in ("map", "image"):
        raise InputError(f"carry: to = '{to}': must be map or image")
    run = read_run(folder)
    name = estimate or run.final
    if name not in run.estimates:
        raise InputError(f"{folder}: no estimate '{name}'{did_you_mean(name, list(run.estimates))}")
    kind, write = _kind_of(source)
    path = Path(out) if out else Path(folder) / "export" / _name_of(source, kind, to)
    if not path.name.lower().endswith(_endings(kind)):
        raise InputError(f"{path}: {source.name} is carried as {' or '.join(_endings(kind))}")
    check_not_of_a_run(path)
    make_folder(path.parent)
    way = way_of(run, name, to)
    with staged_files(path, None if out else Path(folder)) as staged:
        carried = write(source, staged, way, units, frame)
    log_sentences(path, carried.sentences())
    doubts = [way.field.not_followed] if way.field.not_followed else []
    log_sentences(path, doubts + carried.failures(), logging.WARNING)
    return path


def _name_of(source: Path, kind: str, to: To) -> str:
    stem = source.name.split(".")[0] or "carried"
    return f"{stem}_on_{to}{SUFFIXES[kind]}"


def _endings(kind: str) -> tuple[str, ...]:
    if kind == "surface":
        return (".vtp", ".vtk", ".ply", ".stl", ".obj", ".off", ".mesh")
    return (".nrrd", ".nii", ".nii.gz") if kind == "labels" else (SUFFIXES[kind],)


def _kind_of(source: Path) -> tuple[str, Carry]:
    """Return which kind of thing a file holds, and what carries it. Raises InputError."""
    from ...io.clouds.lines import read_lines
    from ...io.images.registry import knows
    from ...io.surfaces import is_surface
    from ...io.text import read_bytes

    data = read_bytes(source)
    if knows(data):
        return "labels", carry_labels
    if source.suffix.lower() in (".json", ".fcsv"):
        return "markups", carry_markups
    if read_lines(source, data) is not None:
        return "lines", carry_lines
    return ("surface", carry_surface) if is_surface(source) else ("table", carry_table)
