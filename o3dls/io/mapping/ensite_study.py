"""One map of an EnSite export: the files that are of it, joined, with its shell and its ablation points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np

from ...arrays import Array
from ...case import Points
from ...errors import Doubt, InputError, choices
from ..meshes import dif
from ..meshes.surface_file import SurfaceFile
from . import ensite, ensite_rows
from .archive import Archive
from .belonging import Anatomy, take_sites
from .imported import Imported
from .vendor_columns import columns_of_ensite, columns_of_lesions

MAP_SHELLS = ("landmarkgeo", "contact_mapping_model")  # names of shells in EnSite Precision, and in EnSite X
SIGN = b"roving x"


@dataclass(frozen=True, eq=False)
class MapExport:
    """An export of a map has files, points, and what stands above these."""

    files: tuple[str, ...]
    points: Points
    preamble: Mapping[str, str]

    @property
    def name(self) -> str:
        return self.preamble.get("Map name", "").strip()

    def is_called(self, name: str | None) -> bool:
        """Return whether a name is that of the map, of its file or of its folder."""
        paths = [PurePosixPath(file) for file in self.files]
        called = {self.name, *(n for path in paths for n in (path.name, path.stem, path.parent.name))}
        return name is None or name in called

    def __str__(self) -> str:
        return f"{self.name or '?'} ({', '.join(self.files)}, {len(self.points)} points)"


def map_files(archive: Archive) -> list[str]:
    """Return the tables of measured points in an archive."""
    return [name for name in archive.named(".csv") if _is_map(archive.read(name))]


def _is_map(data: bytes) -> bool:
    return SIGN in data and (ensite.knows(data) or ensite_rows.knows(data))


def read_ensite(archive: Archive, files: list[str], map_name: str | None) -> Imported:
    """Read one map, with its shell and its ablation points where these can be read. Raises InputError where
    the name fits none or several.
    """
    exports, faults = _read_exports(archive, files)
    chosen = [one for one in exports if one.is_called(map_name)]
    named = [error for file, error in faults.items() if map_name in (None, Path(file).name, Path(file).stem)]
    if not chosen and named:
        raise named[0]
    listed = ", ".join(map(str, exports))
    if not chosen:
        raise InputError(f"{archive.path}: no map '{map_name}': there are {listed}")
    points, preamble = _join_exports(archive, chosen, listed), chosen[0].preamble
    if len(points) == 0:
        where = archive.where(chosen[0].files[0])
        raise InputError(f"{where}: none of its points is utilised; must hold some: there are {listed}")
    # the number was needed to join the files, and is no measured value
    values = {name: column for name, column in points.columns.items() if name != ensite.NUMBER}
    found = Imported(
        replace(points, columns=values),
        vendor=f"EnSite, field scaling {preamble.get('Field Scaling', 'not stated')}",
        name=chosen[0].name or Path(chosen[0].files[0]).stem,
    )
    taken = [file for one in chosen for file in one.files]
    found.took.append(f"{len(points)} utilised points of {', '.join(taken)} (roving electrode, mm)")
    for file in taken:
        found.columns |= columns_of_ensite(archive.where(file), archive.read(file))
    found.left += [file for one in exports if one not in chosen for file in one.files]
    found.left += [f"{file}: {error}" for file, error in faults.items()]
    _take_shell(archive, found, {str(PurePosixPath(file).parent) for file in taken})
    _take_rest(archive, found, [Anatomy(one.points.xyz) for one in exports if one not in chosen])
    return found


def _read_exports(archive: Archive, files: list[str]) -> tuple[list[MapExport], dict[str, InputError]]:
    """Return the exports of all maps, and the errors of files that cannot be read."""
    exports: list[MapExport] = []
    faults: dict[str, InputError] = {}
    parts: dict[tuple[str, str], dict[str, ensite_rows.Part]] = {}
    for file in files:
        where, data = archive.where(file), archive.read(file)
        try:
            if ensite_rows.knows(data):
                part = ensite_rows.read_part(where, data)
                parts.setdefault((str(PurePosixPath(file).parent), part.map_name), {})[file] = part
            else:
                exports.append(MapExport((file,), *ensite.read_map(where, data)))
        except InputError as error:
            faults[file] = error
    for (_, name), some in parts.items():
        try:
            points = ensite_rows.join_parts(list(some.values()))
            exports.append(MapExport(tuple(some), points, {"Map name": name}))
        except InputError as error:
            faults |= dict.fromkeys(some, error)
    return exports, faults


def _join_exports(archive: Archive, chosen: list[MapExport], listed: str) -> Points:
    """Return the points of one map, which is exported once per kind of value. Raises InputError where the
    exports are of several.
    """
    points = chosen[0].points
    for one in chosen[1:]:
        both = ensite.by_number(points, one.points) if one.name == chosen[0].name else None
        if both is None and _same_points(points, one.points):
            columns = {**points.columns, **one.points.columns}
            both = replace(points, columns=columns, notes=points.notes + one.points.notes)
        if both is None:
            advice = f"say which file with --map: {listed}"
            names = [one.files[0] for one in chosen]
            raise Doubt(f"{archive.path}: several maps fit", advice, choices("map", names))
        points = both
    return points


def _same_points(first: Points, second: Points) -> bool:
    """Return whether two exports are of the same points, and agree in what both say of them."""
    shared = first.columns.keys() & second.columns.keys()
    alike = all(np.array_equal(first.columns[name], second.columns[name], equal_nan=True) for name in shared)
    return np.array_equal(first.xyz, second.xyz) and alike


def _take_rest(archive: Archive, found: Imported, others: list[Anatomy]) -> None:
    """Take the ablation points that lie on the map, and name the cloud of positions."""
    for name in archive.named(".csv"):
        base = Path(name).name.lower()
        if base.startswith(("lesions", "automark")):
            with found.optional(name):
                where, data = archive.where(name), archive.read(name)
                count = take_sites(found, ensite.read_lesions(where, data), name, others)
                found.took.append(f"{count} ablation points of {name}")
                found.columns |= columns_of_lesions(where, data) if count else {}
        elif base.startswith("model_point_cloud"):
            with found.optional(name):
                count = len(ensite.read_cloud(archive.where(name), archive.read(name)))
                found.left.append(f"{name}: positions inside the chamber, {count} of them")


def _typical_gap(points: Array, shell: SurfaceFile) -> float:
    """Return the median distance of points (n, 3) from the vertices of a shell."""
    from scipy.spatial import cKDTree

    return float(np.median(cKDTree(shell.surface.vertices).query(points)[0]))


def _take_shell(archive: Archive, found: Imported, folders: set[str]) -> None:
    """Take the shell of the map with its labels from the one DIF file that EnSite names so, else from the
    only one, of those beside the map's points where there are any; model groups and imported segmentations
    (difNNN.xml) are others.
    """
    shells = [name for name in archive.named(".xml") if dif.knows(archive.read(name)[:2000])]
    beside = [name for name in shells if str(PurePosixPath(name).parent) in folders] or shells
    called = ([name for name in beside if sign in Path(name).name.lower()] for sign in MAP_SHELLS)
    named = next((names for names in called if names), beside)
    taken = named if len(named) == 1 else []
    for name in taken:
        with found.optional(f"shell {name}"):
            where, data = archive.where(name), archive.read(name)
            volumes = {part: dif.read(where, data, part=part) for part in dif.volumes_of(where, data)}
            places = found.points.of("eam").xyz
            nearest = min(volumes, key=lambda part: _typical_gap(places, volumes[part]))
            found.shell = volumes[nearest]
            found.landmarks |= ensite.landmarks_of(found.shell)
            of = f", volume {nearest}, the nearest to the points" if len(volumes) > 1 else ""
            found.took.append(f"shell {name}{of}, {found.shell.surface.volume / 1000:.2f} ml")
            found.left += [f"{name}: volume {part}" for part in volumes if part != nearest]
    found.left += [name for name in shells if name not in taken]
