"""A map's shell with its colours from and to CARTO 3 `.mesh` files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ....errors import InputError
from ....geometry.surface import Surface
from ..surface_file import SurfaceFile, left_out
from .encoder import encode
from .mesh import MISSING, CartoMesh, present
from .parser import parse

MAGIC = b"#TriangulatedMeshVersion2.0"
COLOURS = (
    "Unipolar",
    "Bipolar",
    "LAT",
    "Impedance",
    "A1",
    "A2",
    "A2-A1",
    "SCI",
    "ICL",
    "ACL",
    "Force",
    "Paso",
    "µBi",
)
OUR_NAMES = {
    "Unipolar": "unipolar",
    "Bipolar": "bipolar",
    "LAT": "lat",
    "Force": "force",
    "Impedance": "impedance",
}


def knows(data: bytes) -> bool:
    return data.lstrip(b"\xef\xbb\xbf")[: len(MAGIC)] == MAGIC


def read(path: Path, data: bytes, *, hidden: bool = False) -> SurfaceFile:
    """Read the visible shell in mm; `hidden` keeps triangles of negative groups too.

    Vertices without a triangle are left out.
    """
    mesh = parse(path, data)
    if not np.allclose(mesh.matrix, np.eye(4).ravel()):
        raise InputError(
            f"{path}: its Matrix is not the identity, and how the system applies it is not documented; "
            "apply it with the system's own tools"
        )
    triangles = mesh.triangles if hidden else mesh.triangles[mesh.triangle_groups >= 0]
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    used = np.unique(triangles)
    if len(used) and (used[0] < 0 or used[-1] >= len(mesh.vertices)):
        raise InputError(
            f"{path}: triangles name vertices {used[0]} to {used[-1]}: there are {len(mesh.vertices)}, "
            "counted from 0"
        )
    index = np.zeros(len(mesh.vertices), dtype=np.int64)
    index[used] = np.arange(len(used))
    fields = {
        OUR_NAMES.get(name, name): present(mesh.colours[used, k]) for k, name in enumerate(mesh.colour_names)
    }
    flags = mesh.attributes[used].astype(np.float64) if len(mesh.attributes) else np.zeros((len(used), 0))
    fields |= {
        name: flags[:, k]
        for k, name in enumerate(mesh.attribute_headings[0].lstrip(" ;").split()[: flags.shape[1]])
    }
    # CARTO writes slots that it leaves empty
    fields = {name: values for name, values in fields.items() if np.nan_to_num(values).any()}
    facts = {
        "name": mesh.mesh_name,
        "hidden_triangles": len(mesh.triangles) - len(triangles),
        "vertex_rows": used,
    }
    file = SurfaceFile.of(path, mesh.vertices[used], index[triangles], fields)
    return replace(file, units="mm", metadata=facts)


def write(file: SurfaceFile) -> bytes:
    """Encode a surface with the fields that CARTO has a colour or a flag for; others are lost.

    Missing values become -10000.
    """
    surface = file.surface
    n = len(file.surface.vertices)
    found = {name: surface.fields.get(OUR_NAMES.get(name, name)) for name in COLOURS}
    columns = [
        np.full(n, MISSING) if v is None or v.ndim > 1 else np.where(np.isfinite(v), v, MISSING)
        for v in found.values()
    ]
    flags = [np.nan_to_num(surface.fields.get(name, np.zeros(n))) for name in ("Scar", "EML")]
    coloured = any(values is not None for values in found.values())
    mesh = CartoMesh(
        surface.vertices,
        surface.vertex_normals,
        np.zeros(n, dtype=np.int64),
        surface.faces,
        surface.face_normals,
        np.zeros(len(surface.faces), dtype=np.int64),
        COLOURS if coloured else (),
        np.column_stack([*columns, np.full(n, MISSING)]),
        attributes=np.column_stack(flags).astype(np.int64) if coloured else np.zeros((0, 2), dtype=np.int64),
    )
    return encode(mesh)


def losses(surface: Surface) -> list[str]:
    """Return sentences on what `write` does not keep."""
    colours = {OUR_NAMES.get(name, name) for name in COLOURS}
    kept = {name for name, values in surface.fields.items() if name in colours and values.ndim == 1}
    return left_out(surface, kept | {"Scar", "EML"} if colours & surface.fields.keys() else ())
