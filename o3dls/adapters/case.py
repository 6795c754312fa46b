"""A case out of what people hold in memory, checked as strictly as a case folder is."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, without_masked
from ..case import MILLIMETRES, PRIOR_OF, SPACES, Case, Points
from ..errors import InputError, did_you_mean
from ..geometry.surface import Surface
from ..io.case_coordinates import check_scale, overruled
from ..io.case_reader import FEWEST_POINTS
from ..io.case_surfaces import CHOICE
from ..io.images.labels import Choice
from ..io.mapping.imported import joined
from ..io.meshes.repair import closed_outward
from ..io.meshes.surface_file import SurfaceFile
from ..io.points import scaled
from .keywords import in_keywords, keyword_errors
from .objects import points_of, stated_surface

log = logging.getLogger("o3dls")
Landmarks = Mapping[str, tuple[ArrayLike, ArrayLike]]


class Settings(Choice, total=False):
    """These are the options that `case_of` takes besides a prior, points, landmarks and a pose."""

    name: str
    phases: Sequence[Any]
    units: str | None
    frame: str
    prior_of: str
    cap: bool


def case_of(
    prior: Any,
    points: Any,
    *,
    name: str = "memory",
    landmarks: Landmarks | None = None,
    init: ArrayLike | None = None,
    phases: Sequence[Any] = (),
    units: str | None = None,
    frame: str = "unknown",
    prior_of: str = "patient",
    cap: bool = False,
    **choice: Unpack[Choice],
) -> Case:
    """Make a case of objects of other libraries, checked as strictly as a case folder is.

    Parameters
    ----------
    prior : mesh, arrays (vertices, faces), or label volume
        what `surface_of` takes, in its own frame.
    points : point cloud, array (n, 3), or columns by name
        what `points_of` takes, in the map frame.
    name : str, default "memory"
        name of the case.
    landmarks : mapping of str to (array (3,), array (3,)), default none
        name -> (position on the prior, position among the points).
    init : array (4, 4), default None
        rough pose, prior to points.
    phases : sequence of meshes, default none
        further surfaces of the prior.
    units : {"mm", "cm", "m", "um", "in", "px"}, default mm, if that can be meant
        unit of all lengths, but for label volumes, which state it.
    frame : {"LPS", "RAS", "unknown"}, default "unknown"
        of all coordinates, into which label volumes are turned; unknown: these stay in LPS.
    prior_of : {"patient", "template"}, default "patient"
        whose anatomy the prior is; a template is another person's or a mean anatomy.
    cap : bool, default False
        close the openings of the prior.
    **choice
        `label`, `part`, `box`, `layer`, `fill_slices` of a label volume, `form` of a NIfTI.

    Returns
    -------
    Case
        with lengths in mm, or px.

    Raises
    ------
    InputError
        for what cannot be used.

    Examples
    --------
    >>> import o3dls
    >>> prior, points = o3dls.read_surface("case/prior.ply"), o3dls.read_points("case/points.csv")
    >>> case = o3dls.case_of((prior.vertices / 10, prior.faces), points.xyz / 10, units="cm")
    >>> case.units, round(case.prior.volume / prior.volume, 6)
    ('mm', 1.0)
    """
    known = [*CHOICE, *(case_of.__kwdefaults__ or {})]
    if unknown := sorted(choice.keys() - known):
        raise InputError(f"no setting '{unknown[0]}' of a case{did_you_mean(unknown[0], known)}")
    stated = (("units", units, MILLIMETRES), ("frame", frame, SPACES), ("prior_of", prior_of, PRIOR_OF))
    for key, value, allowed in stated:
        if value is not None and value not in allowed:
            raise InputError(f"{key} = '{value}': must be one of {', '.join(allowed)}")
    factor = MILLIMETRES[units or "mm"]
    file = stated_surface(prior, "prior", frame=frame, **choice)
    surface = _surface_in_mm(file, "prior", units)
    pose = None if init is None else without_masked(init).astype(np.float64)
    if pose is not None and pose.ndim == 2:
        pose[:-1, -1] *= factor
    with keyword_errors():
        prior = closed_outward(surface, "prior", cap=cap)
    return Case(
        name=name,
        prior=prior,
        points=_points_in_mm(points, landmarks or {}, units),
        prior_landmarks={
            str(name): _check_place(name, "on the prior", at, surface.dimension) * factor
            for name, (at, _) in (landmarks or {}).items()
        },
        init=pose,
        units="px" if units == "px" else "mm",
        frame=frame,
        prior_frame=frame if file.space == "unknown" else file.space,
        prior_file_units=units if file.units == "unknown" else None,
        prior_of=prior_of,
        phases=tuple(
            _surface_in_mm(stated_surface(phase, f"phase {k}", frame=frame), f"phase {k}", units)
            for k, phase in enumerate(phases, 1)
        ),
    )


def _surface_in_mm(file: SurfaceFile, where: str, units: str | None) -> Surface:
    """Return the surface in mm; what of the object is not in it goes to the log.

    Raises InputError where nobody says the units, and mm cannot be meant.
    """
    with keyword_errors():
        file = overruled(where, file, units)
        if units is None and file.units != "mm" and file.surface.dimension == 3:
            check_scale(where, file.surface.vertices)
    for note in file.notes:
        log.info("%s: %s", where, in_keywords(note))
    if file.units == "mm":
        return file.surface
    return file.surface.with_vertices(file.surface.vertices * MILLIMETRES[units or "mm"])


def _points_in_mm(thing: Any, landmarks: Landmarks, units: str | None) -> Points:
    """Return the points in mm, and behind them the landmarks."""
    points = points_of(thing)
    for note in points.notes:
        log.info("points: %s", note)
    if not len(points):
        raise InputError(
            "points: the cloud has none; Open3D gives such a cloud where it could not read a file"
        )
    fitted = int((points.type == "eam").sum())
    if fitted < FEWEST_POINTS:
        raise InputError(
            f"points: {fitted} points of type eam: at least {FEWEST_POINTS} are needed to fit a surface"
        )
    if units is None and points.xyz.shape[1] == 3:
        with keyword_errors():
            check_scale("points", points.xyz, np.inf)  # a few points may lie close together
    if landmarks:
        places = [
            _check_place(name, "among the points", at, points.xyz.shape[1])
            for name, (_, at) in landmarks.items()
        ]
        names = {"name": np.array([str(name) for name in landmarks])}
        points = joined(points, Points(np.array(places), np.full(len(places), "landmark"), names))
    return scaled(points, MILLIMETRES[units or "mm"])


def _check_place(name: str, where: str, at: ArrayLike, dimension: int) -> Array:
    place = without_masked(at).astype(np.float64)
    if place.shape != (dimension,) or not np.isfinite(place).all():
        raise InputError(
            f"landmarks: the position of '{name}' {where} is {at!r}: must be {dimension} finite numbers"
        )
    return place
