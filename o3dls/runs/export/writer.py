"""The writer `export`: an estimate as a file for other programs, with a sidecar of facts."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ...adapters.voxels import spacing_mistake
from ...errors import PipelineError
from ...geometry.surface import Surface
from ...io.atomic import staged_files, write_file
from ...plugins.stage import FINEST
from ..writers import Writer
from .between import unknown_sides, write_between
from .facts import facts_of, log_sentences, write_facts
from .formats import BETWEEN, NEED_FRAME, FormatName, FrameName, file_name
from .placed import On, Placed, frame_of, placed, units_of, unknown_frame
from .volume import write_enclosed_volume, write_labels_like

if TYPE_CHECKING:
    from ...case import Case, Points
    from ..run import Run


class Export(Writer):
    """Write an estimate into export/ as a surface, a volume, a pose or a file for a navigation system.

    A sidecar says its facts.
    """

    name: ClassVar = "export"
    estimate: str | None = Field(default=None, description="estimate to write; default: the last")
    format: FormatName = Field(default="ply", description="file format")
    on: On = Field(
        default="map",
        description="where: on the map; or on the prior's own surface in its own frame, the patient's image",
    )
    frame: FrameName | None = Field(
        default=None, description="frame to write in; default: that of the map or the prior"
    )
    field: str | None = Field(
        default=None, description="carto_vtk, dif: the field that becomes its one scalar; default: none"
    )
    vmin: float | None = Field(
        default=None,
        description="carto_vtk: value of the field at the lower end of the colours; default: its least",
    )
    vmax: float | None = Field(
        default=None,
        description="carto_vtk: value of the field at the upper end of the colours; default: its largest",
    )

    faces: int | None = Field(
        default=None,
        ge=4,
        description="most triangles, by decimation; default: the limit of the system, else all",
    )
    spacing: float = Field(
        default=1.0,
        ge=FINEST,
        description="phi, mask, itk and mrb: size of a voxel, distance of nodes",
        json_schema_extra={"unit": "mm"},
    )
    grid: Path | None = Field(
        default=None, description="mask: image whose voxels it takes, with the wall labelled apart"
    )

    image: Path | None = Field(
        default=None, description="mrb: grey image of the prior; default: that of the case, if it names one"
    )

    @model_validator(mode="after")
    def _check_options(self) -> Export:
        if self.format != "carto_vtk" and (self.vmin, self.vmax) != (None, None):
            raise PipelineError(
                f"export: vmin and vmax belong to the format carto_vtk; {self.format} writes values as "
                "they are"
            )
        if self.format not in ("carto_vtk", "dif") and self.field is not None:
            raise PipelineError(
                f"export: field belongs to the formats carto_vtk and dif; {self.format} keeps every "
                "field it can"
            )
        if (self.vmin is None) != (self.vmax is None):
            raise PipelineError("export: vmin and vmax must be given together")
        if self.vmin is not None and self.vmax is not None and not self.vmin < self.vmax:
            raise PipelineError(f"export: vmin = {self.vmin:g} must be below vmax = {self.vmax:g}")
        if self.format == "dif" and self.frame == "RAS":
            raise PipelineError("export: DIF files are in LPS by definition; omit frame")
        if self.grid is not None and not self.format.startswith("mask"):
            raise PipelineError(
                f"export: grid belongs to the formats mask_nrrd and mask_nifti, not {self.format}"
            )
        if self.image is not None and self.format != "mrb":
            raise PipelineError(f"export: image belongs to the format mrb, not {self.format}")
        if self.format in BETWEEN and (self.on, self.frame) != ("map", None):
            raise PipelineError(f"export: {self.format} holds both map and prior, in LPS; omit on and frame")
        if self.field is None and self.vmin is not None:
            raise PipelineError("export: vmin and vmax are limits of a field, and none is named; say field")
        return self

    @property
    def refers_to(self) -> tuple[str, ...]:
        return (self.estimate,) if self.estimate else ()

    def target(self, final: str) -> tuple[str, ...]:
        on = ("on prior",) if self.on == "prior" else ()
        return (self.name, self.estimate or final, self.format, *on)

    def mistake(self, case: Case) -> str | None:
        """Say what of the grid or the spacing is wrong; the result is taken to be about as large as the
        prior.
        """
        if self.image is not None and not self.image.exists():
            return f"image = '{self.image}': no such file or folder"
        if self.grid is not None:
            return None if self.grid.is_file() else f"grid = '{self.grid}': no such image"
        return spacing_mistake(case.prior, self.spacing) if self.format.startswith(("phi", "mask")) else None

    def obstacle(self, case: Case) -> str | None:
        from ...io.surfaces import IN_MILLIMETRES

        if case.dimension == 2:
            return "the case is 2D, and its outlines are in estimates/ as csv already"
        unknown = frame_of(case, self.on) == "unknown" and unknown_frame(self.on)
        if self.frame and unknown:
            return f"frame = {self.frame!r}: {unknown}"
        if self.format in (*IN_MILLIMETRES, *NEED_FRAME, *BETWEEN) and case.units != "mm":
            return f"format = {self.format!r} is in mm by definition, and the case is in {case.units}"
        if self.format in NEED_FRAME and unknown:
            return f"format = {self.format!r} lies in LPS or RAS by definition, and {unknown}"
        if self.format in BETWEEN and unknown_sides(case):
            return f"format = {self.format!r} is in LPS by definition, and {unknown_frame('prior')}"
        if self.grid and unknown:
            return f"grid = '{self.grid}': {unknown}"
        return None

    def __call__(self, run: Run, folder: Path) -> None:
        name = self.estimate or run.final
        path = folder / "export" / file_name(name, self.format, self.on)
        self.write(run.estimates[name].surface, run, name, path)

    def write(self, surface: Surface, run: Run, name: str, path: Path, within: Path | None = None) -> None:
        """Write an estimate's surface with its fields to a file, and its facts to `<file>.json` beside it.

        The facts are frame, units, pose and meaning of values. within: as for `staged_file`.
        """
        if self.format in BETWEEN:
            with staged_files(path, within) as staged:
                written = write_between(
                    run, name, self.format, staged, spacing=self.spacing, image=self.image
                )
            log_sentences(path, written.sentences)
            log_sentences(path, written.failures, logging.WARNING)
            return
        # DIF is in LPS by definition
        frame = "LPS" if self.format == "dif" and frame_of(run.case, self.on) == "RAS" else self.frame
        what = placed(run, name, surface, self.on, frame)
        units, own = units_of(run.case, self.on, self.format)
        what = what.in_units(units)
        facts = facts_of(run, name, self.format, self.on, what.frame, units)
        if units != own:
            log_sentences(
                path, [f"is in {units}, as every {self.format} is; the prior's own file is in {own}"]
            )
        if self.format == "opencarp":
            from ...io.meshes.opencarp import check_fields

            # files beside `path` are not seen in the temporary folder that is written first
            check_fields(path, self._decimate_to_limit(what.surface))
        with staged_files(path, within) as staged:
            facts |= self._write_format(what, staged, units)
            write_facts(staged, facts)

    def _write_format(self, what: Placed, path: Path, units: str) -> dict[str, Any]:
        """Write one file of the format; what only this format has to say goes into the sidecar."""
        from ...io.points import write_points
        from ...io.surfaces import read_surface_file, write_surface
        from ...io.transforms import write_transform

        if self.format in ("tfm", "txt"):
            # where one side's frame is unknown, its coordinates count as the other's
            write_transform(path, what.pose, what.frame)
            return {"moves": "the prior onto the map" if self.on == "map" else "the map onto the prior"}
        if self.format == "csv":
            write_points(path, what.points, space=what.frame, units=units)
            return {"points": len(what.points)}
        surface = what.surface
        if self.grid is not None:
            return write_labels_like(path, surface, self.grid, what.frame)
        surface = self._decimate_to_limit(surface)
        counts: dict[str, Any] = {"vertices": len(surface.vertices), "triangles": len(surface.faces)}
        if self.format == "carto_vtk":
            return counts | {"scalar": self._write_carto(surface, path)}
        if self.format == "dif":
            return counts | {"scalar": self._write_dif(surface, path)}
        if self.format.startswith(("phi", "mask")):
            return write_enclosed_volume(
                path, surface, self.spacing, what.frame, distance=self.format.startswith("phi")
            )
        if self.format == "openep":
            counts |= _write_openep(surface, path, what.points)
        else:
            log_sentences(
                path, write_surface(path, surface, space=what.frame, units=units, format=self.format)
            )
        if self.format == "opencarp":
            counts["units"] = "um"
        # a format may hold fewer than the surface has
        return counts | {"fields": sorted(read_surface_file(path, units="um").surface.fields)}

    def _decimate_to_limit(self, surface: Surface) -> Surface:
        """Return the surface decimated to `faces`, and to what an importing system takes."""
        from ...adapters.mending import decimated
        from ...io.meshes.dif import LIMITS

        most = min(
            self.faces or len(surface.faces),
            LIMITS["triangles"] if self.format == "dif" else len(surface.faces),
        )
        if self.format == "dif" and len(surface.vertices) > LIMITS["vertices"]:
            # Euler: a closed surface has two triangles per vertex, and two vertices more
            most = min(most, 2 * LIMITS["vertices"] - 4)
        return decimated(surface, most) if most < len(surface.faces) else surface

    def _write_carto(self, surface: Surface, path: Path) -> dict[str, Any]:
        from ...io.meshes.carto.import_vtk import encode, map_field

        limits = None if self.vmin is None or self.vmax is None else (self.vmin, self.vmax)
        scalar = map_field(surface, self.field, limits)
        write_file(path, encode(surface, scalar))
        log_sentences(path, scalar.notes)
        return dict(scalar.meaning)

    def _write_dif(self, surface: Surface, path: Path) -> dict[str, Any]:
        from ...io.meshes.dif import encode

        write_file(path, encode(surface, field=self.field))
        missing = 0 if self.field is None else int((~np.isfinite(surface.fields[self.field])).sum())
        return {"field": self.field, "values": "as they are", "missing_vertices_unsampled": missing}


def _write_openep(surface: Surface, path: Path, points: Points) -> dict[str, Any]:
    """Write the surface with the measured points, which OpenEP's tools interpolate."""
    from ...io.matlab.openep import encode, losses
    from ...io.matlab.openep_points import SIGNALS

    write_file(path, encode(surface, points))
    log_sentences(path, losses(surface))
    kinds = {kind: int((points.type == kind).sum()) for kind in ("eam", "ablation")}
    return {"points": kinds, "electrograms": SIGNALS}
