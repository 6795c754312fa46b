"""The scene that o3dls wrote, loaded into one that is open."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any


def load_scene(scene: Any, bundle: Path, folder: Path) -> list[Any]:
    """Add the nodes of a bundle to a scene, and return those that are shown or move others. The files stay in
    `folder`, which must not be there.
    """
    folder.mkdir(parents=True)
    with zipfile.ZipFile(bundle) as packed:
        packed.extractall(folder)
    (mrml,) = folder.glob("*/*.mrml")
    before = {scene.GetNthNode(k).GetID() for k in range(scene.GetNumberOfNodes())}
    url, root = scene.GetURL(), scene.GetRootDirectory()
    try:
        scene.SetURL(str(mrml))
        scene.SetRootDirectory(str(mrml.parent))
        if not scene.Import():
            raise RuntimeError(f"{bundle}: {scene.GetErrorMessage()}")
    finally:
        # what the user saves goes where it went before
        scene.SetURL(url or "")
        scene.SetRootDirectory(root or "")
    nodes = [scene.GetNthNode(k) for k in range(scene.GetNumberOfNodes())]
    return [node for node in nodes if node.GetID() not in before and node.IsA("vtkMRMLTransformableNode")]
