"""A study export becomes a case folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Array
from ...case import PRIOR_OF, SPACES, Points
from ...errors import InputError
from ...places import plain_name, seen_from, unique_names
from ...registration.landmark_names import alone, doubts, partners
from ..atomic import check_free, staged_folder, write_file
from ..case_coordinates import in_units
from ..case_settings import toml_lines
from ..grey.image import open_image
from ..manifest import write_manifest
from ..markups import read_places
from ..meshes.repair import closed_outward
from ..points import write_points
from ..surfaces import read_surface, read_surface_file, write_surface
from ..table import write_table
from .carto_study import vendor_pose
from .imported import Imported, joined
from .study import read_study


def import_study(
    study: str | Path,
    map_name: str | None,
    out: str | Path,
    *,
    prior: str | Path | None = None,
    landmarks: str | Path | None = None,
    image: str | Path | None = None,
    prior_of: str | None = None,
    units: str | None = None,
    force: bool = False,
    **choice: Any,
) -> Imported:
    """Make a case folder of one map of a study: points.csv, map.ply (the system's shell with its colours, for
    looking at), and what is given as prior.

    Without a prior, a single closed shell that the system had registered itself is taken, and its
    registration as init.csv, for stage `recorded` to compare with; where there is none, the case is not
    complete.

    Parameters
    ----------
    study : str or Path
        export of CARTO 3 or EnSite, as a folder or zip, or file of OpenEP.
    map_name : str or None
        the map to take; None where the study has one.
    out : str or Path
        case folder to make; lengths in mm, in the frame of the system.
    prior : str or Path, default None
        surface or label volume from an image.
    landmarks : str or Path, default None
        places named on the prior: markups of Slicer, or a table `name,x,y,z`.
    image : str or Path, default None
        grey image that the prior was segmented in, which stays where it is.
    prior_of : {"patient", "template"}, default "patient"
        whose anatomy the prior is.
    units : {"mm", "cm", "m", "um", "in"}, default None
        unit of the prior, where its file does not state one.
    force : bool, default False
        replace an earlier import in the same folder.
    **choice
        of the prior: `cap`, `label`, `part`, `box`, `layer`, `fill_slices`, `form`, `sidecar`, and `frame`
        where it does not state it.

    Returns
    -------
    Imported
        `points` and `landmarks` in the map frame, mm; sentences on what was `took` and `left`.

    Raises
    ------
    InputError
        where the map, the prior or the landmarks cannot be used, or the folder holds something else.

    Examples
    --------
    >>> import o3dls
    >>> found = o3dls.import_study("study", "1-Map", "imported", prior="case/prior.ply")
    >>> list(found.landmarks)  # those that the study names
    ['LSPV']
    """
    given = [
        name for name, value in {"units": units, **choice}.items() if value is not None and value is not False
    ]
    if prior is None and given:
        raise InputError(f"{', '.join(given)}: needs a prior; name one with --prior")
    if prior_of not in (None, *PRIOR_OF):
        raise InputError(f"prior_of = '{prior_of}': must be one of {', '.join(PRIOR_OF)}")
    check_free(out, force, "case", [Path(path) for path in (study, prior, landmarks) if path is not None])
    found = read_study(study, map_name)
    with staged_folder(out, force) as folder:
        _write_map(folder, found)
        space = "unknown"
        if prior is not None:
            space = _write_prior(folder, Path(prior), found, units, choice)
        elif (registered := _registered_shell(found)) is not None:
            space = _write_registered(folder, *registered, found)
        else:
            found.left.append(
                "prior.ply: no prior was given; put the MRI or CT surface there before o3dls run"
            )
        if landmarks is not None:
            names = _write_landmarks(folder, Path(landmarks), found, space)
            _say_partners(found, names)
        elif found.landmarks:
            found.left.append(
                f"landmarks {', '.join(found.landmarks)}: have no partners, as no places on the prior were "
                "given; name them with --landmarks"
            )
        settings = {"name": found.name, "frame": found.space, "prior_of": prior_of or "patient"}
        if image is not None:
            settings["image"] = _check_image(folder, Path(image), Path(out), space, found)
            found.took.append(f"image {image}, which stays where it is")
        settings["notes"] = f"imported from {found.vendor}"
        write_file(folder / "case.toml", toml_lines(settings))
        write_manifest(folder)
    return found


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
    names = _name_shells(found)
    for name, shell in found.shells.items():
        write_surface(folder / f"{names[name]}_shell.ply", shell.surface, space=shell.space)
    for name, matrix in found.registrations.items():
        rows = np.reshape(matrix, (4, 4)).tolist()
        text = "".join(" ".join(map(repr, row)) + "\n" for row in rows)
        write_file(folder / f"{names[name]}_vendor_registration.txt", text)


def _name_shells(found: Imported) -> dict[str, str]:
    """Return the names of the files of shells, without dots, since what stands before one is how a case finds
    its files; where two would be one file, the second gets a number, which is noted.
    """
    wanted = {name: Path(name).stem for name in (*found.shells, *found.registrations)}
    names = unique_names(wanted)
    for name, own in names.items():
        if own != (plain := plain_name(wanted[name])):
            found.notes.append(
                f"{name}: its files begin with {own}, as those of another shell do with {plain}"
            )
    return names


def _registered_shell(found: Imported) -> tuple[str, Array] | None:
    """Return the name and pose of the one imported shell that is closed and whose registration the points
    confirm.
    """
    points = found.points.of("eam").xyz
    poses = {
        name: vendor_pose(found.shells[name].surface.vertices, printed, points)
        for name, printed in found.registrations.items()
        if len(points) and found.shells[name].surface.watertight
    }
    known = [(name, pose) for name, pose in poses.items() if pose is not None]
    return known[0] if len(known) == 1 else None


def _write_registered(folder: Path, name: str, pose: Array, found: Imported) -> str:
    shell = found.shells[name]
    write_surface(folder / "prior.ply", shell.surface, space=shell.space, units="mm")
    write_file(folder / "init.csv", "".join(",".join(map(repr, row)) + "\n" for row in pose.tolist()))
    found.took.append(
        f"prior {name}, registered by the system itself: init.csv, in the direction that brings it to "
        "the points"
    )
    found.left = [line for line in found.left if not line.startswith(f"the vendor's registration of {name}")]
    return shell.space


def _write_prior(
    folder: Path, prior: Path, found: Imported, units: str | None, choice: dict[str, Any]
) -> str:
    """Write the prior, closed and outward, and return its frame."""
    cap = bool(choice.pop("cap", False))
    file = in_units(prior, read_surface_file(prior, units=units, **choice), units)
    space = _settled_frame(prior, file.space, choice.get("frame"))
    surface = closed_outward(file.surface, str(prior), cap=cap)
    write_surface(folder / "prior.ply", surface, space=space, units=file.units)
    found.took.append(
        f"prior {prior.name}, {surface.volume / 1000:.1f} "
        f"ml{'' if file.units == 'mm' else ' if its units are mm'}"
    )
    found.notes += [f"{prior}: {note}" for note in file.notes]
    return space


def _check_image(folder: Path, image: Path, out: Path, space: str, found: Imported) -> str:
    """Return an image's path as seen from the case. Raises InputError where the prior does not lie in it."""
    if not (folder / "prior.ply").is_file():
        raise InputError(f"--image {image}: an image belongs to a prior; name one with --prior")
    vertices = read_surface(folder / "prior.ply").vertices
    if gap := open_image(image, vertices, space).gap(vertices):
        found.notes.append(f"{image}: {gap}")
    return seen_from(image, out)


def _settled_frame(prior: Path, stated: str, given: str | None) -> str:
    """Return the frame that the prior states, else the one that is given. Raises InputError where they
    differ.
    """
    if given not in (*SPACES, None):
        raise InputError(f"frame = '{given}': must be one of {', '.join(SPACES)}")
    if given is not None and stated not in ("unknown", given):
        raise InputError(f"{prior}: states frame {stated}, and {given} was given; omit --frame")
    return stated if given is None else given


def _write_landmarks(folder: Path, path: Path, found: Imported, space: str) -> tuple[str, ...]:
    """Write the places named on the prior, turned into the prior's frame where both frames are known.

    Gives the names.
    """
    marks, units = read_places(path)
    if "unknown" not in (space, marks.space):
        marks = marks.in_space(space)
    columns = {"name": np.array(marks.names), **dict(zip("xyz", marks.xyz.T, strict=True))}
    write_table(folder / "prior_landmarks.csv", columns, {"space": marks.space, **units})
    found.took.append(
        f"{len(marks.names)} landmarks of the prior, in frame "
        f"{marks.space}{'' if units else ' if their units are mm'}"
    )
    return marks.names


def _say_partners(found: Imported, prior: tuple[str, ...]) -> None:
    """Say which names of the map and of the prior are taken for one place, and which have no partner."""
    ours = tuple(found.landmarks)
    pairs = [(ours[i], prior[j]) for i, j in partners(ours, prior).items()]
    found.took += [
        f"landmark {mark} of the map is {name} of the prior" for mark, name in pairs if mark != name
    ]
    for side, names, others in (("map", ours, prior), ("prior", prior, ours)):
        if said := doubts(names, others):
            found.left.append(f"landmarks of the {side}: {said}")
        if left := alone(names, others):
            found.left.append(
                f"landmarks of the {side} without a partner: {', '.join(left)}; there are "
                f"{', '.join(others) or 'none'} on the other side"
            )
