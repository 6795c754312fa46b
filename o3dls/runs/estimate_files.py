"""The files of one estimate in a run folder: its surface, its trace, its weights; written and read back."""

from __future__ import annotations

import io
from collections.abc import Collection
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..case import Case
from ..errors import InputError, escaped
from ..estimate import Estimate
from ..geometry.surface import Surface
from ..io.atomic import write_file
from ..io.surfaces import read_surface, write_surface
from ..io.table import read_table, write_table
from ..run_warning import CODES, RunWarning
from .posterior_file import KEPT, read_posterior, write_posterior
from .record import EstimateRecord, WarningRecord, plain

if TYPE_CHECKING:
    from ..motion.recorded import Motion, RecordedMotion, WallModes

IN_WALL = "sd_in_wall_mm"  # field of the moved prior: deviation across its normals, where there is an image
MODES = "posterior.npy"  # rows: vertex of the prior, then its part in each mode of the errors


def write_estimate(folder: Path, case: Case, estimate: Estimate, fitted: Collection[str]) -> Estimate:
    """Write the files of an estimate; the answer is what is read back of it, with its whole motion."""
    from .surface_fields import with_fields  # imported late: who only checks a file needs no compiled code

    folder.mkdir(parents=True)
    surface = with_fields(case, estimate, fitted)
    names = ("surface.csv",) if case.dimension == 2 else ("surface.ply", "surface.vtp")
    for name in names:
        write_surface(folder / name, surface, space=case.frame, units=case.units)
    if estimate.motion is not None:
        _write_motion(folder / f"moved_prior.{'csv' if case.dimension == 2 else 'ply'}", case, estimate)
    write_rows(folder / "trace.csv", estimate.trace)
    if estimate.weights is not None:
        write_table(folder / "weights.csv", {"weight": estimate.weights})
    return replace(estimate, surface=surface, facts=plain(estimate.facts))


def read_estimate(folder: Path, found: EstimateRecord, case: Case) -> Estimate:
    return Estimate(
        surface=read_surface(folder / ("surface.csv" if case.dimension == 2 else "surface.ply")),
        T_map_prior=(T_map_prior := np.array(found.T_map_prior)),
        status=found.status,
        converged=found.converged,
        iterations=found.iterations,
        seconds=found.seconds,
        sigma=found.sigma_mm if case.units == "mm" else found.sigma_px,
        weights=_read_column(folder / "weights.csv", "weight"),
        motion=_read_motion(folder, case, T_map_prior),
        trace=_read_trace(folder / "trace.csv"),
        warnings=tuple(map(_as_warning, found.warnings)),
        facts=found.facts,
    )


def _write_motion(path: Path, case: Case, estimate: Estimate) -> None:
    """Write the prior where the motion brought it, vertex by vertex, with its deviation along the normals;
    and how the deviations go together.
    """
    from ..evaluation.wall_modes import wall_modes

    if estimate.motion is None:
        return
    moved, deviation = move_prior(case.prior, estimate.motion)
    moved = replace(moved, fields={f"sd_{case.units}": deviation, **_in_wall(case, estimate.motion, moved)})
    write_surface(path, moved, space=case.frame, units=case.units)
    write_posterior(path.with_name(KEPT), estimate.motion)
    if modes := wall_modes(case.prior, estimate.motion):
        table = np.column_stack([modes.places, modes.modes]).astype(
            np.float32
        )  # float32 holds the places exactly, up to 2^24
        with io.BytesIO() as content:
            np.save(content, table, allow_pickle=False)
            write_file(path.with_name(MODES), content.getvalue())


@lru_cache(maxsize=1)  # estimates of one run share their motion
def move_prior(prior: Surface, motion: Motion) -> tuple[Surface, Array]:
    """Return the prior where a motion brought it, and the deviation (n,) along its normals there."""
    moved = prior.with_vertices(motion(prior.vertices))
    return moved, motion.sd(prior.vertices, moved.vertex_normals)


def _in_wall(case: Case, motion: Motion, moved: Surface) -> dict[str, Array]:
    """Return the deviation (n,) of the prior's vertices across their normals, per direction in the wall, as a
    field, for a case with an image; nothing where it is not known.
    """
    if not case.image:
        return {}
    if isinstance(earlier := getattr(motion, "moved", None), Surface):  # it was read, and knows no more
        return {name: values for name, values in earlier.fields.items() if name == IN_WALL}
    normals = moved.vertex_normals
    across = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    both = [motion.sd(case.prior.vertices, way) for way in (across, np.cross(normals, across))]
    return {IN_WALL: np.sqrt(np.mean(np.square(both), axis=0))}


def _read_modes(path: Path, vertices: int) -> WallModes | None:
    """Read the joint posterior, where the run kept it. Raises InputError where it was damaged."""
    from ..motion.recorded import WallModes

    if not path.is_file():
        return None
    try:
        table = np.load(path, allow_pickle=False).astype(np.float64)
    except (ValueError, EOFError) as error:
        raise InputError(f"{path}: is damaged ({error}); run it again") from None
    whole = table.ndim == 2 and table.shape[1] > 1 and len(table) > 0 and bool(np.isfinite(table).all())
    if not whole or not ((table[:, 0] >= 0) & (table[:, 0] < vertices)).all():
        raise InputError(f"{path}: must have a vertex of the prior and numbers in each row; run it again")
    return WallModes(table[:, 0].astype(np.int64), table[:, 1:])


def _read_motion(folder: Path, case: Case, T_map_prior: Array) -> RecordedMotion | None:
    """Read the motion as far as a run folder holds it. Raises InputError where it is of another prior."""
    from ..motion.recorded import RecordedMotion

    path = folder / f"moved_prior.{'csv' if case.dimension == 2 else 'ply'}"
    if not path.is_file():
        return None
    moved = read_surface(path)
    if not np.array_equal(moved.faces, case.prior.faces):
        raise InputError(f"{path}: has other faces than the prior of the run's case; run it again")
    deviation = moved.fields.get(f"sd_{case.units}", np.full(len(moved.vertices), np.nan))
    modes = _read_modes(folder / MODES, len(case.prior.vertices))
    kept = read_posterior(folder / KEPT, case.dimension)
    return RecordedMotion(case.prior, moved, T_map_prior, deviation, modes, kept)


def _as_warning(found: WarningRecord) -> RunWarning:
    if found.code not in CODES:
        raise InputError(
            f"run.json: warning code '{found.code}' is unknown: was it written by a newer version?"
        )
    return RunWarning(found.code, found.sentence, found.stage)


def write_rows(path: Path, rows: Any) -> None:
    """Write rows of records as a table; a value that a row has not is an empty cell, a line break in a text
    is escaped.
    """
    names = dict.fromkeys(key for row in rows for key in row)
    if names:
        write_table(
            path, {name: np.array([_as_cell(row.get(name)) for row in rows], dtype=object) for name in names}
        )


def _as_cell(value: Any) -> Any:
    if isinstance(value, str):
        # names of folders may hold bytes that are not UTF-8
        return escaped(value.encode("utf-8", "replace").decode("utf-8"))
    return "" if value is None else value.item() if isinstance(value, np.generic) else value


def _read_trace(path: Path) -> tuple[dict[str, float], ...]:
    if not path.is_file():
        return ()
    table = read_table(path, ())
    numbers = {name: table.numbers(name, missing=True) for name in table.columns}
    return tuple(
        {name: float(v[k]) for name, v in numbers.items() if not np.isnan(v[k])} for k in range(len(table))
    )


def _read_column(path: Path, name: str) -> Array | None:
    return read_table(path, (name,)).numbers(name, missing=True) if path.is_file() else None
