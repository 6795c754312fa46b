"""A case folder becomes a Case, and back: the contract of DESIGN, read strictly."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..case import Case, Points, Truth
from ..errors import InputError
from ..geometry import Array, Surface
from .atomic import staged_folder
from .case_settings import MILLIMETRES, Folder, open_folder, toml_lines
from .mesh import read_surface_file, write_surface
from .points import points_of, read_points_table, write_points
from .repair import closed_outward
from .table import Table, write_table
from .text import decode, read_bytes

FEWEST_POINTS = 10


def read_case(folder: str | Path, *, points: str | Path | None = None, units: str | None = None, frame: str | None = None) -> Case:
    """The case in a folder, lengths in mm (px where it says so); `points`, `units` and `frame` overrule the folder.

    Raises InputError for everything that is missing, unknown or cannot be meant.
    """
    opened = open_folder(Path(folder), {k: v for k, v in (("units", units), ("frame", frame)) if v})
    prior = _surface(opened, "prior")
    if prior is None:
        raise InputError(f"{opened.path}: no prior surface; there must be a file prior.ply (or .stl, .vtp, .mesh, .nii.gz and others)")
    table = _points_table(opened, points)
    measured = _points(opened, table)
    case = Case(
        name=opened.settings.get("name", opened.path.resolve().name),
        prior=prior,
        points=measured,
        prior_landmarks=_landmarks(opened),
        init=_init(opened),
        units=opened.units,
        frame=opened.settings.get("frame", table.notes.get("space", "unknown")),
        notes=opened.settings.get("notes", ""),
        files=opened.hashes,
        truth=_truth(opened),
        phases=_phases(opened),
    )
    _check(case, opened)
    return case


def _surface(folder: Folder, role: str) -> Surface | None:
    path = folder.find(role)
    if path is None:
        return None
    choice = {key: folder.settings.get(key) for key in ("label", "part", "box")} if role == "prior" else {}
    file = read_surface_file(path, **choice)
    surface = file.surface.with_vertices(file.surface.vertices * folder.scale(file.units))
    if surface.dimension != folder.dimension:
        hint = f"say dimension = {surface.dimension} in case.toml"
        raise InputError(f"{path}: is {surface.dimension}D, the case is {folder.dimension}D; {hint}")
    if role != "prior":  # a truth may be open: it is only measured against
        return surface
    if "units" not in folder.settings and file.units not in MILLIMETRES:
        check_scale(path, surface.vertices)
    return closed_outward(surface, str(path), cap=folder.settings.get("cap", False))


def _phases(folder: Folder) -> tuple[Surface, ...]:
    """The surfaces in the folder phases/, in the order of their names."""
    found = []
    for path in sorted(p for p in (folder.path / "phases").glob("*") if p.is_file() and not p.name.startswith(".")):
        file = read_surface_file(path)
        if file.surface.dimension != folder.dimension:
            raise InputError(f"{path}: is {file.surface.dimension}D, the case is {folder.dimension}D")
        folder.note(path)
        found.append(file.surface.with_vertices(file.surface.vertices * folder.scale(file.units)))
    return tuple(found)


def check_scale(path: Path, xyz: Array, smallest: float = 5.0) -> None:
    """Raise InputError where the extent of undeclared units is not that of a heart in mm (atria: 60 to 160); extents that might be
    either are let pass. `smallest`: extent from which, up to 18, centimetres are likely."""
    diagonal = float(np.linalg.norm(np.ptp(xyz, axis=0)))
    inches, centimetres = 1 <= diagonal < 5, smallest <= diagonal <= 18
    likely = "m" if diagonal < 1 else "in" if inches else "cm" if centimetres else "um" if diagonal > 20_000 else None
    if likely:
        raise InputError(f"{path}: extends over {diagonal:.3g} mm; if its units are {likely}, say --units {likely}, else --units mm")


def _points_table(folder: Folder, points: str | Path | None) -> Table:
    path = folder.find("points") if points is None else Path(points)
    if path is None:
        raise InputError(f"{folder.path}: no points.csv; there must be one with columns {','.join('xyz'[: folder.dimension])}")
    table = read_points_table(path, folder.dimension)
    folder.note(path)
    if table.notes.get("units", "mm") not in MILLIMETRES:
        raise InputError(f"{path}: units={table.notes['units']}: must be one of {', '.join(MILLIMETRES)}")
    return table


def _points(folder: Folder, table: Table) -> Points:
    points = points_of(table, folder.dimension)
    scale = folder.scale(table.notes.get("units"))
    columns = {k: v * scale if k == "sigma" else v for k, v in points.columns.items()}
    points = Points(points.xyz * scale, points.type, columns)
    fitted = int((points.type == "eam").sum())
    if fitted < FEWEST_POINTS:
        raise InputError(f"{table.path}: {fitted} points of type eam: at least {FEWEST_POINTS} are needed to fit a surface")
    if folder.dimension == 3 and "units" not in folder.settings and "units" not in table.notes:
        check_scale(table.path, points.xyz, np.inf)  # a few points may lie close together
    return points


def _landmarks(folder: Folder) -> dict[str, Array]:
    axes = tuple("xyz"[: folder.dimension])
    table = folder.table("prior_landmarks", ("name", *axes))
    if table is None:
        return {}
    _unique(table, table.columns["name"])
    xyz = np.column_stack([table.numbers(axis) for axis in axes]) * folder.scale(table.notes.get("units"))
    return dict(zip(table.columns["name"], xyz, strict=True))


def _unique(table: Table, names: list[str]) -> None:
    for row, name in enumerate(names):
        if not name or name in names[:row]:
            fault = "is there twice" if name else "is empty"
            raise InputError(f"{table.where(row, 'name')}: '{name}' {fault}; each landmark needs a name of its own")


def _init(folder: Folder) -> Array | None:
    """The rough pose prior -> map, translation scaled to mm."""
    path = folder.find("init")
    if path is None:
        return None
    n = folder.dimension + 1
    lines = [line.replace(",", " ").split() for line in decode(read_bytes(path), path).splitlines() if line.strip()]
    try:
        matrix = np.array(lines, dtype=np.float64)
    except ValueError:
        matrix = np.zeros((0, 0))
    if matrix.shape != (n, n) or not np.isfinite(matrix).all():
        raise InputError(f"{path}: must hold {n} rows of {n} finite numbers, without a header")
    if not np.allclose(matrix[-1], np.eye(n)[-1]) or np.linalg.det(matrix[:-1, :-1]) <= 0:
        raise InputError(f"{path}: is no pose: the last row must be {np.eye(n)[-1].tolist()} and the determinant positive")
    matrix[:-1, -1] *= folder.scale()
    return matrix


def _truth(folder: Folder) -> Truth | None:
    """Whatever the folder holds for evaluation; None where it holds nothing."""
    axes = tuple("xyz"[: folder.dimension])
    surface = _surface(folder, "truth")
    held, outliers = folder.table("held_out", axes), folder.table("outliers", ("row",))
    pairs = folder.table("correspondence", _pair_names(axes))
    if all(part is None for part in (surface, held, pairs, outliers)):
        return None
    scale = folder.scale()
    return Truth(
        surface=surface,
        held_out=None if held is None else _stack(held, axes) * scale,
        unseen=None if held is None or "unseen" not in held.columns else held.numbers("unseen") > 0,
        correspondence=None if pairs is None else tuple(_stack(pairs, tuple(s + a for a in axes)) * scale for s in "pt"),  # type: ignore[arg-type]
        outliers=None if outliers is None else outliers.numbers("row").astype(np.int64),
    )


def _pair_names(axes: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(side + axis for side in "pt" for axis in axes)


def _stack(table: Table, names: tuple[str, ...]) -> Array:
    return np.column_stack([table.numbers(name) for name in names])


def _check(case: Case, folder: Folder) -> None:
    """What can only be seen with the whole case: landmark pairs and outlier rows."""
    marks = case.points.of("landmark")
    names = [str(name) for name in marks.columns.get("name", np.full(len(marks), ""))]
    for name in names:
        if not name or names.count(name) > 1:
            raise InputError(f"{folder.path}: two landmarks of the points are named '{name}'; each needs a name of its own")
    if names and case.prior_landmarks and not set(names) & set(case.prior_landmarks):
        raise InputError(
            f"{folder.path}: no landmark of the points ({', '.join(names)}) has its pair in prior_landmarks.csv "
            f"({', '.join(case.prior_landmarks)}); give both sides the same names"
        )
    rows = case.truth.outliers if case.truth else None
    if rows is not None and len(rows) and (rows.min() < 0 or rows.max() >= len(case.points)):
        raise InputError(f"{folder.path}: outliers.csv names row {rows.max()}: points have rows 0 to {len(case.points) - 1}")


def write_case(folder: str | Path, case: Case, *, force: bool = False) -> None:
    """Write a case as a folder that `read_case` reads back; the folder appears whole or not at all."""
    suffix = "ply" if case.dimension == 3 else "csv"
    axes = tuple("xyz"[: case.dimension])
    with staged_folder(folder, force) as out:
        settings: dict[str, str | int] = {"name": case.name, "units": case.units, "frame": case.frame, "dimension": case.dimension}
        settings["notes"] = case.notes
        (out / "case.toml").write_text(toml_lines(settings), encoding="utf-8")
        write_surface(out / f"prior.{suffix}", case.prior, units=case.units)
        write_points(out / "points.csv", case.points)
        if case.prior_landmarks:
            names, xyz = np.array(list(case.prior_landmarks)), np.array(list(case.prior_landmarks.values()))
            write_table(out / "prior_landmarks.csv", {"name": names, **dict(zip(axes, xyz.T, strict=True))})
        if case.init is not None:
            (out / "init.csv").write_text("\n".join(",".join(map(repr, row)) for row in case.init.tolist()) + "\n")
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
