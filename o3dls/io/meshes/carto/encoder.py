"""A CARTO 3 `.mesh` file as CARTO prints it; real files are rewritten byte for byte."""

from __future__ import annotations

import numpy as np

from ....arrays import Array, Ints
from ...text import join_rows
from .mesh import CartoMesh

RIGHTS = (
    "#TriangulatedMeshVersion2.0",
    "; Biosense Webster Triangulated Mesh file format, 2008",
    "; Rights Biosense Webster, LTD",
    "; http://www.biosensewebster.com",
)


def encode(mesh: CartoMesh) -> bytes:
    """Encode the file as CARTO prints it: CRLF, cp1252, its blank lines, and its glued colour heading."""
    blocks = [
        "".join(f"{line}\n" for line in RIGHTS),
        "[GeneralAttributes]\n"
        + "".join(f"{key:<23s}= {value}\n" for key, value in _general_attributes(mesh)),
        "[VerticesSection]\n;                   X             Y             Z        NormalX   NormalY   "
        "NormalZ  GroupID\n",
        _number_rows(
            " %13.3f %13.3f %13.3f   %9.5f %9.5f %9.5f %8d",
            mesh.vertices,
            mesh.vertex_normals,
            mesh.vertex_groups,
        ),
        "[TrianglesSection]\n;           Vertex0  Vertex1  Vertex2     NormalX   NormalY   NormalZ  "
        "GroupID\n",
        _number_rows(
            " %8d %8d %8d   %9.5f %9.5f %9.5f %8d",
            mesh.triangles,
            mesh.triangle_normals,
            mesh.triangle_groups,
        ),
    ]
    if mesh.colour_names:
        names = "".join(f"{name:>14s}" for name in mesh.colour_names)
        heading = (
            "; Color Value= -10000 indicates invalid data for this coloring for this point\n;     "
            f"     {names}[ColorsScaleSection]\n"
        )
        blocks += [
            "[VerticesColorsSection]\n" + heading,
            _number_rows(" " + " %13.5f" * mesh.colours.shape[1], mesh.colours),
        ]
    flags = _number_rows(" " + "%6d" * mesh.attributes.shape[1], mesh.attributes)
    blocks.append(
        "[VerticesAttributesSection]\n" + "".join(f"{line}\n" for line in mesh.attribute_headings) + flags
    )
    text = "\n".join(blocks).replace("\n", "\r\n")
    return text.encode() if text.isascii() else text.encode("cp1252", errors="replace")


def _number_rows(form: str, *columns: Array | Ints) -> str:
    """Return rows `index = numbers`, with indices counted from 0."""
    table = np.column_stack([np.arange(len(columns[0])), *columns])
    return join_rows(f"%8d ={form}\n", table)


def _general_attributes(mesh: CartoMesh) -> list[tuple[str, str]]:
    """Return the keys of the first section, in CARTO's order."""
    k = len(mesh.colour_names)
    colours = [
        ("ColorsIDs", "".join(f"{i}  " for i in range(k))),
        ("ColorsNames", "".join(f"{name}  " for name in mesh.colour_names)),
    ]
    return [
        ("MeshID", mesh.mesh_id),
        ("MeshName", mesh.mesh_name),
        ("NumVertex", str(len(mesh.vertices))),
        ("NumTriangle", str(len(mesh.triangles))),
        ("TopologyStatus", mesh.topology),
        ("MeshColor", "".join(f"{value:.5f}   " for value in mesh.mesh_colour)),
        ("Matrix", " ".join(f"{value:g}" for value in mesh.matrix)),
        ("NumVertexColors", str(k)),
        *(colours if k else []),
    ]
