"""The surface of a session as its pages draw it: the prior with few faces, in the viewer of the report."""

from __future__ import annotations

import secrets
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import TINY, Array, Ints
from ..case import Case, Points
from ..errors import InputError
from ..estimate import Estimate
from ..evaluation.distances import moved
from ..evaluation.interpolation import REACH
from ..geometry.closest_point import ClosestPoint
from ..geometry.surface import Surface
from ..registration.landmark_names import partners
from ..report.drawing.packing import grid, packed
from ..report.drawing.scene import scene
from ..report.subject import Result, Subject
from ..report.surfaces.display import decimated
from ..runs.run import Run
from ..runs.scoring import provenance

FACES = 10_000
MOST_FACES = 12_000  # a prior with more is drawn with FACES; to import what reduces it takes seconds
NAME = "the surface now"
TYPES = ("eam", "ablation", "inside", "outlier")  # of points that pages show
NEAR = 5.0  # mm: the end of the colours of points; it stays, so that a colour means one thing all session
Event = dict[str, Any]


class Display:
    """A display turns the estimates of one prior into what pages see: events `scene` and `surface`, the faces
    chosen once.

    Estimates must be the prior's own faces moved, as those of `deform` are; None is the prior in its own
    frame, before anything has brought it to the map.
    """

    def __init__(self, prior: Surface) -> None:
        bare = replace(prior, fields={})
        self.prior = decimated(bare, MOST_FACES, FACES)
        self.identity = secrets.token_hex(4)  # changes with the scene: events `surface` name it
        self._bare = bare

    def scene(self, case: Case, estimate: Estimate | None) -> Event:
        """Make the event that starts the picture: all that the report's viewer reads, no points, and `prior`,
        the same vertices in the prior's frame, by which a click becomes a landmark there.
        """
        self.identity = secrets.token_hex(4)
        shown = self._shown_estimate(case, estimate)
        drawn = replace(case, prior=self.prior)
        if estimate is None:  # the map's points have no place in the prior's frame
            drawn = replace(drawn, points=case.points.of(), frame=case.prior_frame)
        data = scene(subject_of(drawn, replace(shown, motion=None)))
        ranges = {f"distance_to_nearest_point_{case.units}": [0.0, 2 * REACH]}
        for field in data["fields"]:
            field["range"] = ranges.get(field["key"], field["range"])
        data["meshes"], data["ghostStyles"] = data["meshes"][:1], {}  # the prior's ghost would stay behind
        data["estimates"][0]["ghosts"] = {}
        data["points"] |= {"names": list(TYPES), "range": [0.0, NEAR]}
        low, size = _bounding_box(self.prior.vertices)
        data["prior"] = {"box": _write_box(low, size), "positions": grid(self.prior.vertices, low, size)}
        marks = landmarks(case, estimate)
        content = {"scene": data, "posed": estimate is not None, "landmarks": marks}
        return {"event": "scene", "id": self.identity, **content}

    def surface(self, case: Case, estimate: Estimate, after: int) -> Event:
        """Make the event that moves the picture: positions and fields of the same vertices, after the point
        `after` was put in.
        """
        surface = self._shown_estimate(case, estimate).surface
        low, size = _bounding_box(surface.vertices)
        return {
            "event": "surface",
            "of": self.identity,
            "after": after,
            "box": _write_box(low, size),
            "positions": grid(surface.vertices, low, size),
            "fields": {key: packed(values) for key, values in surface.fields.items()},
            "landmarks": landmarks(case, estimate),
        }

    def _shown_estimate(self, case: Case, estimate: Estimate | None) -> Estimate:
        """Return the estimate with the display's faces and fields; the prior's own where there is none."""
        if estimate is None:
            return Estimate(self.prior, np.eye(4), "no pose yet")
        if not np.array_equal(estimate.surface.faces, self._bare.faces):
            raise InputError("live: the estimate has other faces than the prior, so it cannot be its motion")
        surface = self.prior.with_vertices(self._carry_values(estimate.surface.vertices))
        fields = {
            f"distance_to_nearest_point_{case.units}": _nearest_distances(case.points.of("eam"), surface)
        }
        key = f"sd_{case.units}"
        if key in estimate.surface.fields:
            fields = {key: self._carry_values(estimate.surface.fields[key]), **fields}
        return replace(estimate, surface=replace(surface, fields=fields), weights=None)

    def _carry_values(self, values: Array) -> Array:
        """Carry values (n, ...) of the prior's vertices to those of the display."""
        corners, weights = self._places
        return np.asarray(np.einsum("nk,nk...->n...", weights, values[corners]))

    @cached_property
    def _places(self) -> tuple[Ints, Array]:
        """Where the display's vertices lie on the prior: among which of its vertices (n, 3), with which
        weights (n, 3). The first picture needs none of it, and comes before its compiled loops are there.
        """
        _, face, _, weights = ClosestPoint(self._bare.vertices, self._bare.faces).query(self.prior.vertices)
        return self._bare.faces[face], weights


def landmarks(case: Case, estimate: Estimate | None) -> list[Event]:
    """List every landmark by name, with the sides that have it and `at`, where it stands in the picture: as
    marked in the map, else where the prior's lies now. One that only the map has stands nowhere before the
    pose.
    """
    marks = case.points.of("landmark")
    names = [str(name) for name in marks.columns.get("name", ())]
    pairs = partners(list(case.prior_landmarks), names)
    here = np.array(list(case.prior_landmarks.values())).reshape(-1, 3)
    there = here if estimate is None else moved(estimate, here) if len(here) else here
    found = [
        {"name": name, "prior": True, "map": k in pairs, "at": there[k].tolist()}
        for k, name in enumerate(case.prior_landmarks)
    ]
    if estimate is not None:
        for k, row in pairs.items():
            found[k]["at"] = marks.xyz[row].tolist()
    alone = [k for k in range(len(names)) if k not in pairs.values()]
    at = [None if estimate is None else marks.xyz[k].tolist() for k in alone]
    more = [
        {"name": names[k], "prior": False, "map": True, "at": one} for k, one in zip(alone, at, strict=True)
    ]
    return [*found, *more]


def _nearest_distances(points: Points, surface: Surface) -> Array:
    """Return the distance of each vertex (n,) to the nearest point; NaN where there are no points."""
    from scipy.spatial import cKDTree

    if not len(points):
        return np.full(len(surface.vertices), np.nan)
    return np.asarray(cKDTree(points.xyz).query(surface.vertices)[0])


def subject_of(case: Case, estimate: Estimate) -> Subject:
    """Make what the report's drawing reads of a run: this one estimate, and of the points the landmarks."""
    points = case.points.of("landmark")
    distances = {f"distance_{NAME}_{case.units}": np.zeros(len(points))}
    run = Run(
        replace(case, points=points, truth=None),
        {NAME: estimate},
        fitted={NAME: ("eam",)},
        scores={NAME: {"ablation": {}}},  # so that `fitted` is the eam points alone
        validity={NAME: {}},
        provenance=provenance(case, {"stage": []}),
        points=replace(points, columns={**points.columns, **distances}),
    )
    return Subject({NAME: Result(NAME, NAME, run)}, [NAME], [run], [])


def _bounding_box(vertices: Array) -> tuple[Array, Array]:
    low = vertices.min(axis=0)
    return low, np.maximum(np.ptp(vertices, axis=0), TINY)


def _write_box(low: Array, size: Array) -> Event:
    return {"low": low.tolist(), "size": size.tolist()}
