"""A CARTO 3 study export, found through the study's XML.

Maps, tagged points, imported shells and ablation sites.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import PurePosixPath
from xml.etree import ElementTree

import numpy as np

from ...arrays import Array
from ...case import Points
from ...errors import InputError
from ...geometry.similarity import apply, is_pose
from ..meshes.carto import mesh_file
from ..meshes.dif import parse_xml
from ..meshes.surface_file import SurfaceFile
from ..text import is_count
from .archive import Archive
from .belonging import Anatomy
from .carto_points import read_car, read_sites
from .tags import BETWEEN, has_meaning

CLEARLY_CLOSER = 0.5  # ratio of the median gaps to the points in the two directions
BEGINNING = re.compile(rb"(\xef\xbb\xbf)?\s*(<\?xml[^>]*>\s*)?(?><!--.*?-->\s*)*<Study\b", re.DOTALL)
OF_POINTS = ("_point_export.xml", "_points_export.xml")  # there are thousands, which need not be read


@dataclass(frozen=True)
class Map:
    """A map is one of the study's as its XML describes it; tags: id of a point -> full names of its tags."""

    name: str
    files: tuple[str, ...]
    volume_ml: float | None
    points: int
    tags: dict[int, list[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Study:
    """A study is what its XML says: where it stands, its maps, and other shells.

    The shells come with the vendor's registration (16 numbers as printed).
    """

    archive: Archive
    folder: str
    maps: tuple[Map, ...]
    shells: tuple[tuple[str, tuple[float, ...] | None], ...]

    def map(self, name: str | None) -> Map:
        """Return the map of that name, or the only one with points. Raises InputError listing what there
        is.
        """
        listed = ", ".join(f"{m.name} ({m.points} points)" for m in self.maps)
        found = [m for m in self.maps if (m.name == name if name else m.points > 0)]
        if len(found) != 1:
            what = f"no map '{name}'" if name else f"{len(found)} maps with points; say which with --map"
            raise InputError(f"{self.archive.path}: {what}: there are {listed}")
        return found[0]


def find_study(archive: Archive) -> Study | None:
    """Return the study in an archive; None where no XML of CARTO's is there.

    Raises InputError where there are several.
    """
    found = [
        name
        for name in archive.named(".xml")
        if not name.lower().endswith(OF_POINTS) and BEGINNING.match(archive.read(name)[:4000])
    ]
    if len(found) > 1:
        raise InputError(
            f"{archive.path}: holds {len(found)} studies ({', '.join(found)}); name the folder of one"
        )
    return _read_xml(archive.with_neighbours(), found[0]) if found else None


def _read_xml(archive: Archive, name: str) -> Study:
    where = archive.where(name)
    root = parse_xml(where, _as_utf8(archive.read(name)))
    units = root.find("Units")
    if units is not None and units.get("Distance", "mm") != "mm":
        raise InputError(f"{where}: its distances are in {units.get('Distance')}: must be mm")
    tag_names = {tag.get("ID", ""): _name_tag(tag) for tag in root.iterfind("Maps/TagsTable/Tag")}
    maps = tuple(_read_map(element, tag_names) for element in root.iterfind("Maps/Map"))
    if not maps:
        raise InputError(f"{where}: describes no map")
    return Study(archive, str(PurePosixPath(name).parent), maps, tuple(_list_shells(root)))


def _as_utf8(data: bytes) -> bytes:
    """Return the bytes as UTF-8: CARTO declares no encoding and writes UTF-8 in one version, cp1252 in
    another.
    """
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace").encode()
    return data


def _read_map(element: ElementTree.Element, tag_names: dict[str, str]) -> Map:
    tags: dict[int, list[str]] = {}
    points = element.findall("CartoPoints/Point")
    for point in points:
        ids = " ".join(tag.text or "" for tag in point.iterfind("Tags")).split()
        if ids and is_count(point.get("Id", "")):
            tags[int(point.get("Id", ""))] = [tag_names.get(i, i) for i in ids]
    return Map(
        element.get("Name", ""),
        tuple(re.findall(r"[^;|]+?\.mesh", element.get("FileNames", ""))),
        _number_or_none(element.get("Volume")),
        len(points),
        tags,
    )


def _name_tag(tag: ElementTree.Element) -> str:
    """Return the short name of a tag, or the full one where that alone has a meaning."""
    names = tag.get("Short_Name", ""), tag.get("Full_Name", "")
    return names[1] if has_meaning(names[1]) and not has_meaning(names[0]) else names[0]


def _number_or_none(text: str | None) -> float | None:
    try:
        return float(text or "")
    except ValueError:
        return None


def _list_shells(root: ElementTree.Element) -> Iterator[tuple[str, tuple[float, ...] | None]]:
    """Yield imported shells (CT, MRI) and the vendor's registration of each.

    No public source proves its direction.
    """
    for mesh in root.iterfind(".//Meshes/Mesh"):
        if mesh.get("FileName"):
            numbers = [
                _number_or_none(word)
                for word in (
                    mesh.findtext("RegistrationMatrix") or root.findtext(".//RegistrationMatrix") or ""
                ).split()
            ]
            matrix = tuple(n for n in numbers if n is not None)
            yield mesh.get("FileName", ""), matrix if len(matrix) == 16 else None


def read_shell(study: Study, name: str) -> SurfaceFile:
    """Read a .mesh file of the study by its name in the XML."""
    found = study.archive.find(study.folder, name)
    if found is None:
        raise InputError(f"{study.archive.where(study.folder)}: its XML names {name}, which is not there")
    return mesh_file.read(study.archive.where(found), study.archive.read(found))


def read_map_points(study: Study, wanted: Map) -> Points:
    """Read measured points of a map, all as eam, with their tags as text."""
    name = study.archive.find(study.folder, f"{wanted.name}_car.txt")
    if name is None:
        raise InputError(
            f"{study.archive.where(study.folder)}: holds no {wanted.name}_car.txt; export the map's "
            "points too"
        )
    points, ids = read_car(study.archive.where(name), study.archive.read(name))
    tags = np.array([BETWEEN.join(wanted.tags.get(int(k), [])) for k in ids], dtype=str)
    return replace(points, columns={**points.columns, "tags": tags})


def read_anatomy(study: Study, of: Map) -> Anatomy:
    """Read what another map of the study shows of its chamber, as far as its files are there and in order."""
    shell, points = None, np.zeros((0, 3))
    with suppress(InputError):
        shell = read_shell(study, of.files[0]).surface if of.files else None
    with suppress(InputError):
        points = read_map_points(study, of).xyz
    return Anatomy(points, shell)


def read_ablation(study: Study) -> Points | None:
    """Read VisiTag's sites of the whole study; None where there are none."""
    name = study.archive.find(f"{study.folder}/VisiTagExport", "Sites.txt")
    return None if name is None else read_sites(study.archive.where(name), study.archive.read(name))


def vendor_pose(shell: Array, printed: tuple[float, ...], points: Array) -> Array | None:
    """Return the vendor's registration as a pose (4, 4) of a shell's vertices (n, 3) in the map.

    Rows or columns are told by the zeros. Its direction is not documented: the one that brings the shell to
    the points is taken, None where neither is clearly closer.
    """
    from scipy.spatial import cKDTree

    matrix = np.reshape(np.asarray(printed, dtype=np.float64), (4, 4))
    if matrix[3, :3].any() and not matrix[:3, 3].any():
        matrix = matrix.T
    if not is_pose(matrix, 3):
        return None
    readings = [matrix, np.asarray(np.linalg.inv(matrix), dtype=np.float64)]
    gaps = [float(np.median(cKDTree(apply(reading, shell)).query(points)[0])) for reading in readings]
    best = int(np.argmin(gaps))
    return readings[best] if gaps[best] < CLEARLY_CLOSER * gaps[1 - best] else None
