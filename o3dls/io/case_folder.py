"""A case folder becomes a Case, and back: the contract of DESIGN, read strictly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..case import Case, Points, Truth
from ..errors import InputError
from ..geometry.similarity import TURN, apply, is_pose
from ..geometry.surface import Surface
from .atomic import staged_folder
from .case_settings import MILLIMETRES, Folder, open_folder, toml_lines
from .meshes.registry import read_surface_file, write_surface
from .meshes.repair import closed_outward
from .meshes.surface_file import SurfaceFile
from .points import points_of, read_points_table, scaled, write_points
from .table import Table, write_table
from .text import decode, integers, read_bytes, rectangle

FEWEST_POINTS = 10


def read_case(
    folder: str | Path,
    *,
    points: str | Path | None = None,
    units: str | None = None,
    frame: str | None = None,
) -> Case:
    """The case in a folder, lengths in mm (px where it says so); `points` replace its own, `units` and
    `frame` say what it does not.

    Raises InputError for everything that is missing, unknown or cannot be meant.
    """
    opened = open_folder(Path(folder), {k: v for k, v in (("units", units), ("frame", frame)) if v})
    prior = _surface(opened, "prior")
    if prior is None:
        raise InputError(
            f"{opened.path}: no prior surface; there must be a file prior.ply (or .stl, .vtp, .mesh, "
            ".nii.gz and others)"
        )
    table = _points_table(opened, points)
    measured, frame = _points(opened, table), _frame(opened, table)
    case = Case(
        name=opened.settings.get("name", opened.path.resolve().name),
        prior=prior.surface,
        points=measured,
        prior_landmarks=_landmarks(opened, prior.space),
        init=_init(opened),
        units=opened.units,
        frame=frame,
        notes=opened.settings.get("notes", ""),
        files=opened.hashes,
        truth=_truth(opened, prior.space, frame),
        phases=_phases(opened, prior.space),
    )
    _check(case, opened)
    return case


def _frame(folder: Folder, table: Table) -> str:
    """The frame that the points or the case state. Raises InputError where both do, and differ."""
    stated = table.notes.get("space", "unknown")
    given = str(folder.settings.get("frame", "unknown"))
    if "unknown" not in (stated, given) and stated != given:
        raise InputError(
            f"{table.path}: states frame {stated}, and --frame or case.toml says {given}; leave that "
            "away, or mend the file"
        )
    return given if stated == "unknown" else stated


def _scale(folder: Folder, path: Path, stated: str | None) -> float:
    """Factor to mm: what the file states, else what the case says. Raises InputError for units that nobody
    knows.
    """
    if stated not in (*MILLIMETRES, "unknown", None):
        raise InputError(f"{path}: states units '{stated}': must be one of {', '.join(MILLIMETRES)}")
    return folder.scale(stated)


def _scaled(folder: Folder, path: Path, file: SurfaceFile) -> SurfaceFile:
    return replace(
        file, surface=file.surface.with_vertices(file.surface.vertices * _scale(folder, path, file.units))
    )


def _surface(folder: Folder, role: str) -> SurfaceFile | None:
    path = folder.find(role)
    if path is None:
        return None
    choice = {key: folder.settings.get(key) for key in ("label", "part", "box")} if role == "prior" else {}
    file = _scaled(folder, path, read_surface_file(path, **choice))
    surface = file.surface
    if surface.dimension != folder.dimension:
        hint = f"say dimension = {surface.dimension} in case.toml"
        raise InputError(f"{path}: is {surface.dimension}D, the case is {folder.dimension}D; {hint}")
    if role != "prior":  # a truth may be open: it is only measured against
        return file
    if "units" not in folder.settings and file.units not in MILLIMETRES:
        check_scale(path, surface.vertices)
    return replace(file, surface=closed_outward(surface, str(path), cap=folder.settings.get("cap", False)))


def _turned(xyz: Array, stated: str | None, space: str) -> Array:
    """Coordinates (n, d) of a file that states its frame, in the frame `space`; as they are where one of the
    two is not known.
    """
    d = xyz.shape[1]
    return apply(TURN[: d + 1, : d + 1], xyz) if {stated, space} == {"LPS", "RAS"} else xyz


def _framed(file: SurfaceFile, space: str) -> Surface:
    return file.surface.with_vertices(_turned(file.surface.vertices, file.space, space))


def _phases(folder: Folder, space: str) -> tuple[Surface, ...]:
    """The surfaces in the folder phases/, in the order of their names and in the prior's frame `space`."""
    found = []
    for path in sorted(
        p for p in (folder.path / "phases").glob("*") if p.is_file() and not p.name.startswith(".")
    ):
        surface = _framed(_scaled(folder, path, read_surface_file(path)), space)
        if surface.dimension != folder.dimension:
            raise InputError(f"{path}: is {surface.dimension}D, the case is {folder.dimension}D")
        folder.note(path)
        found.append(surface)
    return tuple(found)


def check_scale(path: Path, xyz: Array, smallest: float = 5.0) -> None:
    """Raise InputError where the extent of undeclared units is not that of a heart in mm (atria: 60 to 160);
    extents that might be either are let pass. `smallest`: extent from which, up to 18, centimetres are
    likely.
    """
    diagonal = float(np.linalg.norm(np.ptp(xyz, axis=0)))
    inches = 1 <= diagonal < 5
    centimetres = smallest <= diagonal <= 18
    likely = (
        "m"
        if diagonal < 1
        else "in"
        if inches
        else "cm"
        if centimetres
        else "um"
        if diagonal > 20_000
        else None
    )
    if likely:
        raise InputError(
            f"{path}: extends over {diagonal:.3g} mm; if its units are {likely}, say --units {likely}, "
            "else --units mm"
        )


def _points_table(folder: Folder, points: str | Path | None) -> Table:
    path = folder.find("points") if points is None else Path(points)
    if path is None:
        raise InputError(
            f"{folder.path}: no points.csv; there must be one with columns "
            f"{','.join('xyz'[: folder.dimension])}"
        )
    table = read_points_table(path, folder.dimension)
    folder.note(path)
    return table


def _points(folder: Folder, table: Table) -> Points:
    stated = table.notes.get("units", "unknown")
    points = scaled(points_of(table, folder.dimension), _scale(folder, table.path, stated))
    fitted = int((points.type == "eam").sum())
    if fitted < FEWEST_POINTS:
        raise InputError(
            f"{table.path}: {fitted} points of type eam: at least {FEWEST_POINTS} are needed to fit a surface"
        )
    if folder.dimension == 3 and "units" not in folder.settings and stated == "unknown":
        check_scale(table.path, points.xyz, np.inf)  # a few points may lie close together
    return points


def _landmarks(folder: Folder, space: str) -> dict[str, Array]:
    """Places named on the prior, in its frame `space`."""
    axes = tuple("xyz"[: folder.dimension])
    table = folder.table("prior_landmarks", ("name", *axes))
    if table is None:
        return {}
    _unique(table, table.columns["name"])
    return dict(zip(table.columns["name"], _places(folder, table, axes, space), strict=True))


def _unique(table: Table, names: list[str]) -> None:
    for row, name in enumerate(names):
        if not name or name in names[:row]:
            fault = "is there twice" if name else "is empty"
            raise InputError(
                f"{table.where(row, 'name')}: '{name}' {fault}; each landmark needs a name of its own"
            )


def _init(folder: Folder) -> Array | None:
    """The rough pose prior -> map, translation scaled to mm."""
    path = folder.find("init")
    if path is None:
        return None
    n = folder.dimension + 1
    matrix = rectangle(
        [line.replace(",", " ") for line in decode(read_bytes(path), path).splitlines() if line.strip()]
    )
    if matrix is None or matrix.shape != (n, n) or not np.isfinite(matrix).all():
        raise InputError(f"{path}: must hold {n} rows of {n} finite numbers, without a header")
    if not is_pose(matrix, folder.dimension):
        raise InputError(
            f"{path}: is no pose: must be a rotation, a shift and one scale, with "
            f"{np.eye(n)[-1].tolist()} as the last row"
        )
    matrix[:-1, -1] *= folder.scale()
    return matrix


def _truth(folder: Folder, prior: str, frame: str) -> Truth | None:
    """Whatever the folder holds for evaluation, in the frame of the points, which `frame` names; None where
    it holds nothing.
    """
    axes = tuple("xyz"[: folder.dimension])
    surface = _surface(folder, "truth")
    held = folder.table("held_out", axes)
    outliers = folder.table("outliers", ("row",))
    pairs = folder.table("correspondence", _pair_names(axes))
    if all(part is None for part in (surface, held, pairs, outliers)):
        return None
    return Truth(
        surface=None if surface is None else _framed(surface, frame),
        held_out=None if held is None else _places(folder, held, axes, frame),
        unseen=None if held is None or "unseen" not in held.columns else held.numbers("unseen") > 0,
        correspondence=None
        if pairs is None
        else (_side(folder, pairs, "p", prior), _side(folder, pairs, "t", frame)),
        outliers=None
        if outliers is None
        else integers(outliers.numbers("row"), f"{outliers.path}: column 'row'"),
    )


def _side(folder: Folder, pairs: Table, side: str, space: str) -> Array:
    return _places(folder, pairs, [side + axis for axis in "xyz"[: folder.dimension]], space)


def _pair_names(axes: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(side + axis for side in "pt" for axis in axes)


def _places(folder: Folder, table: Table, names: Sequence[str], space: str) -> Array:
    """Coordinates (n, d) out of columns of a table, in mm and in the frame `space`."""
    xyz = np.column_stack([table.numbers(name) for name in names]) * _scale(
        folder, table.path, table.notes.get("units")
    )
    return _turned(xyz, table.notes.get("space"), space)


def _check(case: Case, folder: Folder) -> None:
    """What can only be seen with the whole case: landmark pairs and outlier rows."""
    marks = case.points.of("landmark")
    names = [str(name) for name in marks.columns.get("name", np.full(len(marks), ""))]
    for name in names:
        if not name or names.count(name) > 1:
            raise InputError(
                f"{folder.path}: two landmarks of the points are named '{name}'; each needs a name of its own"
            )
    if names and case.prior_landmarks and not set(names) & set(case.prior_landmarks):
        raise InputError(
            f"{folder.path}: no landmark of the points ({', '.join(names)}) has its pair in "
            "prior_landmarks.csv "
            f"({', '.join(case.prior_landmarks)}); give both sides the same names"
        )
    rows = case.truth.outliers if case.truth else None
    if rows is not None and len(wrong := rows[(rows < 0) | (rows >= len(case.points))]):
        raise InputError(
            f"{folder.path}: outliers.csv names row {wrong[0]}: points have rows 0 to {len(case.points) - 1}"
        )


def write_case(folder: str | Path, case: Case, *, force: bool = False) -> None:
    """Write a case as a folder that `read_case` reads back; the folder appears whole or not at all."""
    suffix = "ply" if case.dimension == 3 else "csv"
    axes = tuple("xyz"[: case.dimension])
    with staged_folder(folder, force) as out:
        settings: dict[str, str | int] = {
            "name": case.name,
            "units": case.units,
            "frame": case.frame,
            "dimension": case.dimension,
        }
        settings["notes"] = case.notes
        (out / "case.toml").write_text(toml_lines(settings), encoding="utf-8")
        write_surface(out / f"prior.{suffix}", case.prior, units=case.units)
        write_points(out / "points.csv", case.points)
        if case.prior_landmarks:
            names = np.array(list(case.prior_landmarks))
            xyz = np.array(list(case.prior_landmarks.values()))
            write_table(out / "prior_landmarks.csv", {"name": names, **dict(zip(axes, xyz.T, strict=True))})
        if case.init is not None:
            (out / "init.csv").write_text(
                "\n".join(",".join(map(repr, row)) for row in case.init.tolist()) + "\n"
            )
        if case.phases:
            (out / "phases").mkdir()
        for k, phase in enumerate(case.phases, 1):
            write_surface(out / "phases" / f"{k:02d}.{suffix}", phase, units=case.units)
        if case.truth is not None:
            _write_truth(out, case.truth, axes, suffix, case.units)


def _write_truth(out: Path, truth: Truth, axes: tuple[str, ...], suffix: str, units: str) -> None:
    if truth.surface is not None:
        write_surface(out / f"truth.{suffix}", truth.surface, units=units)
    if truth.held_out is not None:
        unseen = {} if truth.unseen is None else {"unseen": truth.unseen.astype(int)}
        write_table(out / "held_out.csv", {**dict(zip(axes, truth.held_out.T, strict=True)), **unseen})
    if truth.correspondence is not None:
        columns = np.concatenate([side.T for side in truth.correspondence])
        write_table(out / "correspondence.csv", dict(zip(_pair_names(axes), columns, strict=True)))
    if truth.outliers is not None:
        write_table(out / "outliers.csv", {"row": truth.outliers})
