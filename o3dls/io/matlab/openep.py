"""OpenEP data sets (`userdata` in a .mat file): shell with maps, measured points, ablation sites."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...case import Points
from ...errors import InputError
from ...geometry.surface import Surface
from ..kinds import kind_of
from ..meshes.carto.mesh import MISSING
from ..meshes.surface_file import SurfaceFile, left_out
from . import mat
from .mat5 import Opaque
from .openep_points import SIGNALS, electric_of, rfindex_of

knows = mat.knows
SURFACE_MAPS = {"act_bip": ("lat", "bipolar"), "uni_imp_frc": ("unipolar", "impedance", "force")}
# members of `electric` that an import leaves
NOT_READ = {
    "names": "names of points (electric.names)",
    "egmSurfX": "positions projected on the shell (electric.egmSurfX)",
    "egmUniX": "positions of single electrodes (electric.egmUniX)",
    "barDirection": "directions of the catheter (electric.barDirection)",
    "impedances": "impedances over time (electric.impedances)",
}
NOTE = "written by o3dls, research software, not for clinical use"


def userdata(path: Path, data: bytes) -> Mapping[str, Any]:
    """Return the one variable of an OpenEP file. Raises InputError where it is not there."""
    found = mat.load(path, data).get("userdata")
    if isinstance(found, Opaque):
        raise InputError(
            f"{path}: userdata is a MATLAB object of class {found.of}; save it as a struct of plain arrays"
        )
    if not isinstance(found, Mapping):
        kind = kind_of(data)  # HDF5 that MATLAB did not write
        raise InputError(
            f"{path}: is {kind}"
            if kind
            else f"{path}: holds no struct 'userdata'; it is not an OpenEP data set"
        )
    return found


def read(path: Path, data: bytes) -> SurfaceFile:
    """Read the shell in mm with the maps that hold any value."""
    tree = userdata(path, data)
    vertices = mat.numbers(path, tree, "surface.triRep.X", 3)
    triangles = mat.numbers(path, tree, "surface.triRep.Triangulation", 3)
    if vertices is None or triangles is None:
        raise InputError(
            f"{path}: has no surface.triRep.X and .Triangulation; a TriRep object must be saved as a struct"
        )
    fields: dict[str, Array] = {}
    for name, columns in SURFACE_MAPS.items():
        values = _rows_at(path, tree, f"surface.{name}", len(vertices), len(columns))
        if values is not None:
            fields |= {
                column: values[:, k] for k, column in enumerate(columns) if np.isfinite(values[:, k]).any()
            }
    return replace(SurfaceFile.of(path, vertices, triangles - 1, fields), units="mm")


def shell_class(path: Path, data: bytes) -> str | None:
    """Return the class of the MATLAB object that stands in place of the shell's arrays; None where none
    does.
    """
    found = (mat.at(userdata(path, data), f"surface.triRep.{name}") for name in ("X", "Triangulation"))
    return next((value.of for value in found if isinstance(value, Opaque)), None)


def has_shell(path: Path, data: bytes) -> bool:
    """Return whether the data set has a part of a shell: one with a part alone is damaged, one without has
    its points.
    """
    tree = userdata(path, data)
    return any(mat.at(tree, f"surface.triRep.{name}") is not None for name in ("X", "Triangulation"))


def read_points(path: Path, data: bytes) -> Points:
    """Read included electrode positions with bipolar, unipolar (mV) and lat (ms), and the ablation sites.
    Raises InputError without any.
    """
    tree = userdata(path, data)
    xyz = mat.numbers(path, tree, "electric.egmX", 3)
    xyz = np.zeros((0, 3)) if xyz is None else xyz
    sites = mat.numbers(path, tree, "rfindex.tag.X", 3)
    sites = np.zeros((0, 3)) if sites is None else sites
    include = _rows_at(path, tree, "electric.include", len(xyz))
    keep = np.isfinite(xyz).all(axis=1) & (True if include is None else include > 0)
    if keep.sum() + len(sites) == 0:
        raise InputError(f"{path}: has no measured points (electric.egmX)")
    columns: dict[str, NDArray[Any]] = {
        name: np.append(values[keep], np.full(len(sites), np.nan))
        for name, values in _point_columns(path, tree, len(xyz))
    }
    if (tags := _tag_column(path, tree, len(xyz))) is not None:
        columns["tags"] = np.append(tags[keep], np.full(len(sites), ""))
    kinds = np.array(["eam"] * int(keep.sum()) + ["ablation"] * len(sites))
    return Points(np.vstack([xyz[keep], sites]), kinds, columns)


def _tag_column(path: Path, tree: Mapping[str, Any], n: int) -> NDArray[np.str_] | None:
    """Return the tags of the measured points as text, those of one point with `+` between; None without any.
    Raises InputError where they are not one for each.
    """
    found = mat.at(tree, "electric.tags")
    if found is None or isinstance(found, Opaque) or np.size(np.asarray(found, dtype=object)) == 0:
        return None
    cells = [found] if isinstance(found, str) else list(np.ravel(np.asarray(found, dtype=object)))
    if len(cells) != n:
        raise InputError(f"{path}: electric.tags has {len(cells)} rows: must be {n}, one for each position")
    rows = [[cell] if isinstance(cell, str) else np.ravel(np.asarray(cell, dtype=object)) for cell in cells]
    texts = [" + ".join(str(tag) for tag in row if isinstance(tag, str) and tag) for row in rows]
    return np.array(texts) if any(texts) else None


def unread(path: Path, data: bytes) -> list[str]:
    """Return what a data set holds of its points and `read_points` does not take."""
    tree = userdata(path, data)
    held = [(what, mat.at(tree, f"electric.{name}")) for name, what in NOT_READ.items()]
    return ["electrograms", *(what for what, value in held if value is not None and np.size(value))]


def _point_columns(path: Path, tree: Mapping[str, Any], n: int) -> list[tuple[str, Array]]:
    """Return columns of the measured points that hold any value; the activation time is counted from the
    reference annotation.
    """
    found = [(name, _rows_at(path, tree, f"electric.voltages.{name}", n)) for name in ("bipolar", "unipolar")]
    marks, reference = (
        _rows_at(path, tree, f"electric.annotations.{name}", n) for name in ("mapAnnot", "referenceAnnot")
    )
    rate = mat.numbers(path, tree, "electric.sampleFrequency")
    if marks is not None and reference is not None:
        marks = np.where(marks == MISSING, np.nan, marks)
        found.append(
            ("lat", (marks - reference) * 1000.0 / (rate[0] if rate is not None and rate[0] > 0 else 1000.0))
        )
    return [(name, values) for name, values in found if values is not None and np.isfinite(values).any()]


def _rows_at(
    path: Path, tree: Mapping[str, Any], where: str, n: int, width: int | None = None
) -> Array | None:
    """Return numbers at `a.b.c`, NaN where one is not finite: a row for each of n positions (or one for all);
    None without. Raises InputError.
    """
    values = mat.numbers(path, tree, where, width)
    if values is None:
        return None
    if len(values) == 1:  # one value stands for all positions
        values = np.repeat(values, n, axis=0)
    if len(values) != n:
        raise InputError(f"{path}: {where} has {len(values)} rows: must be {n}, one for each position")
    return np.where(np.isfinite(values), values, np.nan)


def write(file: SurfaceFile) -> bytes:
    """Encode a shell with its maps, and no points."""
    return encode(file.surface, None)


def encode(surface: Surface, points: Points | None) -> bytes:
    """Encode a shell with its maps, and measured points and ablation sites in its frame, all in mm; what
    OpenEP's readers ask for and is not known is there, and empty.
    """
    n = len(surface.vertices)
    maps = {
        name: np.column_stack([_scalar_field(surface, column, n) for column in columns])
        for name, columns in SURFACE_MAPS.items()
    }
    shell = {"X": surface.vertices, "Triangulation": surface.faces + 1.0}
    tree = {
        "notes": NOTE if points is None else f"{NOTE}; {SIGNALS}",
        "surface": {"triRep": shell, "isVertexAtRim": np.zeros((n, 1)), **maps},
        "electric": electric_of(points),
        "rf": {"originaldata": {"ablparams": {"time": np.zeros((0, 0))}}},
        **rfindex_of(points),
    }
    return save(tree)


def _scalar_field(surface: Surface, name: str, n: int) -> Array:
    values = surface.fields.get(name)
    return np.full(n, np.nan) if values is None or values.ndim > 1 else values


def losses(surface: Surface) -> list[str]:
    """Return sentences on what `write` does not keep."""
    columns = {column for columns in SURFACE_MAPS.values() for column in columns}
    return left_out(
        surface, [name for name in columns if surface.fields.get(name, np.zeros((1, 1))).ndim == 1]
    )


def save(tree: Mapping[str, Any]) -> bytes:
    """Return the bytes of a .mat file (version 5) with this userdata; the header carries no time, so equal
    data give equal bytes.
    """
    from scipy.io import savemat

    buffer = io.BytesIO()
    savemat(buffer, {"userdata": dict(tree)}, oned_as="column", do_compression=True)  # type: ignore[arg-type]  # the stubs leave files out
    return b"MATLAB 5.0 MAT-file, o3dls".ljust(116) + buffer.getvalue()[116:]
