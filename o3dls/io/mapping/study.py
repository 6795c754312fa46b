"""A study export becomes a case folder: CARTO 3, EnSite or OpenEP; what was taken and what was left is
said.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Array
from ...case import Points
from ...errors import InputError
from ..atomic import check_free, staged_folder
from ..case_settings import MILLIMETRES, toml_lines
from ..markups import Markups, read_markups
from ..meshes import dif
from ..meshes.registry import read_surface_file, write_surface
from ..meshes.repair import closed_outward
from ..meshes.surface_file import SurfaceFile
from ..points import write_points
from ..table import read_table, write_table
from . import carto_study, ensite, mat, openep
from .archive import Archive

VOLUME_TOLERANCE = 2e-4


@dataclass
class Imported:
    """What a study gives: points with landmarks in the map frame, the system's own shell, and sentences on
    what was taken and left.
    """

    points: Points
    landmarks: dict[str, Array] = field(default_factory=dict)
    shell: SurfaceFile | None = None
    space: str = "unknown"
    vendor: str = ""
    registrations: dict[str, tuple[float, ...]] = field(default_factory=dict)
    shells: dict[str, SurfaceFile] = field(default_factory=dict)
    name: str = "map"
    took: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)


def import_study(
    study: str | Path,
    map_name: str | None,
    out: str | Path,
    *,
    prior: str | Path | None = None,
    landmarks: str | Path | None = None,
    force: bool = False,
    **choice: Any,
) -> Imported:
    """Make a case folder of one map of a study (folder, zip or file); `prior` is a surface or label volume,
    `landmarks` names its places.

    The folder holds points.csv, map.ply (the system's shell with its colours, for looking at) and what was
    given as prior. Without one, a single closed shell that the system had registered itself is the prior, and
    its registration init.csv, for stage `recorded` to compare with; where there is none the case is not
    complete, and the result says so. `choice` is of the prior (cap, label, part, box). Raises InputError.
    """
    given = [name for name, value in choice.items() if value is not None and value is not False]
    if prior is None and given:
        raise InputError(f"{', '.join(given)}: means nothing without a prior; name it with --prior")
    check_free(out, force, "case", [Path(path) for path in (study, prior, landmarks) if path is not None])
    found = read_study(study, map_name)
    with staged_folder(out, force) as folder:
        _write_map(folder, found)
        space = "unknown"
        if prior is not None:
            space = _write_prior(folder, Path(prior), found, choice)
        elif (registered := _registered_shell(found)) is not None:
            space = _write_registered(folder, *registered, found)
        else:
            found.left.append(
                "prior.ply: no prior was given; put the MRI or CT surface there before o3dls run"
            )
        if landmarks is not None:
            _write_landmarks(folder, Path(landmarks), found, space)
        settings = {"name": found.name, "frame": found.space, "notes": f"imported from {found.vendor}"}
        (folder / "case.toml").write_text(toml_lines(settings), encoding="utf-8")
    return found


def read_study(study: str | Path, map_name: str | None = None) -> Imported:
    """One map of a study, told by content. Raises InputError listing the maps where the name does not fit."""
    archive = Archive.open(study)
    for files in chain([archive], archive.unpacked()):
        if (found := _found(files, map_name)) is not None:
            return found
    raise InputError(
        f"{study}: holds no CARTO 3 study (.xml), no EnSite map (.csv) and no OpenEP data set (.mat)"
    )


def _found(archive: Archive, map_name: str | None) -> Imported | None:
    """The map of an archive; None where it holds no study."""
    if (carto := carto_study.find_study(archive)) is not None:
        return _from_carto(carto, map_name)
    maps = [
        name
        for name in archive.named(".csv")
        if ensite.knows(archive.read(name)) and b"roving x" in archive.read(name)
    ]
    if maps:
        return _from_ensite(archive, maps, map_name)
    files = [name for name in archive.named(".mat") if mat.knows(archive.read(name)[:1024])]
    return _from_openep(archive, files, map_name) if files else None


def _from_carto(study: carto_study.Study, map_name: str | None) -> Imported:
    wanted = study.map(map_name)
    points, landmarks = carto_study.read_map_points(study, wanted)
    shell = carto_study.read_shell(study, wanted.files[0]) if wanted.files else None
    found = Imported(points, landmarks, shell, vendor="CARTO 3", name=wanted.name)
    agrees = (
        ""
        if len(points) == wanted.points
        else f" (study: {wanted.points} points, which does NOT agree; is the export whole?)"
    )
    found.took.append(f"{len(points)} points of map {wanted.name} (catheter positions, mm)" + agrees)
    found.took += [f"landmark {name}" for name in landmarks]
    if shell is not None:
        found.took.append(
            f"shell {wanted.files[0]}, {shell.surface.volume / 1000:.2f} ml" + _volume_check(shell, wanted)
        )
    if (sites := carto_study.read_ablation(study)) is not None:
        found.points = joined(found.points, sites)
        found.took.append(f"{len(sites)} ablation sites of VisiTag, of the whole study")
    for name, matrix in study.shells:
        found.shells[name] = carto_study.read_shell(study, name)
        found.took.append(f"imported shell {name}")
        if matrix is not None:
            found.registrations[name] = matrix
            found.left.append(
                f"the vendor's registration of {name} is kept as printed, and not applied: its direction "
                "is not documented"
            )
    found.left += [f"map {m.name} ({m.points} points)" for m in study.maps if m.name != wanted.name]
    found.left.append("electrograms, electrode positions and force curves of single points")
    return found


def _volume_check(shell: SurfaceFile, wanted: carto_study.Map) -> str:
    if not wanted.volume_ml:
        return ""
    agrees = abs(shell.surface.volume / 1000 / wanted.volume_ml - 1) < VOLUME_TOLERANCE
    return f" (study: {wanted.volume_ml:.2f} ml{'' if agrees else ', which does NOT agree'})"


def _from_ensite(archive: Archive, maps: list[str], map_name: str | None) -> Imported:
    read = {name: ensite.read_map(archive.where(name), archive.read(name)) for name in maps}
    listed = ", ".join(
        f"{preamble.get('Map name', '?')} ({name}, {len(points)} points)"
        for name, (points, preamble) in read.items()
    )
    chosen = [
        n
        for n, (_, preamble) in read.items()
        if map_name in (None, preamble.get("Map name"), Path(n).name, Path(n).stem)
    ]
    if not chosen:
        raise InputError(f"{archive.path}: no map '{map_name}': there are {listed}")
    points, preamble = read[chosen[0]]
    for name in chosen[1:]:  # one map is exported once per kind of value
        if not _same_points(points, read[name][0]):
            raise InputError(f"{archive.path}: several maps fit; say which file with --map: {listed}")
        points = Points(points.xyz, points.type, {**points.columns, **read[name][0].columns})
    found = Imported(
        points,
        vendor=f"EnSite, field scaling {preamble.get('Field Scaling', 'not stated')}",
        name=Path(chosen[0]).stem,
    )
    found.took.append(f"{len(points)} utilised points of {', '.join(chosen)} (roving electrode, mm)")
    found.left += [name for name in maps if name not in chosen]
    for name in archive.named(".csv"):
        base = Path(name).name.lower()
        if base.startswith(("lesions", "automark")):
            sites = ensite.read_lesions(archive.where(name), archive.read(name))
            found.points = joined(found.points, sites)
            found.took.append(f"{len(sites)} ablation points of {name}")
        elif base.startswith("model_point_cloud"):
            found.left.append(
                f"{name}: positions inside the chamber, "
                f"{len(ensite.read_cloud(archive.where(name), archive.read(name)))} of them"
            )
    _take_dif(archive, found)
    return found


def _same_points(first: Points, second: Points) -> bool:
    """Whether two exports are of the same points, and agree in what both say of them."""
    shared = first.columns.keys() & second.columns.keys()
    alike = all(np.array_equal(first.columns[name], second.columns[name], equal_nan=True) for name in shared)
    return np.array_equal(first.xyz, second.xyz) and alike


def _take_dif(archive: Archive, found: Imported) -> None:
    """The shell of the map, from the DIF file that EnSite calls so, else from the only one."""
    shells = [name for name in archive.named(".xml") if dif.knows(archive.read(name)[:2000])]
    named = [name for name in shells if "landmarkgeo" in name.lower()] or shells
    if len(named) == 1:
        found.shell = dif.read(archive.where(named[0]), archive.read(named[0]))
        found.landmarks |= ensite.landmarks_of(found.shell)
        found.took.append(f"shell {named[0]}, {found.shell.surface.volume / 1000:.2f} ml")
    found.left += [name for name in shells if name not in named or len(named) > 1]


def _from_openep(archive: Archive, files: list[str], map_name: str | None) -> Imported:
    chosen = [name for name in files if map_name in (None, Path(name).name, Path(name).stem)]
    if len(chosen) != 1:
        raise InputError(f"{archive.path}: say which data set with --map: there are {', '.join(files)}")
    where, data = archive.where(chosen[0]), archive.read(chosen[0])
    points = openep.read_points(where, data)
    found = Imported(points, shell=openep.read(where, data), vendor="OpenEP", name=Path(chosen[0]).stem)
    found.took += [
        f"{(points.type == kind).sum()} points of type {kind} (mm)" for kind in np.unique(points.type)
    ]
    found.left.append("electrograms")
    return found


def joined(first: Points, second: Points) -> Points:
    """Two sets of points as one; a column that only one has is missing (NaN, or empty text) for the other."""

    def column(points: Points, name: str, like: Any) -> Any:
        empty = np.full(len(points), np.nan) if like.dtype.kind == "f" else np.full(len(points), "")
        return points.columns.get(name, empty)

    names = {**second.columns, **first.columns}
    columns = {
        name: np.concatenate([column(first, name, like), column(second, name, like)])
        for name, like in names.items()
    }
    return Points(np.vstack([first.xyz, second.xyz]), np.concatenate([first.type, second.type]), columns)


def _write_map(folder: Path, found: Imported) -> None:
    marks = np.array(list(found.landmarks.values())).reshape(-1, 3)
    named = Points(
        marks, np.full(len(marks), "landmark"), {"name": np.array(list(found.landmarks), dtype=str)}
    )
    write_points(
        folder / "points.csv",
        joined(found.points, named) if len(marks) else found.points,
        space=found.space,
        units="mm",
    )
    if found.shell is not None:
        write_surface(folder / "map.ply", found.shell.surface, space=found.space)
    for name, shell in found.shells.items():
        write_surface(folder / f"{_stem(name)}_shell.ply", shell.surface, space=shell.space)
    for name, matrix in found.registrations.items():
        rows = np.reshape(matrix, (4, 4)).tolist()
        (folder / f"{_stem(name)}_vendor_registration.txt").write_text(
            "".join(" ".join(map(repr, row)) + "\n" for row in rows)
        )


def _stem(name: str) -> str:
    """A file's name without its suffix and other dots: what stands before a dot is how a case finds its
    files.
    """
    return Path(name).stem.replace(".", "_")


def _registered_shell(found: Imported) -> tuple[str, Array] | None:
    """Name and pose of the one imported shell that is closed and whose registration the points confirm."""
    points = found.points.of("eam").xyz
    poses = {
        name: carto_study.vendor_pose(found.shells[name].surface.vertices, printed, points)
        for name, printed in found.registrations.items()
        if len(points) and found.shells[name].surface.watertight
    }
    known = [(name, pose) for name, pose in poses.items() if pose is not None]
    return known[0] if len(known) == 1 else None


def _write_registered(folder: Path, name: str, pose: Array, found: Imported) -> str:
    shell = found.shells[name]
    write_surface(folder / "prior.ply", shell.surface, space=shell.space, units="mm")
    (folder / "init.csv").write_text(
        "".join(",".join(map(repr, row)) + "\n" for row in pose.tolist()), encoding="utf-8"
    )
    found.took.append(
        f"prior {name}, registered by the system itself: init.csv, in the direction that brings it to "
        "the points"
    )
    found.left = [line for line in found.left if not line.startswith(f"the vendor's registration of {name}")]
    return shell.space


def _write_prior(folder: Path, prior: Path, found: Imported, choice: dict[str, Any]) -> str:
    """The prior, closed and outward; gives its frame."""
    cap = bool(choice.pop("cap", False))
    file = read_surface_file(prior, **choice)
    surface = closed_outward(file.surface, str(prior), cap=cap)
    write_surface(folder / "prior.ply", surface, space=file.space, units=file.units)
    found.took.append(
        f"prior {prior.name}, {surface.volume / 1000:.1f} "
        f"ml{'' if file.units == 'mm' else ' if its units are mm'}"
    )
    return file.space


def _write_landmarks(folder: Path, path: Path, found: Imported, space: str) -> None:
    """Places named on the prior, turned into the prior's frame where both frames are known."""
    marks, units = _read_places(path)
    if "unknown" not in (space, marks.space):
        marks = marks.in_space(space)
    columns = {"name": np.array(marks.names), **dict(zip("xyz", marks.xyz.T, strict=True))}
    write_table(folder / "prior_landmarks.csv", columns, {"space": marks.space, **units})
    found.took.append(
        f"{len(marks.names)} landmarks of the prior, in frame "
        f"{marks.space}{'' if units else ' if their units are mm'}"
    )


def _read_places(path: Path) -> tuple[Markups, dict[str, str]]:
    """Slicer markups or a table `name,x,y,z`, in mm where the units are stated, and then a note of that.
    Raises InputError.
    """
    if path.suffix.lower() != ".csv":
        return read_markups(path), {"units": "mm"}
    table = read_table(path, ("name", "x", "y", "z"))
    units = table.notes.get("units", "unknown")
    if units not in (*MILLIMETRES, "unknown"):
        raise InputError(f"{path}: states units '{units}': must be one of {', '.join(MILLIMETRES)}")
    xyz = np.column_stack([table.numbers(axis) for axis in "xyz"]) * MILLIMETRES.get(units, 1.0)
    marks = Markups(tuple(table.columns["name"]), xyz, table.notes.get("space", "unknown"))
    return marks, {} if units == "unknown" else {"units": "mm"}
