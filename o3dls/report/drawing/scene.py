"""The 3D part of the page as data: meshes, fields and points packed into base64, read by static/decode.js."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...arrays import Array
from ...evaluation.electrical import measured_values
from ...evaluation.interpolation import REACH
from ...geometry.surface import Surface
from ..grading.doubts import Doubt
from ..mapping.activation import TIME, with_activation
from ..mapping.advice import shown_advice
from ..mapping.views import orientation
from ..mapping.wall_regions import with_regions
from ..subject import Subject
from ..surfaces.display import decimated
from ..surfaces.occlusion import occlusion
from .caption import made
from .colour_maps import MAPS, colour_table
from .estimates import all_fields, all_surfaces, estimate_data
from .fields import Field, point_field
from .packing import LAST, Json, coded, grid, once, packed

GHOST_FACES = 10_000
GHOST_STYLES: dict[str, Json] = {
    "prior": {"colour": "--s5", "dash": [6, 4]},
    "truth": {"colour": "--ink", "dash": []},
}


def scene(subject: Subject, doubts: Sequence[Doubt] = ()) -> Json:
    """Collect everything that the viewer draws, JSON-ready; doubts: the parts that get a label."""
    surfaces = with_activation(subject, with_regions(subject, all_surfaces(subject)))
    fields = all_fields(subject, surfaces)
    ghosts = _ghost_surfaces(subject)
    shown = [surfaces[name] for name in subject.shown]
    every = [*surfaces.values(), *ghosts.values()]
    low, size = _bounding_box([*(surface.vertices for surface in every), subject.case.points.xyz])
    centre = (shown[-1].vertices.min(axis=0) + shown[-1].vertices.max(axis=0)) / 2
    places = {name: len(surfaces) + k for k, name in enumerate(ghosts)}
    arrays: list[str] = []
    data = {
        "name": subject.case.name,
        "made": made(subject),
        "file": re.sub(r"[^\w.-]+", "_", subject.case.name)[:80] or "case",
        "units": subject.unit,
        "far": REACH,
        "remoteness": _remoteness_field(subject),
        "box": {"low": low.tolist(), "size": size.tolist()},
        "centre": centre.tolist(),
        "radius": float(max(np.linalg.norm(s.vertices - centre, axis=1).max() for s in shown)),
        "maps": {name: coded(np.round(255 * colour_table(name)).astype(np.uint8)) for name in MAPS},
        "fields": [_describe_field(field) for field in fields],
        "meshes": [_pack_mesh(surface, low, size, fields) for surface in every],
        "estimates": [
            {"mesh": k, **estimate_data(subject, name, surface, places)}
            for k, (name, surface) in enumerate(surfaces.items())
        ],
        "panels": [list(surfaces).index(name) for name in subject.shown],
        "ghostStyles": {name: GHOST_STYLES[name] for name in ghosts},
        "points": _pack_points(subject, low, size),
        "landmarks": _list_landmarks(subject),
        "doubts": [{"name": one.label or one.name, "at": one.place.tolist()} for one in doubts],
        "next": _list_next_places(subject),
        **_describe_directions(subject),
    }
    return {**once(data, arrays), "arrays": arrays}


def _bounding_box(parts: Sequence[Array]) -> tuple[Array, Array]:
    """Return the lowest corner (3,) of all points, and how far they reach from there."""
    everything = np.vstack(parts)
    low = everything.min(axis=0)
    return low, np.maximum(np.ptp(everything, axis=0), 1e-6)


def _describe_field(field: Field) -> Json:
    return {
        "key": field.key,
        "label": field.label,
        "unit": field.unit,
        "map": field.colours,
        "range": [field.low, field.high],
        "step": field.step,
        "names": field.names,
    }


def _ghost_surfaces(subject: Subject) -> dict[str, Surface]:
    """Return the prior brought near by the last pose for packing, and the truth where known.

    The prior is in its own frame; each panel moves it.
    """
    truth = subject.case.truth.surface if subject.case.truth else None
    prior = decimated(replace(subject.case.prior, fields={}), 2 * GHOST_FACES, GHOST_FACES)
    ghosts = {"prior": prior.transformed(subject.last.estimate.T_map_prior)}
    if truth is not None:
        ghosts["truth"] = decimated(replace(truth, fields={}), 2 * GHOST_FACES, GHOST_FACES)
    return ghosts


def _pack_points(subject: Subject, low: Array, size: Array) -> Json:
    points = subject.last.drawn_points
    limits = point_field(subject)
    names = list(dict.fromkeys(points.type.tolist()))
    values = {key: packed(points.columns[key]) for key in measured_values(points)}
    if "lat" in values:
        values[TIME] = values["lat"]  # so that points stand out where the map of times does not follow them
    kinds = np.array([names.index(kind) for kind in points.type], dtype=np.uint8)
    return {
        "names": names,
        "kinds": coded(kinds),
        "positions": grid(points.xyz, low, size),
        "range": [limits.low, limits.high],
        "values": values,
        "rows": coded(np.flatnonzero(subject.last.run.points.type != "landmark").astype(np.uint32)),
        "ids": [_write_id(one) for one in points.columns.get("id", np.zeros(0)).tolist()],
    }


def _write_id(name: object) -> str:
    """Write the name of a point as its file has it, empty where it has none: tables hold decimal numbers."""
    if name != name:
        return ""
    return str(int(name)) if isinstance(name, float) and name.is_integer() else str(name)


def _list_landmarks(subject: Subject) -> list[Json]:
    marks = subject.case.points.of("landmark")
    names = marks.columns.get("name", np.full(len(marks), ""))
    return [{"name": str(name), "at": at.tolist()} for name, at in zip(names, marks.xyz, strict=True)]


def _list_next_places(subject: Subject) -> list[Json]:
    """List the numbered places where one more point would tell most."""
    found = shown_advice(subject)
    return [
        {"name": str(k + 1), "at": one.xyz.tolist()} for k, one in enumerate(found.places if found else ())
    ]


def _remoteness_field(subject: Subject) -> str | None:
    key = f"distance_to_nearest_point_{subject.unit}"
    return key if any(key in one.estimate.surface.fields for one in subject.results.values()) else None


def _describe_directions(subject: Subject) -> Json:
    """Describe views, what is up, the patient's axes where known, faces of the cube and sides to cut away."""
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
        "cube": [{"letter": letter, "view": view} for letter, view in seen.faces().items()],
        "cutNames": ["sagittal (x)", "coronal (y)", "axial (z)"] if known else ["x", "y", "z"],
        "cutSigns": [side, -side, 1.0],
    }


def _pack_mesh(surface: Surface, low: Array, size: Array, fields: Sequence[Field]) -> Json:
    wide = len(surface.vertices) > LAST
    return {
        "positions": grid(surface.vertices, low, size),
        "faces": coded(surface.faces.astype(np.uint32 if wide else np.uint16)),
        "wide": wide,
        "occlusion": coded(np.round(255 * occlusion(surface)).astype(np.uint8)),
        "fields": {
            field.key: packed(surface.fields[field.key]) for field in fields if field.key in surface.fields
        },
    }
