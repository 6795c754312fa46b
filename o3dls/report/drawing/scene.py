"""The 3D part of the page as data: meshes, fields and points packed into base64, read by static/decode.js."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...arrays import Array
from ...evaluation.electrical import measured_values
from ...evaluation.interpolation import REACH
from ...geometry.surface import Surface
from ..mapping.advice import shown_advice
from ..mapping.wall_regions import with_regions
from ..subject import Subject
from .caption import made
from .charts import STYLES
from .display import MOST_FACES, decimated
from .fields import MAPS, Field, colour_table, known_fields, point_field
from .views import orientation

GHOST_FACES = 10_000
BELIEVED = 0.5  # weights below mark a point as outlier
LAST = 65535
Json = dict[str, Any]
GHOST_STYLES: dict[str, Json] = {
    "prior": {"colour": "--s5", "dash": [6, 4]},
    "truth": {"colour": "--ink", "dash": []},
}


def scene(subject: Subject) -> Json:
    """Everything that the viewer draws, JSON-ready."""
    surfaces = list(with_regions(subject, subject.surfaces).values())
    fields = known_fields(surfaces, subject.unit)
    ghosts = _ghosts(subject)
    everything = np.vstack([*(s.vertices for s in [*surfaces, *ghosts.values()]), subject.case.points.xyz])
    low = everything.min(axis=0)
    size = np.maximum(np.ptp(everything, axis=0), 1e-6)
    centre = (surfaces[-1].vertices.min(axis=0) + surfaces[-1].vertices.max(axis=0)) / 2
    meshes = [_mesh(surface, low, size, fields) for surface in [*surfaces, *ghosts.values()]]
    places = {name: len(surfaces) + k for k, name in enumerate(ghosts)}
    return {
        "name": subject.case.name,
        "made": made(subject),
        "file": re.sub(r"[^\w.-]+", "_", subject.case.name)[:80] or "case",
        "units": subject.unit,
        "far": REACH,
        "remoteness": _remoteness(subject),
        "box": {"low": low.tolist(), "size": size.tolist()},
        "centre": centre.tolist(),
        "radius": float(max(np.linalg.norm(s.vertices - centre, axis=1).max() for s in surfaces)),
        "maps": {name: _text(np.round(255 * colour_table(name)).astype(np.uint8)) for name in MAPS},
        "fields": [_described(field) for field in fields],
        "meshes": meshes,
        "panels": [_panel(subject, k, name, places) for k, name in enumerate(subject.shown)],
        "ghostStyles": {name: GHOST_STYLES[name] for name in ghosts},
        "points": _points(subject, low, size),
        "landmarks": _landmarks(subject),
        "next": _next(subject),
        **_directions(subject),
    }


def _described(field: Field) -> Json:
    return {
        "key": field.key,
        "label": field.label,
        "unit": field.unit,
        "map": field.colours,
        "range": [field.low, field.high],
        "step": field.step,
        "names": field.names,
    }


def _ghosts(subject: Subject) -> dict[str, Surface]:
    """The prior brought near by the last pose for packing, and the truth where known.

    The prior is in its own frame; each panel moves it.
    """
    truth = subject.case.truth.surface if subject.case.truth else None
    prior = decimated(replace(subject.case.prior, fields={}), 2 * GHOST_FACES, GHOST_FACES)
    ghosts = {"prior": prior.transformed(subject.last.estimate.T_map_prior)}
    if truth is not None:
        ghosts["truth"] = decimated(replace(truth, fields={}), 2 * GHOST_FACES, GHOST_FACES)
    return ghosts


def _panel(subject: Subject, index: int, name: str, places: dict[str, int]) -> Json:
    """One picture: its mesh, and its ghosts with the matrix that brings the packed prior to its place.

    That place is this estimate's own pose.
    """
    result = subject.results[name]
    matrix = result.estimate.T_map_prior @ np.linalg.inv(subject.last.estimate.T_map_prior)
    ghosts = {
        key: {"mesh": mesh, "matrix": matrix.ravel().tolist() if key == "prior" else None}
        for key, mesh in places.items()
    }
    full = len(result.estimate.surface.faces)
    caption = f"{full} faces, {len(subject.surfaces[name].faces)} drawn" if full > MOST_FACES else ""
    style: Json = {"colour": f"--s{subject.style(name) % STYLES}", "dash": []}
    return {
        "name": name,
        "mesh": index,
        "ghosts": ghosts,
        "caption": caption,
        **style,
        **_judged(subject, name),
    }


def _judged(subject: Subject, name: str) -> Json:
    """Distance of every point to the estimate, and 1 where the estimate took it for an outlier."""
    marks = outliers(subject, name)[subject.case.points.type != "landmark"]
    return {
        "residuals": _packed(subject.results[name].point_distances),
        "outliers": _text(marks.astype(np.uint8)),
    }


def outliers(subject: Subject, name: str) -> Array:
    """True (n,) where a point of the case was fitted but hardly believed."""
    result = subject.results[name]
    weights = result.estimate.weights
    kinds = result.run.points.type
    marks = np.zeros(len(kinds), dtype=bool)
    for fitted in (("eam",), ("eam", "inside")):
        rows = np.flatnonzero(np.isin(kinds, fitted))
        if weights is not None and len(weights) == len(rows):
            marks[rows[weights < BELIEVED]] = True
            return marks
    return marks


def _points(subject: Subject, low: Array, size: Array) -> Json:
    points = subject.last.drawn_points
    limits = point_field(subject)
    names = list(dict.fromkeys(points.type.tolist()))
    kinds = np.array([names.index(kind) for kind in points.type], dtype=np.uint8)
    return {
        "names": names,
        "kinds": _text(kinds),
        "positions": _grid(points.xyz, low, size),
        "range": [limits.low, limits.high],
        "values": {key: _packed(points.columns[key]) for key in measured_values(points)},
    }


def _landmarks(subject: Subject) -> list[Json]:
    marks = subject.case.points.of("landmark")
    names = marks.columns.get("name", np.full(len(marks), ""))
    return [{"name": str(name), "at": at.tolist()} for name, at in zip(names, marks.xyz, strict=True)]


def _next(subject: Subject) -> list[Json]:
    """Numbered places where one more point would tell most."""
    found = shown_advice(subject)
    return [
        {"name": str(k + 1), "at": one.xyz.tolist()} for k, one in enumerate(found.places if found else ())
    ]


def _remoteness(subject: Subject) -> str | None:
    key = f"distance_to_nearest_point_{subject.unit}"
    return (
        key if any(key in subject.results[name].estimate.surface.fields for name in subject.shown) else None
    )


def _directions(subject: Subject) -> Json:
    """Views, what is up, the patient's axes where known, letters of the axes and sides to cut away."""
    frame = subject.case.frame
    known = frame != "unknown"
    side = -1.0 if frame == "RAS" else 1.0
    seen = orientation(subject)
    patient = {"left": seen.left.tolist(), "front": seen.front.tolist(), "up": seen.up.tolist()}
    return {
        "views": [{"name": name, "from": at.tolist()} for name, at in seen.views().items()],
        "viewsBy": seen.known_by,
        "up": seen.up.tolist(),
        "patient": patient if seen.patient else None,
        "axes": list(frame) if known else ["x", "y", "z"],
        "cutNames": ["sagittal (x)", "coronal (y)", "axial (z)"] if known else ["x", "y", "z"],
        "cutSigns": [side, -side, 1.0],
    }


def _mesh(surface: Surface, low: Array, size: Array, fields: Sequence[Field]) -> Json:
    wide = len(surface.vertices) > LAST
    return {
        "positions": _grid(surface.vertices, low, size),
        "faces": _text(surface.faces.astype(np.uint32 if wide else np.uint16)),
        "wide": wide,
        "fields": {
            field.key: _packed(surface.fields[field.key]) for field in fields if field.key in surface.fields
        },
    }


def _grid(points: Array, low: Array, size: Array) -> str:
    return _text(np.round((points - low) / size * LAST).astype(np.uint16))


def _packed(values: Array) -> Json:
    """Numbers in 16 bits with their ends; the largest code stands for a missing value."""
    known = np.isfinite(values)
    low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 1.0)
    high = high if high > low else low + 1.0
    codes = np.full(len(values), LAST, dtype=np.uint16)
    codes[known] = np.round((values[known] - low) / (high - low) * (LAST - 1)).astype(np.uint16)
    return {"data": _text(codes), "low": low, "high": high}


def _text(array: Any) -> str:
    """Little-endian bytes as base64."""
    return base64.b64encode(
        np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")).tobytes()
    ).decode("ascii")
