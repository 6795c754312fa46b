"""The content of a CARTO 3 `.mesh` file (TriangulatedMeshVersion2.0), and its missing values."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ....arrays import Array, Ints

MISSING = -10_000.0
ATTRIBUTE_HEADINGS = (
    ";            Scar   EML",
    "; Scar=0: Vertex is regular vertex (not scar)",
    ";     =1: Vertex has a scar attribute",
    "; EML =0: Vertex is regular vertex (not EML)",
    ";     =1: Vertex has a EML attribute",
)


@dataclass(frozen=True, eq=False)
class CartoMesh:
    """This is everything that a .mesh file says, in its own terms.

    Hidden triangles have groups below 0; colours (n, k) hold CARTO's own missing values. Colours have one
    column more than names, which has no name and is kept. Attribute headings are the comment lines of their
    section.
    """

    vertices: Array
    vertex_normals: Array
    vertex_groups: Ints
    triangles: Ints
    triangle_normals: Array
    triangle_groups: Ints
    colour_names: tuple[str, ...] = ()
    colours: Array = field(default_factory=lambda: np.zeros((0, 0)))
    attribute_headings: tuple[str, ...] = ATTRIBUTE_HEADINGS
    attributes: Ints = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    mesh_id: str = "-1"
    mesh_name: str = ""
    topology: str = "0"
    mesh_colour: tuple[float, ...] = (0.0, 1.0, 0.0, 1.0)
    matrix: tuple[float, ...] = tuple(np.eye(4).ravel())


def present(values: Array) -> Array:
    """Return the values with NaN for those that mean `none`: -10000, and +10000 in some exports."""
    return np.where(np.abs(values) >= -MISSING, np.nan, values)
