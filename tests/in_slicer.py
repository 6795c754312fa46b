"""What slicer-core, the libraries of 3D Slicer without its application, makes of our files. A Python of its
own runs it, and it imports nothing of ours:

    python in_slicer.py transform FILE IN.npz OUT.npz
    python in_slicer.py scene FILE.mrb FOLDER OUT.json
"""

from __future__ import annotations

import json
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import slicer_core
import vtk
from vtk.util.numpy_support import vtk_to_numpy


def transform(file: str, given: str, out: str) -> None:
    """Move points (RAS) by a transform file, from its node's frame to the world and back."""
    scene = slicer_core.vtkMRMLScene()
    storage, node = slicer_core.vtkMRMLTransformStorageNode(), slicer_core.vtkMRMLTransformNode()
    storage.SetFileName(file)
    scene.AddNode(storage)
    scene.AddNode(node)
    assert storage.ReadData(node), file
    with np.load(given) as points:
        np.savez(
            out,
            to_world=moved(node.GetTransformToWorld, points["points"]),
            from_world=moved(node.GetTransformFromWorld, points["points"]),
        )


def moved(fill: Any, points: np.ndarray) -> np.ndarray:
    whole = vtk.vtkGeneralTransform()
    fill(whole)
    return np.array([whole.TransformPoint(point) for point in points])


def scene(file: str, folder: str, out: str) -> None:
    """Open a bundle, and say what each of its nodes is; places are in the world's RAS."""
    with zipfile.ZipFile(file) as bundle:
        bundle.extractall(folder)
    (mrml,) = Path(folder).glob("*/*.mrml")
    opened = slicer_core.vtkMRMLScene()
    opened.RegisterNodeClass(slicer_core.vtkMRMLMarkupsJsonStorageNode())  # as the application does
    opened.SetURL(str(mrml))
    opened.SetRootDirectory(str(mrml.parent))
    assert opened.Import(), opened.GetErrorMessage()
    found = {}
    for k in range(opened.GetNumberOfNodes()):
        node = opened.GetNthNode(k)
        found[node.GetID()] = describe(node)
    Path(out).write_text(json.dumps(found))


def describe(node: Any) -> dict[str, Any]:
    about: dict[str, Any] = {"class": node.GetClassName(), "name": node.GetName()}
    if node.IsA("vtkMRMLTransformableNode"):
        parent = node.GetParentTransformNode()
        about["parent"] = parent and parent.GetName()
    about |= next((of(node) for kind, of in KINDS.items() if node.IsA(kind)), {})
    return about


def of_model(node: Any) -> dict[str, Any]:
    mesh = node.GetMesh()
    data = mesh.GetPointData()
    arrays = {
        data.GetArrayName(k): vtk_to_numpy(data.GetArray(k)).tolist() for k in range(data.GetNumberOfArrays())
    }
    points = vtk_to_numpy(mesh.GetPoints().GetData())
    display = node.GetDisplayNode()
    return {
        "points": points.tolist(),
        "world": moved(node_to_world(node), points[::50]).tolist(),
        "cells": mesh.GetNumberOfCells(),
        "arrays": arrays,
        "scalar": display and display.GetActiveScalarName(),
        "shown": display and bool(display.GetScalarVisibility()),
        "range": display and list(display.GetScalarRange()),
        "colours": display and display.GetColorNode() and display.GetColorNode().GetName(),
    }


def node_to_world(node: Any) -> Any:
    def fill(whole: Any) -> None:
        parent = node.GetParentTransformNode()
        if parent:
            parent.GetTransformToWorld(whole)

    return fill


def of_markups(node: Any) -> dict[str, Any]:
    place, world = [0.0] * 3, [0.0] * 3
    local, there, labels = [], [], []
    for k in range(node.GetNumberOfControlPoints()):
        node.GetNthControlPointPosition(k, place)
        node.GetNthControlPointPositionWorld(k, world)
        local.append(list(place))
        there.append(list(world))
        labels.append(node.GetNthControlPointLabel(k))
    return {"points": local, "world": there, "labels": labels}


def of_volume(node: Any) -> dict[str, Any]:
    matrix = vtk.vtkMatrix4x4()
    node.GetIJKToRASMatrix(matrix)
    image = node.GetImageData()
    values = vtk_to_numpy(image.GetPointData().GetScalars())
    return {
        "affine": entries_of(matrix),
        "shape": list(image.GetDimensions()),
        "sum": float(values.sum()),
        "largest": float(values.max()),
    }


def of_transform(node: Any) -> dict[str, Any]:
    if not node.IsLinear():
        return {"linear": False}
    matrix = vtk.vtkMatrix4x4()
    node.GetMatrixTransformToParent(matrix)
    return {"linear": True, "matrix": entries_of(matrix)}


def entries_of(matrix: Any) -> list[list[float]]:
    return [[matrix.GetElement(i, j) for j in range(4)] for i in range(4)]


def of_colours(node: Any) -> dict[str, Any]:
    colour, entries = [0.0] * 4, []
    if node.IsA("vtkMRMLProceduralColorNode"):
        function = node.GetColorTransferFunction()
        row = [0.0] * 6
        for k in range(function.GetSize()):
            function.GetNodeValue(k, row)
            entries.append(list(row[:4]))
    else:
        for k in range(node.GetNumberOfColors()):
            node.GetColor(k, colour)
            entries.append([node.GetColorName(k), *colour])
    return {"entries": entries}


KINDS = {
    "vtkMRMLModelNode": of_model,
    "vtkMRMLMarkupsNode": of_markups,
    "vtkMRMLScalarVolumeNode": of_volume,
    "vtkMRMLTransformNode": of_transform,
    "vtkMRMLColorNode": of_colours,
}

if __name__ == "__main__":
    {"transform": transform, "scene": scene}[sys.argv[1]](*sys.argv[2:])
