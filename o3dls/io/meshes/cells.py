"""Cells of VTK files, legacy and XML: the triangles that they become, and the cell data of these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Ints
from ...errors import InputError, escaped
from .repair import place_keys
from .surface_file import SurfaceFile
from .triangulation import Indices, strips, triangulate

TEXT = "U"  # numpy's kind of array, whose letters do not matter here
# numbers that VTK gives to the kinds of cells
POINTS_AND_LINES = (1, 2, 3, 4)
STRIP = 6
POLYGON = 7
POLYGONS = (5, POLYGON, 9)  # triangles and quads are polygons too
# corners of the faces of tetrahedra, hexahedra, wedges and pyramids
SOLIDS = {
    10: ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    12: ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    13: ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    14: ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}
# cells of one size: their corners (k, n) and their rows (k,) in the cell data
Block = tuple[Indices, Ints]


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells are in the order of their data: how many corners each has (n,), these one cell behind another,
    and VTK's number of its kind (n,).
    """

    sizes: Ints
    corners: Ints
    types: Ints

    @classmethod
    def of(cls, sizes: Ints, corners: Ints, kind: int) -> Cells:
        """Return cells of one kind."""
        return cls(sizes, corners, np.full(len(sizes), kind))

    @classmethod
    def joined(cls, parts: Sequence[Cells]) -> Cells:
        """Return all cells, in order."""
        none = np.zeros(0, dtype=np.int64)
        sizes, corners, types = (
            np.concatenate([none, *(getattr(part, name) for part in parts)])
            for name in ("sizes", "corners", "types")
        )
        return cls(sizes, corners, types)

    def __len__(self) -> int:
        return len(self.sizes)

    def blocks(self, *kinds: int) -> list[Block]:
        """Return the cells of these kinds in blocks of equal size."""
        starts = np.cumsum(self.sizes) - self.sizes
        chosen = np.isin(self.types, kinds)
        rows = [np.flatnonzero(chosen & (self.sizes == size)) for size in np.unique(self.sizes[chosen])]
        return [(self.corners[starts[r, None] + np.arange(self.sizes[r[0]])], r) for r in rows]

    @property
    def faces(self) -> int:
        """How many of the cells are of a surface, or have one."""
        return len(self) - self.count(*POINTS_AND_LINES)

    def count(self, *kinds: int) -> int:
        return int(np.isin(self.types, kinds).sum())


def surface_of(
    path: Path,
    vertices: Array,
    cells: Cells,
    fields: Mapping[str, NDArray[Any]],
    cell_data: Mapping[str, NDArray[Any]],
    header: str = "",
) -> SurfaceFile:
    """Return the surface that cells bound or are, with point data and with cell data carried to the points;
    text among them is left out.

    Where there are solids it is their boundary: the faces that one of them has alone. Raises InputError for
    kinds of cells that are not read, and as `SurfaceFile.of`, which takes the header text.
    """
    known = (*POINTS_AND_LINES, STRIP, *POLYGONS, *SOLIDS)
    if unknown := set(cells.types.tolist()) - set(known):
        raise InputError(
            f"{path}: holds cells of VTK's type {min(unknown)}: only triangles (5), strips (6), polygons "
            "(7), quads (9), tetrahedra (10), hexahedra (12), wedges (13) and pyramids (14) are read; "
            "extract the surface first"
        )
    solid = cells.count(*SOLIDS) > 0
    blocks = _boundary_faces(path, vertices, cells) if solid else _blocks_of_polygons(cells)
    triangles, owner = triangulate(vertices, *(corners for corners, _ in blocks))
    rows = np.concatenate([np.zeros(0, dtype=np.int64), *(rows for _, rows in blocks)])[owner]
    text = [name for name, values in (*fields.items(), *cell_data.items()) if values.dtype.kind == TEXT]
    notes = [*_describe_cells(cells, solid), *(f"text '{escaped(name)}' is left out" for name in text)]
    on_points = {name: values for name, values in fields.items() if values.dtype.kind != TEXT}
    on_faces = {name: values[rows] for name, values in cell_data.items() if values.dtype.kind != TEXT}
    file = SurfaceFile.of(path, vertices, triangles, on_points, cells=on_faces, header=header).noted(notes)
    return replace(file, surface=file.surface.without_unused()) if solid else file


def _describe_cells(cells: Cells, solid: bool) -> list[str]:
    """Return sentences on what of the cells is not in the surface."""
    beside, lines = cells.count(STRIP, *POLYGONS), cells.count(*POINTS_AND_LINES)
    said = [f"of {cells.count(*SOLIDS)} solid cells their boundary is taken"] if solid else []
    said += [f"{beside} faces beside the solid cells are left out"] if solid and beside else []
    return [*said, f"{lines} cells that are points or lines are left out"] if lines else said


def _blocks_of_polygons(cells: Cells) -> list[Block]:
    blocks = cells.blocks(*POLYGONS)
    for corners, rows in cells.blocks(STRIP):
        blocks += [(part, rows) for part in strips([corners])]
    return blocks


def _boundary_faces(path: Path, vertices: Array, cells: Cells) -> list[Block]:
    """Return faces that one solid has alone, wound outward. Vertices at one place are one: pieces meet in
    them.
    """
    wrong = np.flatnonzero((cells.corners < 0) | (cells.corners >= len(vertices)))
    if len(wrong):
        name = cells.corners[wrong[0]]
        raise InputError(f"{path}: a cell names vertex {name}: there are {len(vertices)}, counted from 0")
    places = np.unique(place_keys(vertices), return_inverse=True)[1].ravel()
    faces: dict[int, list[Block]] = {}
    for kind, sides in SOLIDS.items():
        for corners, rows in cells.blocks(kind):
            needed = max(map(max, sides)) + 1
            if corners.shape[1] != needed:
                raise InputError(
                    f"{path}: cell {rows[0]} of VTK's type {kind} has {corners.shape[1]} corners: must be "
                    f"{needed}"
                )
            for side in sides:
                turned = _turn_outward(vertices, corners[:, side], corners)
                faces.setdefault(len(side), []).append((turned, rows))
    found = []
    for parts in faces.values():
        corners, rows = (np.concatenate(column) for column in zip(*parts, strict=True))
        alone = _single_rows(np.sort(places[corners], axis=1))
        found.append((corners[alone], rows[alone]))
    return found


def _turn_outward(vertices: Array, side: Ints, cell: Ints) -> Ints:
    """Return faces (k, n) of convex cells (k, c), turned to look away from the middles of these."""
    with np.errstate(all="ignore"):  # what is not finite is refused where the surface is made
        places = vertices[side]
        normal = np.cross(places[:, 1] - places[:, 0], places[:, -1] - places[:, 0])
        out = ((places.mean(axis=1) - vertices[cell].mean(axis=1)) * normal).sum(axis=1)
    return np.where((out < 0.0)[:, None], side[:, ::-1], side)


def _single_rows(keys: Ints) -> Ints:
    """Return rows (n, k) that are there once, in order."""
    order = np.lexsort(keys.T)
    differ = (keys[order][1:] != keys[order][:-1]).any(axis=1)
    return np.sort(order[np.append(True, differ) & np.append(differ, True)])
