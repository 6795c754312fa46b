"""One map of a study export, told by content: CARTO 3, EnSite or OpenEP; what was taken and left is said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...case import Points
from ...errors import InputError
from ...quantities import without_impossible
from ..matlab import mat, openep
from ..meshes import dif
from ..meshes.surface_file import SurfaceFile
from . import carto_study, ensite
from .archive import Archive
from .belonging import Anatomy, of_one_map
from .imported import Imported, joined
from .tags import sorted_by_tags

TABLES = (".csv", ".tsv", ".txt", ".xlsx")
VOLUME_TOLERANCE = 2e-4
MAP_SHELLS = ("landmarkgeo", "contact_mapping_model")  # names of shells in EnSite Precision, and in EnSite X


def read_study(study: str | Path, map_name: str | None = None) -> Imported:
    """Read one map of a study, told by content. Raises InputError listing the maps where the name does not
    fit.
    """
    archive = Archive.open(study)
    for files in chain([archive], archive.unpacked()):
        if (found := _find_map(files, map_name)) is not None:
            return _drop_impossible_values(found)
    if Path(study).suffix.lower() in TABLES:
        raise InputError(
            f"{study}: is a table and no study: use o3dls init DIR --prior PRIOR --points {study}"
        )
    raise InputError(
        f"{study}: holds no CARTO 3 study (.xml), no EnSite map (.csv) and no OpenEP data set (.mat)"
    )


def _drop_impossible_values(found: Imported) -> Imported:
    """Return the import without values that cannot be, which nobody mends in a study; its notes say which are
    left out.
    """
    columns, said = without_impossible(found.points.columns, lambda row: f"point {row + 1}")
    found.notes += [f"{found.name}: {note}" for note in (*found.points.notes, *said)]
    found.points = replace(found.points, columns=columns)
    return found


def _find_map(archive: Archive, map_name: str | None) -> Imported | None:
    """Return the map of an archive; None where it holds no study."""
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
    measured = carto_study.read_map_points(study, wanted)
    shell = carto_study.read_shell(study, wanted.files[0]) if wanted.files else None
    points, landmarks, said = sorted_by_tags(measured, shell.surface if shell else None)
    found = Imported(points, landmarks, shell, vendor="CARTO 3", name=wanted.name)
    agrees = (
        ""
        if len(measured) == wanted.points
        else f" (study: {wanted.points} points, which does NOT agree; is the export whole?)"
    )
    found.took.append(f"{len(measured)} points of map {wanted.name} (catheter positions, mm)" + agrees)
    if "ablation" in points.type:
        found.took.append(f"{(points.type == 'ablation').sum()} ablation points, by their tags")
    _say_lines(found, said)
    found.took += [f"landmark {name}" for name in landmarks]
    if shell is not None:
        found.took.append(
            f"shell {wanted.files[0]}, {shell.surface.volume / 1000:.2f} ml" + _volume_check(shell, wanted)
        )
    if (sites := carto_study.read_ablation(study)) is not None:
        others = [carto_study.read_anatomy(study, other) for other in study.maps if other is not wanted]
        count = _take_sites(found, sites, "VisiTag", others)
        found.took.append(f"{count} ablation sites of VisiTag")
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


def _say_lines(found: Imported, said: list[str]) -> None:
    """Say what the tags of the points made of them: taken as another type, or left out."""
    for line in said:
        (found.left if "left out" in line else found.took).append(line)


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
        more, its = read[name]
        both = ensite.by_number(points, more) if its.get("Map name") == preamble.get("Map name") else None
        if both is None and _same_points(points, more):
            both = replace(
                points, columns={**points.columns, **more.columns}, notes=points.notes + more.notes
            )
        if both is None:
            raise InputError(f"{archive.path}: several maps fit; say which file with --map: {listed}")
        points = both
    if len(points) == 0:
        raise InputError(
            f"{archive.where(chosen[0])}: none of its points is utilised; must hold some: there are {listed}"
        )
    # the number was needed to join the files, and is no measured value
    values = {name: column for name, column in points.columns.items() if name != ensite.NUMBER}
    found = Imported(
        replace(points, columns=values),
        vendor=f"EnSite, field scaling {preamble.get('Field Scaling', 'not stated')}",
        name=preamble.get("Map name", "").strip() or Path(chosen[0]).stem,
    )
    found.took.append(f"{len(points)} utilised points of {', '.join(chosen)} (roving electrode, mm)")
    found.left += [name for name in maps if name not in chosen]
    lesions: dict[str, Points] = {}
    for name in archive.named(".csv"):
        base = Path(name).name.lower()
        if base.startswith(("lesions", "automark")):
            lesions[name] = ensite.read_lesions(archive.where(name), archive.read(name))
        elif base.startswith("model_point_cloud"):
            found.left.append(
                f"{name}: positions inside the chamber, "
                f"{len(ensite.read_cloud(archive.where(name), archive.read(name)))} of them"
            )
    _take_dif(archive, found)
    others = [Anatomy(read[name][0].xyz) for name in maps if name not in chosen]
    for name, sites in lesions.items():
        found.took.append(f"{_take_sites(found, sites, name, others)} ablation points of {name}")
    return found


def _take_sites(found: Imported, sites: Points, source: str, others: Sequence[Anatomy]) -> int:
    """Join the ablation sites that lie on this map to its points, and say which do not; gives their
    number.
    """
    own = Anatomy(found.points.of("eam").xyz, found.shell.surface if found.shell else None)
    sites, left = of_one_map(sites, own, others)
    found.points = joined(found.points, sites)
    if left:
        found.left.append(f"{source}: {left}")
    return len(sites)


def _same_points(first: Points, second: Points) -> bool:
    """Return whether two exports are of the same points, and agree in what both say of them."""
    shared = first.columns.keys() & second.columns.keys()
    alike = all(np.array_equal(first.columns[name], second.columns[name], equal_nan=True) for name in shared)
    return np.array_equal(first.xyz, second.xyz) and alike


def _take_dif(archive: Archive, found: Imported) -> None:
    """Take the shell of the map with its labels from the one DIF file that EnSite names so, else from the
    only one; model groups and imported segmentations (difNNN.xml) are others.
    """
    shells = [name for name in archive.named(".xml") if dif.knows(archive.read(name)[:2000])]
    called = ([name for name in shells if sign in Path(name).name.lower()] for sign in MAP_SHELLS)
    named = next((names for names in called if names), shells)
    if len(named) == 1:
        where, data = archive.where(named[0]), archive.read(named[0])
        volumes = {name: dif.read(where, data, part=name) for name in dif.volumes_of(where, data)}
        places = found.points.of("eam").xyz
        nearest = min(volumes, key=lambda name: _typical_gap(places, volumes[name]))
        found.shell = volumes[nearest]
        found.landmarks |= ensite.landmarks_of(found.shell)
        of = f", volume {nearest}, the nearest to the points" if len(volumes) > 1 else ""
        found.took.append(f"shell {named[0]}{of}, {found.shell.surface.volume / 1000:.2f} ml")
        found.left += [f"{named[0]}: volume {name}" for name in volumes if name != nearest]
    found.left += [name for name in shells if name not in named or len(named) > 1]


def _typical_gap(points: Array, shell: SurfaceFile) -> float:
    """Return the median distance of points (n, 3) from the vertices of a shell."""
    from scipy.spatial import cKDTree

    return float(np.median(cKDTree(shell.surface.vertices).query(points)[0]))


def _from_openep(archive: Archive, files: list[str], map_name: str | None) -> Imported:
    chosen = [name for name in files if map_name in (None, Path(name).name, Path(name).stem)]
    if len(chosen) != 1:
        raise InputError(f"{archive.path}: say which data set with --map: there are {', '.join(files)}")
    where, data = archive.where(chosen[0]), archive.read(chosen[0])
    points = openep.read_points(where, data)
    found = Imported(points, vendor="OpenEP", name=Path(chosen[0]).stem)
    if (of := openep.shell_class(where, data)) is None and openep.has_shell(where, data):
        found.shell = openep.read(where, data)
    elif of is None:
        found.left.append("map.ply: the data set has points and no shell (surface.triRep.X)")
    else:
        found.left.append(
            f"the shell: surface.triRep is a MATLAB object of class {of}, which only MATLAB reads; "
            "for map.ply save it there as struct('X', t.X, 'Triangulation', t.Triangulation)"
        )
    found.points, found.landmarks, said = sorted_by_tags(
        points.of("eam"), found.shell.surface if found.shell else None
    )
    _take_sites(found, points.of("ablation"), "rfindex", [])
    kinds = found.points.type
    found.took += [f"{(kinds == kind).sum()} points of type {kind} (mm)" for kind in np.unique(kinds)]
    found.took += [f"landmark {name}" for name in found.landmarks]
    _say_lines(found, said)
    found.left += openep.unread(where, data)
    return found
