"""Nodes of a scene as a case folder of o3dls: everything where it is shown, in LPS and mm."""

from __future__ import annotations

import csv
import gzip
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import vtk
from vtk.util.numpy_support import vtk_to_numpy

TO_LPS = np.array([-1.0, -1.0, 1.0])
LABELMAP, SURFACE = "Binary labelmap", "Closed surface"  # representations of a segmentation
MISSING = 10_000.0  # CARTO writes -10000 where there is no value
AXES = ("x", "y", "z")
# how SlicerHeart describes a point that it read from a CARTO export
DESCRIBED = re.compile(r"(Bipolar|Unipolar|LAT) (-?[\d.]+(?:e[+-]?\d+)?)")


class InputError(Exception):
    """What is wrong with the nodes that were chosen, in a sentence."""


@dataclass
class Chosen:
    """These nodes were chosen: the prior (a model, or a segmentation with the id of its segment), the points
    (fiducials, a model or a table), and, where there are any, ablation sites, and landmarks on both sides.
    """

    prior: Any
    points: Any
    segment: str = ""
    ablation: Any = None
    landmarks_prior: Any = None
    landmarks_map: Any = None


def write_case(folder: Path, chosen: Chosen) -> None:
    """Write what was chosen as a case. Raises InputError."""
    folder.mkdir(parents=True)
    if chosen.prior is None:
        raise InputError("choose the prior: a model, or a segmentation and its segment")
    if chosen.points is None:
        raise InputError("choose the points: fiducials, a model or a table")
    _write_prior(folder, chosen.prior, chosen.segment)
    rows = points_of(chosen.points)
    for node, kind in ((chosen.ablation, "ablation"), (chosen.landmarks_map, "landmark")):
        rows += [row | {"type": kind} for row in ([] if node is None else points_of(node))]
    _write_rows(folder / "points.csv", rows)
    if chosen.landmarks_prior is not None:
        marks = points_of(chosen.landmarks_prior)
        _write_rows(
            folder / "prior_landmarks.csv", [{key: row[key] for key in ("name", *AXES)} for row in marks]
        )
    text = 'name = "from Slicer"\nunits = "mm"\nframe = "LPS"\n'
    (folder / "case.toml").write_text(text, encoding="utf-8")


def points_of(node: Any) -> list[dict[str, Any]]:
    """Return the rows of the points of a node, with the values that it knows of them. Raises InputError."""
    if node.IsA("vtkMRMLMarkupsNode"):
        rows = _rows_of_markups(node)
    elif node.IsA("vtkMRMLTableNode"):
        rows = _rows_of_table(node)
    elif node.IsA("vtkMRMLModelNode"):
        rows = _rows_of_model(node)
    else:
        raise InputError(f"{node.GetName()}: must be fiducials, a model or a table")
    if not rows:
        raise InputError(f"{node.GetName()}: holds no point")
    return rows


def _rows_of_markups(node: Any) -> list[dict[str, Any]]:
    """Return the control points that are placed; what SlicerHeart says in their descriptions are values."""
    rows, place = [], [0.0, 0.0, 0.0]
    for k in range(node.GetNumberOfControlPoints()):
        if node.GetNthControlPointPositionStatus(k) != 2:  # placed
            continue
        node.GetNthControlPointPositionWorld(k, place)
        values = dict(DESCRIBED.findall(node.GetNthControlPointDescription(k)))
        rows.append(
            _placed(np.array(place))
            | {"type": "eam", "name": node.GetNthControlPointLabel(k)}
            | {name.lower(): _known(float(value)) for name, value in values.items()}
        )
    return rows


def _rows_of_model(node: Any) -> list[dict[str, Any]]:
    """Return the vertices of a model, as of an anatomical map, with the numbers at each."""
    mesh = node.GetMesh()
    if mesh is None or mesh.GetNumberOfPoints() == 0:
        return []
    data = mesh.GetPointData()
    arrays = {
        data.GetArrayName(k): data.GetArray(k) for k in range(data.GetNumberOfArrays()) if data.GetArray(k)
    }
    single = {name: vtk_to_numpy(one) for name, one in arrays.items() if one.GetNumberOfComponents() == 1}
    return [
        _placed(place)
        | {"type": "eam", "name": ""}
        | {name.lower(): _known(float(values[k])) for name, values in single.items()}
        for k, place in enumerate(_world_points(node, mesh))
    ]


def _rows_of_table(node: Any) -> list[dict[str, Any]]:
    """Return the rows of a table with columns x, y and z, which are in RAS as all of a scene is."""
    table = node.GetTable()
    names = [table.GetColumnName(k) for k in range(table.GetNumberOfColumns())]
    lower = [name.lower() for name in names]
    if not set(AXES) <= set(lower):
        raise InputError(f"{node.GetName()}: must have columns x, y and z; it has {', '.join(names)}")
    rows = []
    for r in range(table.GetNumberOfRows()):
        cells = {name: _cell(table.GetValue(r, k)) for k, name in enumerate(lower)}
        try:
            place = np.array([float(cells[axis]) for axis in AXES])
        except ValueError:
            raise InputError(f"{node.GetName()}: row {r + 1} has no place: {cells}") from None
        rows.append({"type": "eam", "name": ""} | cells | _placed(place))
    return rows


def _cell(value: Any) -> float | str:
    """Return the value of a cell; as a text VTK would round a number to six digits."""
    return _known(value.ToDouble()) if value.IsNumeric() else value.ToString()


def _placed(ras: np.ndarray) -> dict[str, Any]:
    return dict(zip(AXES, (TO_LPS * ras).tolist(), strict=True))


def _known(value: float) -> float | str:
    return "" if not np.isfinite(value) or abs(value) >= MISSING else value


def _write_rows(path: Path, rows: list[dict[str, Any]]) -> None:
    columns = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        file.write("# space=LPS units=mm\n")
        table = csv.DictWriter(file, columns, restval="")
        table.writeheader()
        table.writerows(rows)


def _write_prior(folder: Path, node: Any, segment: str) -> None:
    if node.IsA("vtkMRMLModelNode"):
        mesh = node.GetMesh()
        if mesh is None or mesh.GetNumberOfCells() == 0:
            raise InputError(f"{node.GetName()}: is empty")
        _write_surface(folder / "prior.vtp", mesh, _world_points(node, mesh))
        return
    found = node.GetSegmentation().GetSegment(segment)
    if found is None:
        raise InputError(f"{node.GetName()}: choose one of its segments")
    image, surface = (found.GetRepresentation(name) for name in (LABELMAP, SURFACE))
    if image is not None:
        _write_labels(folder / "prior.nrrd", image, found.GetLabelValue(), _linear(node))
    elif surface is not None:
        _write_surface(folder / "prior.vtp", surface, _world_points(node, surface))
    else:
        raise InputError(f"{node.GetName()}: the segment has neither voxels nor a surface")


def _world_points(node: Any, mesh: Any) -> np.ndarray:
    """Return the points (n, 3) of a mesh in the world's RAS, through all transforms above its node."""
    points = vtk_to_numpy(mesh.GetPoints().GetData()).astype(np.float64)
    parent = node.GetParentTransformNode()
    if parent is None:
        return points
    whole = vtk.vtkGeneralTransform()
    parent.GetTransformToWorld(whole)
    return np.array([whole.TransformPoint(point) for point in points])


def _linear(node: Any) -> np.ndarray:
    """Return the matrix (4, 4) above a node of voxels. Raises InputError where they are bent."""
    parent = node.GetParentTransformNode()
    matrix = vtk.vtkMatrix4x4()
    if parent is not None and not parent.GetMatrixTransformToWorld(matrix):
        raise InputError(f"{node.GetName()}: hangs under a bending transform; harden it first")
    return _array_of(matrix)


def _array_of(matrix: Any) -> np.ndarray:
    return np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])


def _write_surface(path: Path, mesh: Any, ras: np.ndarray) -> None:
    """Write a mesh as VTP that states its frame; its points are given in RAS."""
    moved = vtk.vtkPolyData()
    moved.DeepCopy(mesh)
    places = vtk.vtkPoints()
    places.SetDataTypeToDouble()
    for place in (ras * TO_LPS).tolist():
        places.InsertNextPoint(place)
    moved.SetPoints(places)
    for name, text in (("SPACE", "LPS"), ("UNITS", "mm")):
        stated = vtk.vtkStringArray()
        stated.SetName(name)
        stated.InsertNextValue(text)
        moved.GetFieldData().AddArray(stated)
    writer = vtk.vtkXMLPolyDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(moved)
    if not writer.Write():
        raise InputError(f"{path}: cannot be written")


def _write_labels(path: Path, image: Any, label: int, above: np.ndarray) -> None:
    """Write the voxels of one label as a NRRD."""
    matrix = vtk.vtkMatrix4x4()
    image.GetImageToWorldMatrix(matrix)
    extent, sizes = image.GetExtent(), image.GetDimensions()
    affine = above @ _array_of(matrix)
    origin = affine[:3] @ [extent[0], extent[2], extent[4], 1.0] * TO_LPS
    values = vtk_to_numpy(image.GetPointData().GetScalars())
    axes = " ".join(f"({','.join(map(repr, axis))})" for axis in (affine[:3, :3].T * TO_LPS).tolist())
    lines = [
        *("NRRD0004", "type: uchar", "dimension: 3", "space: left-posterior-superior"),
        f"sizes: {' '.join(map(str, sizes))}",
        f"space directions: {axes}",
        *("kinds: domain domain domain", "endian: little", "encoding: gzip"),
        f"space origin: ({','.join(map(repr, origin.tolist()))})",
    ]
    data = (values == label).astype(np.uint8).tobytes()
    path.write_bytes(("\n".join(lines) + "\n\n").encode() + gzip.compress(data, 6))
