"""Finished runs for tests of report, export and view: a bumpy ball, a circle, and stages that move them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import ClassVar

import numpy as np

from o3dls.arrays import Array
from o3dls.case import Case, Points, Truth
from o3dls.estimate import Estimate
from o3dls.geometry.similarity import apply, similarity
from o3dls.geometry.surface import Surface
from o3dls.pipeline.pipeline import Pipeline
from o3dls.plugins.stage import Stage
from o3dls.run_warning import RunWarning
from o3dls.runs.run import Run
from tests.tiny import disc_case, sphere

SEED = 551_908
NASTY = (
    '</script><script>window.bad = 1</script> "quoted" & \'single\' <img src=x onerror="window.bad = '
    '1"> 左心房 предсердие'
)


class Bulge:
    """A motion that pushes the prior outward on one side."""

    def __init__(self, T_map_prior: Array, height: float) -> None:
        self.T, self.height = T_map_prior, height

    def __call__(self, points: Array) -> Array:
        moved = apply(self.T, points)
        return moved + self.height * np.clip(points[:, :1] / 20.0, 0, 1) * np.eye(points.shape[1])[0]

    def sd(self, points: Array, normals: Array) -> Array:
        return np.linspace(0.3, 1.5, len(points))


class Icp(Stage):
    """Moves the prior rigidly, a little beside the truth, and says that it is not sure of one direction."""

    name: ClassVar[str] = "icp"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        T = similarity(np.eye(case.dimension), np.full(case.dimension, 0.3))
        trace = tuple({"iteration": float(k), "residual": 2.0 / (k + 1)} for k in range(6))
        status = "converged: the pairs no longer change"
        said = (RunWarning("weak-direction", "the rotation about the long axis is weakly determined"),)
        return Estimate(case.prior.transformed(T), T, status, iterations=6, trace=trace, warnings=said)


class LevelSet(Stage):
    """Moves the prior as the truth was moved, and hands on what was said before."""

    name: ClassVar[str] = "level_set"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        T = np.eye(case.dimension + 1)
        motion = Bulge(T, 3.0)
        weights = np.ones(int(np.isin(case.points.type, ["eam", "inside"]).sum()))
        weights[3] = 0.02
        trace = tuple(
            {"iteration": float(k), "data": 9.0 / (k + 1), "shape": 1.0, "energy": 9.0 / (k + 1) + 1}
            for k in range(12)
        )
        surface = case.prior.with_vertices(motion(case.prior.vertices))
        status = "stopped at the largest number of iterations"
        return Estimate(
            surface,
            T,
            status,
            False,
            12,
            weights=weights,
            motion=motion,
            sigma=0.6,
            trace=trace,
            warnings=start.warnings,
        )


def bulged_case(name: str = "ball", rings: int = 14, points: int = 80, noise: float = 0.5) -> Case:
    """A ball whose truth bulges by 3 mm on one side; noisy points, one of them far inside, ablation points,
    voltages, landmarks.
    """
    rng = np.random.default_rng(SEED)
    prior = sphere(rings=rings)
    motion = Bulge(np.eye(4), 3.0)
    directions = rng.normal(size=(points + 220, 3))
    on_truth = motion(20.0 * directions / np.linalg.norm(directions, axis=1, keepdims=True))
    measured = on_truth[: points + 20] + noise * rng.normal(size=(points + 20, 3))
    measured[3] *= 0.6
    marks = {
        "LSPV": np.array([0.0, 20.0, 0.0]),
        "RSPV": np.array([0.0, 0.0, 20.0]),
        "LIPV": np.array([0.0, -20.0, 0.0]),
    }
    xyz = np.vstack([measured, list(marks.values())])
    kind = np.array(["eam"] * points + ["ablation"] * 20 + ["landmark"] * 3)
    names = np.array([""] * (points + 20) + list(marks))
    bipolar = np.where(kind == "eam", np.clip(xyz[:, 2] / 10 + 2, 0.05, None), np.nan)
    truth = Truth(prior.with_vertices(motion(prior.vertices)), on_truth[-200:], on_truth[-200:, 0] < -10)
    return Case(
        name, prior, Points(xyz, kind, {"name": names, "bipolar": bipolar}), marks, frame="LPS", truth=truth
    )


def finished(
    folder: Path, case: Case | None = None, *, folds: int = 0, writes: tuple[object, ...] = ()
) -> Path:
    """The folder of a finished run of `icp` and `level_set`."""
    if case is None and not writes:
        return _run(3, folds).write(folder)
    return _pipeline(folds, writes).run(case or bulged_case()).write(folder)


def finished_2d(folder: Path) -> Path:
    """The same in two dimensions, in pixels."""
    return _run(2).write(folder)


def _pipeline(folds: int, writes: tuple[object, ...] = ()) -> Pipeline:
    return Pipeline([Icp(), LevelSet()], writes=writes, folds=folds)


@cache
def _run(dimension: int, folds: int = 0) -> Run:
    """What most tests write, fitted and scored once in a process."""
    return _pipeline(folds).run(bulged_case() if dimension == 3 else disc_case())


def fine_sphere(faces: int) -> Surface:
    """A sphere of about so many faces."""
    return sphere(rings=max(4, round((faces / 4) ** 0.5)))


def renamed(case: Case, name: str) -> Case:
    return replace(case, name=name)
