"""The run folder: a finished run on disk, whole or not at all, and read back."""

from __future__ import annotations

import json
import logging
import math
import traceback
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..case import Case
from ..errors import InputError, O3dlsError
from ..estimate import Estimate
from ..geometry.surface import Surface
from ..io.atomic import staged_folder
from ..io.case_folder import read_case, write_case
from ..io.meshes.registry import read_surface, write_surface
from ..io.points import read_points, write_points
from ..io.table import read_table, write_table
from .run import Run
from .surface_fields import with_fields
from .tables import score_rows

if TYPE_CHECKING:
    from ..pipeline.pipeline import Pipeline

SCHEMA = "o3dls/run/1"
# what a run is; the rest can be made again
OWN = (
    "run.json",
    "scores.csv",
    "points.csv",
    "held_out.csv",
    "case",
    "estimates",
)
log = logging.getLogger("o3dls")


def write_run(run: Run, folder: str | Path | None = None, *, force: bool = False) -> Path:
    """Write run.json, scores.csv, points.csv, the case, the estimates, and what the writers of the pipeline
    make.
    """
    out = folder or (run.pipeline and run.pipeline.out)
    if not out:
        raise InputError(
            'the run has no folder to go to: give one to write(), or say out = "folder" in the pipeline'
        )
    with staged_folder(out, force) as staged:
        write_case(staged / "case", run.case)
        write_points(staged / "points.csv", run.points)
        if run.held_out:
            write_points(staged / "held_out.csv", run.held_out)
        write_rows(staged / "scores.csv", score_rows(run))
        for name, estimate in run.estimates.items():
            fitted = run.pipeline.fitted(name) if run.pipeline else ()
            _write_estimate(staged / "estimates" / name, run.case, estimate, fitted)
        (staged / "run.json").write_text(
            json.dumps(record(run), indent=1, allow_nan=False) + "\n", encoding="utf-8"
        )
        for writer in run.pipeline.writes if run.pipeline else ():
            log.info("writing %s", writer.name)
            writer(run, staged)
    return Path(out)


def record(run: Run) -> dict[str, Any]:
    """The content of run.json; equal inputs give equal records but for `seconds`."""
    case = run.case
    types, counts = np.unique(case.points.type, return_counts=True)
    about = {"name": case.name, "units": case.units, "frame": case.frame, "dimension": case.dimension}
    points = dict(zip(types.tolist(), counts.tolist(), strict=True))
    found: dict[str, Any] = _plain(
        {
            "schema": SCHEMA,
            "case": about | {"points": points, "files": dict(sorted(case.files.items()))},
            **run.provenance,
            "final": run.final,
            "valid": not run.faults,
            "faults": run.faults,
            "estimates": {name: _estimate_record(run, name) for name in run.estimates},
        }
    )
    return found


def read_record(folder: str | Path) -> dict[str, Any]:
    """The content of a folder's run.json. Raises InputError where it is none."""
    path = Path(folder) / "run.json"
    if not path.is_file():
        raise InputError(f"{folder}: is no run folder: it has no run.json")
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    if not isinstance(found, dict) or found.get("schema") != SCHEMA:
        said = repr(found.get("schema")) if isinstance(found, dict) else "not there"
        raise InputError(f"{path}: schema is {said}: must be '{SCHEMA}'")
    return found


def read_run(folder: str | Path) -> Run:
    """A run from its folder: everything but motions and level sets. Raises InputError where the folder holds
    no finished run.
    """
    folder, found = Path(folder), read_record(folder)
    try:
        return _run_of(folder, found)
    except KeyError as error:
        raise InputError(
            f"{folder / 'run.json'}: has no {error}, so it is no finished run; run it again"
        ) from None


def _run_of(folder: Path, found: Mapping[str, Any]) -> Run:
    unit = found["case"]["units"]
    held_out = folder / "held_out.csv"
    case = read_case(folder / "case")
    return Run(
        case=case,
        pipeline=None,
        estimates={
            name: _read_estimate(folder / "estimates" / name, one, unit)
            for name, one in found["estimates"].items()
        },
        scores={name: one["scores"] for name, one in found["estimates"].items()},
        validity={name: one["validity"] for name, one in found["estimates"].items()},
        provenance={key: found[key] for key in ("pipeline", "versions", "seeds", "threads", "seconds")},
        points=read_points(folder / "points.csv", case.dimension),
        held_out=read_points(held_out, case.dimension) if held_out.is_file() else None,
    )


def repeats(folder: Path, pipeline: Pipeline, case: Case) -> bool:
    """Whether the folder holds an earlier run of this pipeline on the files of this case."""
    found = read_record(folder)
    return bool(
        found.get("pipeline") == _plain(pipeline.record())
        and found.get("case", {}).get("files") == case.files
    )


def check_not_of_a_run(path: str | Path) -> None:
    """Raise InputError where a file to be written would replace what a finished run is read from."""
    path = Path(path).resolve()
    for folder in path.parents:
        if (folder / "run.json").exists() and path.relative_to(folder).parts[0] in OWN:
            raise InputError(f"{path}: belongs to the run in {folder}; name another file")


class _Lines(logging.Handler):
    """Keeps the log's lines, from a level on, in a list."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


@contextmanager
def heard(level: int) -> Iterator[list[str]]:
    """The lines of the log, from a level on, that the block gives."""
    handler = _Lines(level)
    before = log.level
    log.addHandler(handler)
    log.setLevel(min(log.getEffectiveLevel(), level))
    try:
        yield handler.lines
    finally:
        log.removeHandler(handler)
        log.setLevel(before)


@contextmanager
def log_of_failure(out: Path) -> Iterator[None]:
    """Leave `<out>.failed.log`, which says what was done and why it ended, where the block fails; remove an
    old one where it does not.
    """
    path = out.with_name(out.name + ".failed.log")
    with heard(logging.INFO) as lines:
        try:
            yield
        except BaseException as error:
            lines.append(
                f"{type(error).__name__}: {error}"
                if isinstance(error, O3dlsError)
                else traceback.format_exc()
            )
            with suppress(OSError):  # what went wrong is said, whether or not there is room for a log of it
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text("\n".join(lines) + "\n", encoding="utf-8", errors="replace")
            raise
    with suppress(OSError):
        path.unlink(missing_ok=True)


def _estimate_record(run: Run, name: str) -> dict[str, Any]:
    e = run.estimates[name]
    return {
        "status": e.status,
        "converged": e.converged,
        "seconds": e.seconds,
        "iterations": e.iterations,
        "T_map_prior": e.T_map_prior.tolist(),
        "scale": e.scale,
        f"sigma_{run.unit}": e.sigma,
        "warnings": list(e.warnings),
        "facts": dict(e.facts),
        "scores": run.scores[name],
        "validity": run.validity[name],
    }


def _write_estimate(folder: Path, case: Case, estimate: Estimate, fitted: Collection[str]) -> None:
    folder.mkdir(parents=True)
    surface = with_fields(case, estimate, fitted)
    names = ("surface.csv",) if case.dimension == 2 else ("surface.ply", "surface.vtp")
    for name in names:
        write_surface(folder / name, surface, space=case.frame, units=case.units)
    write_rows(folder / "trace.csv", estimate.trace)
    if estimate.weights is not None:
        write_table(folder / "weights.csv", {"weight": estimate.weights})


def _read_estimate(folder: Path, found: Mapping[str, Any], unit: str) -> Estimate:
    surface: Surface = read_surface(
        folder / ("surface.ply" if (folder / "surface.ply").is_file() else "surface.csv")
    )
    return Estimate(
        surface=surface,
        T_map_prior=np.array(found["T_map_prior"]),
        sigma=found[f"sigma_{unit}"],
        weights=_column(folder / "weights.csv", "weight"),
        trace=_read_trace(folder / "trace.csv"),
        warnings=tuple(found["warnings"]),
        **{key: found[key] for key in ("status", "converged", "seconds", "iterations", "facts")},
    )


def write_rows(path: Path, rows: Any) -> None:
    """Rows of records as a table; a value that a row has not is an empty cell."""
    names = dict.fromkeys(key for row in rows for key in row)
    if names:
        write_table(
            path, {name: np.array([_cell(row.get(name)) for row in rows], dtype=object) for name in names}
        )


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        # names of folders may hold bytes that are no text
        return value.encode("utf-8", "replace").decode("utf-8")
    return "" if value is None else value.item() if isinstance(value, np.generic) else value


def _read_trace(path: Path) -> tuple[dict[str, float], ...]:
    if not path.is_file():
        return ()
    table = read_table(path, ())
    numbers = {name: table.numbers(name, missing=True) for name in table.columns}
    return tuple(
        {name: float(v[k]) for name, v in numbers.items() if not np.isnan(v[k])} for k in range(len(table))
    )


def _column(path: Path, name: str) -> Array | None:
    return read_table(path, (name,)).numbers(name, missing=True) if path.is_file() else None


def _plain(value: Any) -> Any:
    """The value as JSON knows it: numpy unwrapped, what is not finite as null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(item) for item in value]
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value
