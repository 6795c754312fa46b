"""A surface of a finished run's folder written for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

from ...errors import InputError, did_you_mean
from .formats import NO_SURFACE, FormatName, file_name
from .writer import Export


def export_run(
    folder: str | Path,
    out: str | Path | None = None,
    *,
    estimate: str | None = None,
    format: str = "ply",
    **options: Any,
) -> Path:
    """Write the surface of an estimate (default: the last) of a finished run.

    `out` is a file, by default in the run's export folder. Further options as for `Export`. Raises InputError
    where the run, the estimate or the format is not there.
    """
    from ...io.manifest import noted
    from ...io.surfaces import FORMATS, check_suffix
    from ..folder import check_not_of_a_run, read_run

    if format not in get_args(FormatName):
        raise InputError(f"export: no format '{format}'{did_you_mean(format, list(get_args(FormatName)))}")
    path = Path(out) if out else None
    if path:
        check_suffix(path, format, ({known.name: known.suffixes for known in FORMATS} | NO_SURFACE)[format])
    writer = Export(**options | {"estimate": estimate, "format": format})
    run = read_run(folder)
    name = estimate or run.final
    if name not in run.estimates:
        raise InputError(f"{folder}: no estimate '{name}'{did_you_mean(name, list(run.estimates))}")
    if why := writer.obstacle(run.case) or writer.mistake(run.case):
        raise InputError(f"{folder}: {why}")
    within = None if path else Path(folder)  # a run folder may be from elsewhere
    path = path or Path(folder) / "export" / file_name(name, format, writer.on)
    check_not_of_a_run(path)
    with noted(folder):
        writer.write(run.estimates[name].surface, run, name, path, within)
    return path
