"""Scenes of 3D Slicer as bundles (`.mrb`): nodes in MRML, and the files that they are read from, in a zip.

Matrices and fields of nodes are in LPS here; MRML states matrices in RAS, and files state what they are in.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...geometry.similarity import TURN
from ..images.volumes import write_volume
from ..markups import Markups, write_markups
from ..meshes.surface_file import NOTICE
from .displacements import write_vectors

DAY = (1980, 1, 1, 0, 0, 0)  # of every file in a bundle: equal scenes are equal files
GREY = "vtkMRMLColorTableNodeGrey"  # Slicer's own
Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Look:
    """A look says how a model is shown: its colour, or that of a field by a node of colours."""

    colour: Colour = (0.8, 0.8, 0.8)
    opacity: float = 1.0
    field: str | None = None
    colours: str = ""
    limits: tuple[float, float] = (0.0, 1.0)
    points: bool = False


@dataclass(frozen=True)
class Marks:
    """Marks say how places are shown: `many` without their names, and locked, as a mouse would move one."""

    colour: Colour
    many: bool = False
    shown: bool = True


@dataclass(eq=False)
class Scene:
    """A scene has nodes, and a folder with the files that they are read from, which becomes a bundle. Each
    method that adds a node returns its id; `under` is the id of a transform that it hangs under.
    """

    folder: Path
    elements: list[str] = field(default_factory=list)
    nodes: dict[str, dict[str, str]] = field(default_factory=dict)  # by id: what each is, and where it hangs
    _names: dict[str, int] = field(default_factory=dict)

    def add_colours(self, name: str, places: Sequence[tuple[float, Colour]]) -> str:
        """Add colours (red, green, blue, from 0 to 1) at values, linear between them."""
        lines = [f"# {NOTICE}", *(f"{value:g} {' '.join(f'{c:g}' for c in rgb)}" for value, rgb in places)]
        storage = self._store("ProceduralColor", f"{name}.txt", "\n".join(lines) + "\n")
        return self._add("ProceduralColor", name, {"type": "-1"}, {"storage": storage})

    def add_pose(self, name: str, matrix: Array, under: str = "") -> str:
        """Add a matrix (4, 4) in LPS, from what hangs under the node to its parent."""
        rows = "  ".join(" ".join(map(repr, row)) for row in (TURN @ matrix @ TURN).tolist())
        return self._add("LinearTransform", name, {"matrixTransformToParent": rows}, {"transform": under})

    def add_bend(self, name: str, values: NDArray[np.float32], affine: Array, under: str = "") -> str:
        """Add displacements (nx, ny, nz, 3), from the parent of the node to what hangs under it."""
        write_vectors(self._path(f"{name}.nrrd"), values, affine)
        storage = self._store("Transform", f"{name}.nrrd")
        return self._add("GridTransform", name, {}, {"storage": storage, "transform": under})

    def add_model(self, name: str, vtp: bytes, look: Look, under: str = "") -> str:
        """Add a surface or places in a VTP that states its frame."""
        storage = self._store("Model", f"{name}.vtp", vtp)
        shown = {
            "color": " ".join(f"{c:g}" for c in look.colour),
            "opacity": f"{look.opacity:g}",
            "visibility": "true",
            "visibility2D": "true",
            "representation": "0" if look.points else "2",
            "pointSize": "6",
        }
        if look.field is not None:
            shown |= {
                "scalarVisibility": "true",
                "activeScalarName": look.field,
                "activeAttributeLocation": "point",
                "scalarRangeFlag": "UseManual",
                "scalarRange": f"{look.limits[0]:g} {look.limits[1]:g}",
                "colorNodeID": look.colours,
            }
        display = self._add("ModelDisplay", f"{name} display", shown, {})
        return self._add("Model", name, {}, {"display": display, "storage": storage, "transform": under})

    def add_markups(
        self, name: str, marks: Markups, look: Marks, descriptions: Sequence[str] = (), under: str = ""
    ) -> str:
        """Add named places, with what is said of each."""
        write_markups(self._path(f"{name}.mrk.json"), marks, descriptions, locked=look.many)
        storage = self._store("MarkupsJson", f"{name}.mrk.json")
        text = " ".join(f"{c:g}" for c in look.colour)
        shown = {
            "color": text,
            "selectedColor": text,
            "visibility": "true" if look.shown else "false",
            "pointLabelsVisibility": "false" if look.many else "true",
            "glyphScale": "1.5" if look.many else "2",
        }
        display = self._add("MarkupsFiducialDisplay", f"{name} display", shown, {})
        references = {"display": display, "storage": storage, "transform": under}
        return self._add("MarkupsFiducial", name, {}, references)

    def add_volume(self, name: str, values: NDArray[np.generic], affine: Array) -> str:
        """Add an image (nx, ny, nz), whose `affine` (4, 4) takes an index to LPS."""
        write_volume(self._path(f"{name}.nrrd"), values, affine, space="LPS")
        storage = self._store("VolumeArchetype", f"{name}.nrrd")
        shown = {"colorNodeID": GREY, "autoWindowLevel": "1", "visibility": "true"}
        display = self._add("VolumeDisplay", f"{name} display", shown, {}, kind="ScalarVolumeDisplay")
        references = {"display": display, "storage": storage}
        return self._add("Volume", name, {}, references, kind="ScalarVolume")

    def bundle(self, name: str) -> bytes:
        """Return the bundle: one folder with the scene and its data."""
        mrml = '<?xml version="1.0" encoding="UTF-8"?>\n<MRML version="o3dls" userTags="">\n'
        mrml += "".join(self.elements) + "</MRML>\n"
        content = io.BytesIO()
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as file:
            file.writestr(zipfile.ZipInfo(f"{name}/{name}.mrml", DAY), mrml)
            for path in sorted(self.folder.iterdir()):
                info = zipfile.ZipInfo(f"{name}/Data/{path.name}", DAY)
                # fields and images are packed already
                info.compress_type = zipfile.ZIP_STORED if path.suffix == ".nrrd" else zipfile.ZIP_DEFLATED
                file.writestr(info, path.read_bytes())
        return content.getvalue()

    def _path(self, name: str) -> Path:
        return self.folder / name.replace(" ", "_")

    def _store(self, kind: str, name: str, content: str | bytes = b"") -> str:
        """Add the node that reads a file of the bundle, with the content that is not there yet."""
        if content:
            data = content.encode() if isinstance(content, str) else content
            self._path(name).write_bytes(data)
        attributes = {"fileName": f"Data/{self._path(name).name}", "useCompression": "1"}
        if kind == "VolumeArchetype":
            attributes |= {"fileListMember0": attributes["fileName"], "UseOrientationFromFile": "1"}
        return self._add(f"{kind}Storage", f"{name} storage", attributes, {})

    def _add(
        self,
        tag: str,
        name: str,
        attributes: Mapping[str, str],
        references: Mapping[str, str],
        kind: str | None = None,
    ) -> str:
        node_class = f"vtkMRML{kind or tag}Node"
        self._names[node_class] = self._names.get(node_class, 0) + 1
        node = f"{node_class}{self._names[node_class]}"
        refers = "".join(f"{role}:{target};" for role, target in references.items() if target)
        told = {"id": node, "name": name, **attributes} | ({"references": refers} if refers else {})
        self.elements.append(f"<{tag} {' '.join(f'{k}={quoteattr(v)}' for k, v in told.items())}></{tag}>\n")
        if not tag.endswith(("Storage", "Display")):
            self.nodes[node] = {
                "name": name,
                "under": self.nodes.get(references.get("transform", ""), {}).get("name", ""),
            }
        return node
