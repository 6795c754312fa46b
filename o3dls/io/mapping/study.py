"""One map of a study export, told by content: CARTO 3, EnSite or OpenEP; what was taken and left is said."""

from __future__ import annotations

import shlex
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from ...errors import Doubt, InputError, choices
from ...quantities import without_impossible
from ..matlab import mat, openep
from ..meshes.surface_file import SurfaceFile
from . import carto_study, ensite_study
from .archive import Archive
from .belonging import take_sites
from .imported import Imported
from .tags import sorted_by_tags
from .vendor_columns import columns_of_car, columns_of_openep

TABLES = (".csv", ".tsv", ".txt", ".xlsx")
VOLUME_TOLERANCE = 2e-4


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
            f"{study}: is a table and no study: use o3dls init DIR --prior PRIOR --points "
            f"{shlex.quote(str(study))}"
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
    if maps := ensite_study.map_files(archive):
        return ensite_study.read_ensite(archive, maps, map_name)
    files = [name for name in archive.named(".mat") if mat.knows(archive.read(name)[:1024])]
    return _from_openep(archive, files, map_name) if files else None


def _from_carto(study: carto_study.Study, map_name: str | None) -> Imported:
    wanted = study.map(map_name)
    measured, left = carto_study.read_map_points(study, wanted)
    found = Imported(measured, {}, vendor="CARTO 3", name=wanted.name)
    found.left += left
    found.columns |= {} if left else columns_of_car()
    for file in wanted.files[:1]:
        with found.optional(f"shell {file}"):
            found.shell = shell = carto_study.read_shell(study, file)
            volume = f"{shell.surface.volume / 1000:.2f} ml" + _volume_check(shell, wanted)
            found.took.append(f"shell {file}, {volume}")
    found.points, found.landmarks, said = sorted_by_tags(
        measured, found.shell.surface if found.shell else None
    )
    agrees = (
        ""
        if len(measured) == wanted.points
        else f" (study: {wanted.points} points, which does NOT agree; is the export whole?)"
    )
    found.took.append(f"{len(measured)} points of map {wanted.name} (catheter positions, mm)" + agrees)
    if "ablation" in found.points.type:
        found.took.append(f"{(found.points.type == 'ablation').sum()} ablation points, by their tags")
    _say_lines(found, said)
    found.took += [f"landmark {name}" for name in found.landmarks]
    with found.optional("ablation sites of VisiTag"):
        if (read := carto_study.read_ablation(study)) is not None:
            sites, columns = read
            others = [carto_study.read_anatomy(study, other) for other in study.maps if other is not wanted]
            count = take_sites(found, sites, "VisiTag", others)
            found.took.append(f"{count} ablation sites of VisiTag")
            found.columns |= columns
    for name, matrix in study.shells:
        with found.optional(f"imported shell {name}"):
            found.shells[name] = carto_study.read_shell(study, name)
            found.took.append(f"imported shell {name}")
            if matrix is not None:
                found.registrations[name] = matrix
                found.left.append(
                    f"the vendor's registration of {name} is kept as printed, and not applied: its direction "
                    "is not documented"
                )
    found.left += [f"map {m.name} ({m.points} points)" for m in study.maps if m is not wanted]
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


def _from_openep(archive: Archive, files: list[str], map_name: str | None) -> Imported:
    chosen = [name for name in files if map_name in (None, Path(name).name, Path(name).stem)]
    if len(chosen) != 1:
        advice = f"say which data set with --map: there are {', '.join(files)}"
        raise Doubt(f"{archive.path}: holds {len(files)} data sets", advice, choices("map", files))
    where, data = archive.where(chosen[0]), archive.read(chosen[0])
    points = openep.read_points(where, data)
    found = Imported(points, vendor="OpenEP", name=Path(chosen[0]).stem)
    if (of := openep.shell_class(where, data)) is None and openep.has_shell(where, data):
        with found.optional("the shell"):
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
    take_sites(found, points.of("ablation"), "rfindex", [])
    kinds = found.points.type
    found.took += [f"{(kinds == kind).sum()} points of type {kind} (mm)" for kind in np.unique(kinds)]
    found.took += [f"landmark {name}" for name in found.landmarks]
    _say_lines(found, said)
    found.left += openep.unread(where, data)
    found.columns = columns_of_openep(where, data, points.columns)
    return found
