"""Surfaces of a finished run for other programs: mesh formats and the dialect that CARTO imports, each with a sidecar of facts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, get_args

import numpy as np
from pydantic import Field, model_validator

from .errors import InputError, PipelineError, did_you_mean
from .geometry import Surface
from .stage import Writer

if TYPE_CHECKING:
    from .case import Case
    from .run import Run

FormatName = Literal["ply", "stl", "obj", "off", "vtk", "vtp", "carto_vtk"]
FrameName = Literal["LPS", "RAS"]
SUFFIXES = {"carto_vtk": "carto.vtk"}
NOTICE = "o3dls, research software, not for clinical use"


class Export(Writer):
    """Write the surface of an estimate into export/, in a format that other programs read, with a sidecar of facts."""

    name: ClassVar = "export"
    estimate: str | None = Field(None, description="estimate to write; default: the last")
    format: FormatName = Field("ply", description="file format")
    frame: FrameName | None = Field(None, description="frame to write in; default: the frame of the case")
    field: str | None = Field(None, description="carto_vtk: the field that becomes its one scalar; default: none, all vertices 1")
    vmin: float | None = Field(None, description="carto_vtk: value of the field at the lower end of the colours; default: its least")
    vmax: float | None = Field(None, description="carto_vtk: value of the field at the upper end of the colours; default: its largest")

    @model_validator(mode="after")
    def _fitting(self) -> Export:
        if self.format != "carto_vtk" and (self.field, self.vmin, self.vmax) != (None, None, None):
            raise PipelineError(f"export: field, vmin and vmax belong to the format carto_vtk; {self.format} keeps every field as it is")
        if (self.vmin is None) != (self.vmax is None):
            raise PipelineError("export: vmin and vmax must be given together")
        return self

    @property
    def refers_to(self) -> tuple[str, ...]:
        return (self.estimate,) if self.estimate else ()

    def obstacle(self, case: Case) -> str | None:
        if case.dimension == 2:
            return "the case is 2D, and its outlines are in estimates/ as csv already"
        if self.frame and case.frame == "unknown":
            return f"frame = {self.frame!r}: the frame of the case is unknown; say frame = \"LPS\" or \"RAS\" in its case.toml"
        return None

    def __call__(self, run: Run, folder: Path) -> None:
        from .io.mesh import read_surface

        name = self.estimate or run.final
        surface = read_surface(folder / "estimates" / name / "surface.ply")  # with the fields that the run has just computed
        self.write(surface, run, name, folder / "export" / file_name(name, self.format))

    def write(self, surface: Surface, run: Run, name: str, path: Path) -> None:
        """Write an estimate's surface with its fields to a file, and beside it `<file>.json` with frame, units and meaning of values."""
        from .io.mesh import write_surface

        space = self.frame or run.case.frame
        if space != run.case.frame:
            surface = surface.transformed(np.diag([-1.0, -1.0, 1.0, 1.0]))  # LPS and RAS differ by half a turn about z
        facts = _facts(run, name, self.format, space)
        path.parent.mkdir(parents=True, exist_ok=True)
        if self.format == "carto_vtk":
            facts["scalar"] = self._write_carto(surface, path)
        else:
            write_surface(path, surface, space=space, units=run.case.units, format=self.format)
            facts["fields"] = sorted(surface.fields) if self.format in ("ply", "vtk", "vtp") else []
        path.with_name(path.name + ".json").write_text(json.dumps(facts, indent=1, allow_nan=False) + "\n", encoding="utf-8")

    def _write_carto(self, surface: Surface, path: Path) -> dict[str, Any]:
        from .io.atomic import staged_file
        from .io.carto_vtk import encode, map_field

        limits = None if self.vmin is None or self.vmax is None else (self.vmin, self.vmax)
        scalar = map_field(surface, self.field, limits)
        with staged_file(path) as staged:
            staged.write_bytes(encode(surface, scalar.values))
        return dict(scalar.meaning)


def export_run(
    folder: str | Path, out: str | Path | None = None, *, estimate: str | None = None, format: str = "ply", **options: Any
) -> Path:
    """Write the surface of an estimate (default: the last) of a finished run; `out` is a file, by default in the run's export folder.

    Further options as for `Export`. Raises InputError where the run, the estimate or the format is not there.
    """
    from .run_folder import read_run

    if format not in get_args(FormatName):
        raise InputError(f"export: no format '{format}'{did_you_mean(format, list(get_args(FormatName)))}")
    writer = Export(estimate=estimate, format=format, **options)
    run = read_run(folder)
    name = estimate or run.final
    if name not in run.estimates:
        raise InputError(f"{folder}: no estimate '{name}'{did_you_mean(name, list(run.estimates))}")
    if why := writer.obstacle(run.case):
        raise InputError(f"{folder}: {why}")
    path = Path(out) if out else Path(folder) / "export" / file_name(name, format)
    writer.write(run.estimates[name].surface, run, name, path)
    return path


def file_name(estimate: str, format: str) -> str:
    """Name of an exported file; the CARTO dialect is told from plain VTK."""
    return f"{estimate}.{SUFFIXES.get(format, format)}"


def _facts(run: Run, name: str, format: str, space: str) -> dict[str, Any]:
    """What a reader of the file must know and the file cannot say. No name of a case: it may be a patient's."""
    estimate = run.estimates[name]
    return {
        "notice": NOTICE,
        "estimate": name,
        "format": format,
        "frame": space,
        "units": run.case.units,
        "T_map_prior": estimate.T_map_prior.tolist(),
        "T_map_prior_frame": run.case.frame,
        "status": estimate.status,
        "versions": dict(run.provenance["versions"]),
    }
