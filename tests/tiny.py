"""A case and stages small enough for tests of the spine: a sphere, points around it, a stage that shifts, one
that spies.
"""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import EntryPoint
from typing import ClassVar, Literal

import numpy as np
import pytest
from pydantic import Field

from o3dls.arrays import Array
from o3dls.case import Case, Points, Truth
from o3dls.estimate import Estimate
from o3dls.geometry.similarity import apply, similarity
from o3dls.geometry.surface import Surface, outline
from o3dls.plugins import plugin as registry
from o3dls.plugins.stage import Stage

SHIFT = np.array([1.0, -0.5, 0.25])
SEED = 880_213


def sphere(radius: float = 20.0, rings: int = 14) -> Surface:
    """A closed sphere of latitude rings, wound outward."""
    polar = np.linspace(0, np.pi, rings + 2)[1:-1]
    around = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    flat = np.sin(polar)[:, None, None] * np.column_stack([np.cos(around), np.sin(around)])
    grid = np.concatenate([flat, np.tile(np.cos(polar)[:, None, None], (1, 2 * rings, 1))], axis=2)
    vertices = np.vstack([grid.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]]) * radius
    n = 2 * rings
    k = np.arange(2 * rings)
    bands = [f for r in range(rings - 1) for f in _band(r * n + k, (r + 1) * n + k)]
    north = rings * n
    south = rings * n + 1
    last = (rings - 1) * n + k
    caps = [
        np.column_stack([np.full(n, north), k, np.roll(k, -1)]),
        np.column_stack([np.full(n, south), np.roll(last, -1), last]),
    ]
    return Surface(vertices, np.vstack([*bands, *caps]))


def _band(upper: Array, lower: Array) -> list[Array]:
    return [
        np.column_stack([upper, lower, np.roll(upper, -1)]),
        np.column_stack([np.roll(upper, -1), lower, np.roll(lower, -1)]),
    ]


def ball_case(points: int = 60, **changes: object) -> Case:
    """A sphere whose points, landmarks and truth are shifted by SHIFT; ablation and held-out points lie on
    the truth.
    """
    rng = np.random.default_rng(SEED)
    prior = sphere()
    pose = similarity(np.eye(3), SHIFT)
    directions = rng.normal(size=(points + 30, 3))
    on_truth = apply(pose, 20.0 * directions / np.linalg.norm(directions, axis=1, keepdims=True))
    marks = {"a": np.array([20.0, 0, 0]), "b": np.array([0, 20.0, 0]), "c": np.array([0, 0, 20.0])}
    xyz = np.vstack([on_truth[: points + 10], apply(pose, np.array(list(marks.values())))])
    kind = np.array(["eam"] * points + ["ablation"] * 10 + ["landmark"] * 3)
    name = np.array([""] * (points + 10) + list(marks))
    truth = Truth(
        prior.transformed(pose),
        on_truth[-20:],
        np.arange(20) < 5,
        (prior.vertices, apply(pose, prior.vertices)),
        np.array([3]),
    )
    case = Case("ball", prior, Points(xyz, kind, {"name": name}), marks, truth=truth)
    return replace(case, **changes)


def disc_case(points: int = 24) -> Case:
    """A circle in pixels, 2D, with a truth one pixel to the right."""
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    circle = outline(np.column_stack([50 + 30 * np.cos(angle), 50 + 30 * np.sin(angle)]))
    truth = circle.with_vertices(circle.vertices + np.array([1.0, 0.0]))
    rows = np.linspace(0, 90, points, endpoint=False).astype(int)
    return Case(
        "disc",
        circle,
        Points(truth.vertices[rows], np.full(points, "eam")),
        units="px",
        truth=Truth(truth, truth.vertices),
    )


class Nudge(Stage):
    """Shift the surface to the points' mean distance along each axis."""

    name: ClassVar[str] = "nudge"
    share: float = Field(
        1.0, ge=0.0, le=1.0, description="how much of the way", json_schema_extra={"unit": "1"}
    )
    limit: float = Field(50.0, gt=0.0, description="longest shift", json_schema_extra={"unit": "mm"})
    mode: Literal["mean", "median"] = Field("mean", description="what is matched")

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        centre = getattr(np, self.mode)(case.points.of("eam").xyz, axis=0)
        step = np.clip(self.share * (centre - start.surface.vertices.mean(axis=0)), -self.limit, self.limit)
        T = similarity(np.eye(case.dimension), step) @ start.T_map_prior
        length = float(np.linalg.norm(step))
        return Estimate(
            case.prior.transformed(T), T, f"shifted by {length:.2f}", iterations=1, trace=({"step": length},)
        )


class Greedy(Nudge):
    """Shift that also fits the ablation points."""

    name: ClassVar[str] = "greedy"

    @property
    def fits(self) -> tuple[str, ...]:
        return ("eam", "ablation")


class Spy(Stage):
    """Keeps what it is shown."""

    name: ClassVar[str] = "spy"
    seen: ClassVar[list[Case]] = []

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        self.seen.append(case)
        return start


class Broken(Stage):
    """Turns the surface inside out."""

    name: ClassVar[str] = "broken"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        surface = start.surface
        return replace(start, surface=Surface(surface.vertices, surface.faces[:, ::-1]), status="inside out")


@pytest.fixture
def tiny_stages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nudge, Greedy, Spy and Broken are found by name, as if a package had brought them."""
    entries = {
        kind.name: EntryPoint(kind.name, f"tiny:{kind.__name__}", "o3dls.stages")
        for kind in (Nudge, Greedy, Spy, Broken)
    }
    known = registry.registered
    monkeypatch.setattr(
        registry, "registered", lambda group: known(group) | (entries if group == "o3dls.stages" else {})
    )
