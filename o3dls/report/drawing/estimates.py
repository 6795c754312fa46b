"""Every estimate as the viewer can show it: its surface, and what it makes of the points."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...geometry.surface import Surface
from ..subject import Subject
from ..surfaces.beliefs import BELIEVED, beliefs
from ..surfaces.display import decimated, displayed
from .charts import STYLES
from .fields import Field, known_fields, shown_fields
from .packing import Json, coded, packed

ALL_FACES = 40_000  # shared by the estimates that are not shown at first
FEWEST, MOST = 2_000, 10_000  # faces of one such estimate


def all_surfaces(subject: Subject) -> dict[str, Surface]:
    """Return the surface of every estimate, those not shown at first with fewer faces: the page must stay
    small.
    """
    others = [name for name in subject.results if name not in subject.shown]
    few = int(np.clip(ALL_FACES // max(len(others), 1), FEWEST, MOST))
    return {
        name: subject.surfaces[name] if name in subject.shown else _coarse_surface(subject, name, few)
        for name in subject.results
    }


def _coarse_surface(subject: Subject, name: str, faces: int) -> Surface:
    result = subject.results[name]
    surface = decimated(result.estimate.surface, faces * 3 // 2, faces, like=subject.case.prior)
    return displayed(surface, subject.case, *result.measured("cross_validated"))


def all_fields(subject: Subject, surfaces: Mapping[str, Surface]) -> list[Field]:
    """Return the fields of the estimates shown at first, in the order and with the ranges of the static
    pictures, then those that only others have.
    """
    first = shown_fields(subject)
    keys = {field.key for field in first}
    every = known_fields(list(surfaces.values()), subject.unit)
    return first + [field for field in every if field.key not in keys]


def estimate_data(subject: Subject, name: str, surface: Surface, places: Mapping[str, int]) -> Json:
    """Pack one estimate but for its mesh, with the matrix that brings the packed prior into its own pose."""
    result = subject.results[name]
    matrix = result.estimate.T_map_prior @ np.linalg.inv(subject.last.estimate.T_map_prior)
    ghosts = {
        key: {"mesh": mesh, "matrix": matrix.ravel().tolist() if key == "prior" else None}
        for key, mesh in places.items()
    }
    full, drawn = len(result.estimate.surface.faces), len(surface.faces)
    return {
        "name": name,
        "run": next(k for k, run in enumerate(subject.runs) if run is result.run),
        "ghosts": ghosts,
        "caption": f"{full} faces, {drawn} drawn" if full > drawn else "",
        "colour": f"--s{subject.style(name) % STYLES}",
        "dash": [],
        **_judge_points(subject, name),
    }


def _judge_points(subject: Subject, name: str) -> Json:
    """Pack what an estimate makes of every drawn point: its distance, its belief where it has one, and 1
    where it was taken for an outlier; and the types of points that the estimate was fitted to.
    """
    result = subject.results[name]
    belief = beliefs(result.run, result.key)[result.run.points.type != "landmark"]
    return {
        "residuals": packed(result.point_distances),
        "beliefs": packed(belief),
        "outliers": coded((belief < BELIEVED).astype(np.uint8)),
        "fitted": list(result.fitted),
    }
