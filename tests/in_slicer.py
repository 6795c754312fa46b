"""What slicer-core, the libraries of 3D Slicer without its application, makes of our files. A Python of its
own runs it, and it imports nothing of ours:

    python in_slicer.py transform FILE IN.npz OUT.npz
    python in_slicer.py scene FILE.mrb FOLDER OUT.json
    python in_slicer.py case MODULE GIVEN.npz FOLDER
    python in_slicer.py module MODULE GIVEN.npz FOLDER PYTHON
"""

from __future__ import annotations

import json
import sys
import time
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
    local, there, labels, said = [], [], [], []
    for k in range(node.GetNumberOfControlPoints()):
        node.GetNthControlPointPosition(k, place)
        node.GetNthControlPointPositionWorld(k, world)
        local.append(list(place))
        there.append(list(world))
        labels.append(node.GetNthControlPointLabel(k))
        said.append(node.GetNthControlPointDescription(k))
    display = node.GetDisplayNode()
    return {
        "points": local,
        "world": there,
        "labels": labels,
        "said": said,
        "locked": bool(node.GetLocked()),
        "shown": bool(display.GetVisibility()),
        "named": bool(display.GetPointLabelsVisibility()),
    }


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


def scene_of(given: str) -> tuple[Any, dict[str, Any]]:
    """Return a scene with nodes of each kind that the module takes, from arrays in RAS; and these by name."""
    arrays = np.load(given)
    opened = slicer_core.vtkMRMLScene()
    nodes = {
        name: opened.AddNewNodeByClass(f"vtkMRML{kind}Node", name)
        for name, kind in (
            ("shift", "LinearTransform"),
            ("model", "Model"),
            ("segmentation", "Segmentation"),
            ("points", "MarkupsFiducial"),
            ("sites", "MarkupsFiducial"),
            ("on_prior", "MarkupsFiducial"),
            ("on_map", "MarkupsFiducial"),
            ("table", "Table"),
            ("map", "Model"),
        )
    }
    matrix = vtk.vtkMatrix4x4()
    matrix.DeepCopy(arrays["shift"].ravel())
    nodes["shift"].SetMatrixTransformToParent(matrix)
    mesh = mesh_of(arrays["vertices"], arrays["faces"])
    nodes["model"].SetAndObservePolyData(mesh)
    nodes["model"].SetAndObserveTransformNodeID(nodes["shift"].GetID())
    voltage = vtk.vtkDoubleArray()
    voltage.SetName("Bipolar")
    for value in arrays["bipolar"]:
        voltage.InsertNextValue(value)
    shell = mesh_of(arrays["points"], np.zeros((0, 3), dtype=int))
    shell.GetPointData().AddArray(voltage)
    nodes["map"].SetAndObservePolyData(shell)
    add_segment(nodes["segmentation"], arrays["labels"], arrays["affine"])
    for k, (place, bipolar) in enumerate(zip(arrays["points"], arrays["bipolar"], strict=True)):
        row = nodes["points"].AddControlPoint(place.tolist(), f"Point # {k} in 1-LA")
        # as SlicerHeart describes it
        nodes["points"].SetNthControlPointDescription(row, f"Bipolar {bipolar} / Unipolar 2.5 / LAT -10000.0")
    for name in ("sites", "on_prior", "on_map"):
        for k, place in enumerate(arrays[name]):
            nodes[name].AddControlPoint(place.tolist(), f"mark {k}")
    table = nodes["table"].GetTable()
    for name, column in zip("XYZ", arrays["points"].T, strict=True):
        values = vtk.vtkDoubleArray()
        values.SetName(name)
        for value in column:
            values.InsertNextValue(value)
        table.AddColumn(values)
    return opened, nodes


def mesh_of(vertices: np.ndarray, faces: np.ndarray) -> Any:
    points, cells, mesh = vtk.vtkPoints(), vtk.vtkCellArray(), vtk.vtkPolyData()
    points.SetDataTypeToDouble()
    for vertex in vertices.tolist():
        points.InsertNextPoint(vertex)
    for face in faces.tolist():
        cells.InsertNextCell(3, face)
    mesh.SetPoints(points)
    mesh.SetPolys(cells)
    return mesh


def add_segment(node: Any, labels: np.ndarray, affine: np.ndarray) -> None:
    """Add labels (nx, ny, nz) as a segment of the label 2."""
    image, matrix = slicer_core.vtkOrientedImageData(), vtk.vtkMatrix4x4()
    matrix.DeepCopy(affine.ravel())
    image.SetDimensions(*labels.shape)
    image.AllocateScalars(vtk.VTK_UNSIGNED_CHAR, 1)
    vtk_to_numpy(image.GetPointData().GetScalars())[:] = labels.ravel(order="F")
    image.SetImageToWorldMatrix(matrix)
    segment = slicer_core.vtkSegment()
    segment.SetName("LA")
    segment.SetLabelValue(2)
    segment.AddRepresentation("Binary labelmap", image)
    node.GetSegmentation().AddSegment(segment, "LA")


def case(module: str, given: str, folder: str) -> None:
    """Write the cases that the module makes of nodes of each kind."""
    sys.path.insert(0, module)
    from o3dls_slicer.case import Chosen, InputError, write_case

    opened, nodes = scene_of(given)  # nodes know each other as long as their scene is there
    marks = [nodes[name] for name in ("sites", "on_prior", "on_map")]
    out = Path(folder)
    write_case(out / "model", Chosen(nodes["model"], nodes["points"], "", *marks))
    write_case(out / "segment", Chosen(nodes["segmentation"], nodes["table"], "LA"))
    write_case(out / "map", Chosen(nodes["segmentation"], nodes["map"], "LA"))
    said = []
    wrong = (
        Chosen(None, nodes["points"]),
        Chosen(nodes["model"], None),
        Chosen(nodes["segmentation"], nodes["points"], "none"),
        Chosen(nodes["model"], nodes["shift"]),
    )
    for k, chosen in enumerate(wrong):
        try:
            write_case(out / f"wrong{k}", chosen)
        except InputError as error:
            said.append(str(error))
    (out / "said.json").write_text(json.dumps(said))
    assert opened.GetNumberOfNodes() >= len(nodes)


def module(path: str, given: str, folder: str, python: str) -> None:
    """Do all that the panel does: a case of nodes, the run, and its scene beside the nodes."""
    sys.path.insert(0, path)
    from o3dls_slicer.case import Chosen, write_case
    from o3dls_slicer.job import Job, commands, find_python
    from o3dls_slicer.job import scene_of as bundle_of
    from o3dls_slicer.result import load_scene

    opened, nodes = scene_of(given)
    opened.RegisterNodeClass(slicer_core.vtkMRMLMarkupsJsonStorageNode())
    opened.SetURL("/the/users/scene.mrml")
    out = Path(folder)
    marks = [nodes[name] for name in ("sites", "on_prior", "on_map")]
    write_case(out / "case", Chosen(nodes["segmentation"], nodes["points"], "LA", *marks))
    found, version = find_python(python, {"PATH": ""})
    # what Slicer sets for its own Python would break another
    environment = {"PATH": "/usr/bin:/bin", "PYTHONHOME": "/none", "PYTHONPATH": "/none", "HOME": str(out)}
    job = Job(commands(found, out / "case", out / "run"), environment)
    lines = []
    while job.running:
        lines += job.lines()
        time.sleep(0.05)
    lines += job.lines()
    loaded = [] if job.failure else load_scene(opened, bundle_of(out / "run"), out / "scene")
    about = {
        "version": version,
        "lines": lines,
        "failure": job.failure,
        "valid": job.valid,
        "url": opened.GetURL(),
        "loaded": {node.GetName(): describe(node) for node in loaded},
        "kept": nodes["points"].GetNumberOfControlPoints(),
    }
    (out / "about.json").write_text(json.dumps(about))


DOORS = {"transform": transform, "scene": scene, "case": case, "module": module}

if __name__ == "__main__":
    DOORS[sys.argv[1]](*sys.argv[2:])
