"""A Case becomes a case folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..case import Case
from .atomic import staged_folder, write_file
from .case_settings import toml_lines
from .case_surfaces import write_truth
from .manifest import write_manifest
from .points import write_points
from .surfaces import write_surface
from .table import write_table


def write_case(folder: str | Path, case: Case, *, force: bool = False) -> None:
    """Write a case as a folder that `read_case` reads back; the folder appears whole or not at all.

    Parameters
    ----------
    folder : str or Path
        the folder to make.
    case : Case
        with lengths in mm, or px where its `units` say so; surfaces and points each in their own frame.
    force : bool, default False
        replace a case that is there, if o3dls wrote every file in it.

    Raises
    ------
    InputError
        where the folder holds anything and `force` is not set, or what o3dls did not write.

    Examples
    --------
    >>> import o3dls
    >>> case = o3dls.read_case("case")
    >>> o3dls.write_case("copy", case)
    >>> bool((o3dls.read_case("copy").points.xyz == case.points.xyz).all())
    True
    """
    with staged_folder(folder, force) as out:
        write_case_files(out, case)
        write_manifest(out)


def write_case_files(out: Path, case: Case) -> None:
    """Write the files of a case into a folder, which is made where it is not there."""
    out.mkdir(exist_ok=True)
    suffix = "ply" if case.dimension == 3 else "csv"
    axes = tuple("xyz"[: case.dimension])
    settings: dict[str, str | int] = {
        "name": case.name,
        "units": case.units,
        "frame": case.frame,
        "dimension": case.dimension,
        "prior_of": case.prior_of,
    }
    if case.prior_file_units:
        settings["prior_file_units"] = case.prior_file_units
    if case.image:
        settings["image"] = case.image["path"]
    settings["notes"] = case.notes
    write_file(out / "case.toml", toml_lines(settings))
    write_surface(out / f"prior.{suffix}", case.prior, space=case.prior_frame, units=case.units)
    write_points(out / "points.csv", case.points)
    if case.prior_landmarks:
        names = np.array(list(case.prior_landmarks))
        xyz = np.array(list(case.prior_landmarks.values()))
        write_table(out / "prior_landmarks.csv", {"name": names, **dict(zip(axes, xyz.T, strict=True))})
    if case.init is not None:
        rows = case.init.tolist()
        write_file(out / "init.csv", "".join(",".join(map(repr, row)) + "\n" for row in rows))
    if case.phases:
        (out / "phases").mkdir()
    for k, phase in enumerate(case.phases, 1):
        write_surface(out / "phases" / f"{k:02d}.{suffix}", phase, units=case.units)
    if case.truth is not None:
        write_truth(out, case.truth, axes, suffix, case.units)
