"""A run folder read back; how it is written stands with the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..case import Case
from ..errors import InputError
from ..io.case_reader import read_kept_case
from ..io.documents import read_json
from ..io.manifest import MANIFEST, missing
from ..io.points import read_points
from .estimate_files import read_estimate
from .record import RunRecord, checked, plain
from .run import Run
from .scoring import version_of

# files that a run is read from; the others can be made again
OWN = ("run.json", MANIFEST, "scores.csv", "points.csv", "held_out.csv", "case", "estimates")


def read_record(folder: str | Path) -> RunRecord:
    """Read the content of a folder's run.json. Raises InputError where it is none, or was damaged."""
    path = Path(folder) / "run.json"
    if not path.is_file():
        raise InputError(f"{folder}: is not a run folder: it has no run.json")
    return checked(read_json(path), str(path))


def day_of_end(folder: Path) -> str:
    """Return the day (UTC) on which a run ended, by the time of its run.json."""
    try:
        return datetime.fromtimestamp((folder / "run.json").stat().st_mtime, UTC).date().isoformat()
    except (ValueError, OverflowError, OSError):  # by a clock that was wrong, beyond the years of a calendar
        return "at a time that is not known"


def read_run(folder: str | Path) -> Run:
    """Read a run from its folder: everything but level sets; motions as far as the prior moved.

    Parameters
    ----------
    folder : str or Path
        the folder that `Run.write` or `o3dls run` made.

    Returns
    -------
    Run
        `estimates` by name, with surfaces in the map frame; their `scores`, lengths in the unit of
        `run.unit`.

    Raises
    ------
    InputError
        where the folder holds no finished run, or was damaged.

    Examples
    --------
    >>> import o3dls
    >>> run = o3dls.read_run("run")
    >>> list(run.estimates), run.final, run.unit
    (['start', 'landmarks', 'icp', 'deform'], 'deform', 'mm')
    """
    folder, found = Path(folder), read_record(folder)
    held_out, kept = folder / "held_out.csv", found.estimates
    case = replace(read_kept_case(folder / "case"), image=found.case.image)
    points = read_points(folder / "points.csv", case.dimension)
    for name in kept:
        values = points.columns.get(f"distance_{name}_{case.units}")
        if values is None or values.dtype.kind != "f":
            raise InputError(
                f"{folder / 'points.csv'}: has no column 'distance_{name}_{case.units}' of numbers, so it "
                "is not as the run wrote it; run it again"
            )
    return Run(
        case=case,
        estimates={name: read_estimate(folder / "estimates" / name, one, case) for name, one in kept.items()},
        fitted={},
        scores={name: one.scores for name, one in kept.items()},
        validity={name: one.validity for name, one in kept.items()},
        provenance=found,
        points=points,
        held_out=read_points(held_out, case.dimension) if held_out.is_file() else None,
        ends_with=found.final,
    )


def repeats(folder: Path, pipeline: Mapping[str, Any], case: Case) -> bool:
    """Return whether the folder holds an earlier run of a pipeline, by its record, on the files of this
    case.
    """
    found = read_record(folder)
    same = found.case.files == case.files and found.case.image == case.image
    return same and found.pipeline == plain(pipeline)


def is_done(folder: Path, pipeline: Mapping[str, Any], case: Case) -> bool:
    """Return whether the folder holds, with every file, a run of a pipeline on this case by this version."""
    try:
        made_by = read_record(folder).versions.get("o3dls")
        return made_by == version_of("o3dls") and repeats(folder, pipeline, case) and not missing(folder)
    except (InputError, ValueError):  # the run is missing or damaged
        return False


def check_not_of_a_run(path: str | Path) -> None:
    """Raise InputError where a file to be written would replace what a finished run is read from."""
    path = Path(path).resolve()
    for folder in path.parents:
        if (folder / "run.json").exists() and path.relative_to(folder).parts[0] in OWN:
            raise InputError(f"{path}: belongs to the run in {folder}; name another file")
