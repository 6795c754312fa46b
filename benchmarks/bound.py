"""The least error that the atrium phantom allows: linear MMSE that knows the generator's displacement
covariance.

Known as well: which points are outliers, the noise level, every point's true foot; observed is the distance
along the normal. So no method that sees the points alone can be better in the mean, and none comes quite
there.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from benchmarks.cases import Listed
from benchmarks.scores import on_wall
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.evaluation.distances import distances
from o3dls.geometry.closest_point import ClosestPoint
from o3dls.geometry.similarity import apply, fit_similarity
from o3dls.geometry.surface import Surface

MOTION = {"la": 1.0, "lah": 2.0}  # phantom.py's --motion
DRAWS = 1500
EVERY = 4  # of the held-out points
PRIOR_NOISE, PRIOR_NOISE_LENGTH = 0.3, 4.0  # mm, of the phantom's segmentation
SEED = 553_091_827
POSE = np.array([5.0, 5.0, 5.0, 0.1, 0.1, 0.1, 0.1])  # a nearly flat prior of the similarity: mm, rad, 1


def load(path: Path) -> ModuleType:
    """The phantom generator as a module."""
    spec = importlib.util.spec_from_file_location("phantom", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def bound(listed: Listed, case: Case, phantom: ModuleType) -> dict[str, float]:
    """Least expected error along the normal at held-out points: `held_out`, `seen`, `unseen`."""
    truth = case.truth
    assert truth is not None
    assert truth.surface is not None
    assert truth.held_out is not None
    assert truth.unseen is not None
    anatomy = phantom._anatomy(np.random.default_rng(3000 + (listed.seed or 0)))
    ostia = np.stack([anatomy["pv"][name]["ost"] for name in phantom.PV])
    marks = np.stack([case.prior_landmarks[name] for name in phantom.PV])
    rest = Surface(apply(np.linalg.inv(fit_similarity(ostia, marks)), case.prior.vertices), case.prior.faces)
    points = case.points.xyz[on_wall(case)]
    noise = np.sqrt((distances(points, truth.surface) ** 2).mean())
    unseen = truth.unseen[::EVERY]
    at, normals = _feet(np.vstack([points, truth.held_out[::EVERY]]), truth.surface, rest)
    covariance = _covariance(at, normals, rest.vertices, anatomy, phantom, MOTION[listed.group])
    n = len(points)
    seen_by = covariance[:n, :n] + noise**2 * np.eye(n)
    crossed = covariance[n:, :n]
    variance = np.diag(covariance)[n:] - (crossed * np.linalg.solve(seen_by, crossed.T).T).sum(axis=1)
    error = np.sqrt(2.0 / np.pi * np.maximum(variance, 0.0))
    return {
        "held_out": float(error.mean()),
        "seen": float(error[~unseen].mean()),
        "unseen": float(error[unseen].mean()),
    }


def _feet(points: Array, truth: Surface, rest: Surface) -> tuple[Array, Array]:
    """True feet of points, carried back to the anatomy at rest, with its normals there: truth and prior share
    their faces.
    """
    _, face, _, bary = ClosestPoint(truth.vertices, truth.faces).query(points)
    corners = rest.faces[face]
    normals = np.einsum("nc,ncd->nd", bary, rest.vertex_normals[corners])
    return np.einsum("nc,ncd->nd", bary, rest.vertices[corners]), normals / np.linalg.norm(normals, axis=1)[
        :, None
    ]


def _covariance(
    at: Array, normals: Array, vertices: Array, anatomy: Any, phantom: ModuleType, motion: float
) -> Array:
    """Covariance of the normal displacements: of the deformation by draws, of the segmentation noise and the
    pose in closed form.
    """
    from scipy.spatial.distance import cdist

    rng = np.random.default_rng(SEED)
    draws = np.stack(
        [
            ((_warp(at, vertices, anatomy, phantom, motion, rng) - at) * normals).sum(axis=1)
            for _ in range(DRAWS)
        ]
    )
    draws -= draws.mean(axis=0)
    pose = np.column_stack([normals, np.cross(at, normals), (at * normals).sum(axis=1)]) * POSE
    noise = PRIOR_NOISE**2 * np.exp(-0.5 * cdist(at, at, "sqeuclidean") / PRIOR_NOISE_LENGTH**2)
    return np.asarray(draws.T @ draws / DRAWS + pose @ pose.T + noise)


def _warp(
    x: Array, vertices: Array, anatomy: Any, phantom: ModuleType, motion: float, rng: np.random.Generator
) -> Array:
    """One draw of the deformation, as phantom.py draws it."""
    change = rng.uniform(0.10, 0.25) * rng.choice([-1, 1])
    split = rng.dirichlet([2, 2, 2])
    stretch = (1 + change) ** split
    mean = stretch.prod() ** (1 / 3)
    y = x * mean * (stretch / mean) ** motion
    axis = rng.normal(size=3) * [1, 0.3, 0.3]
    k = np.cross(np.eye(3), axis / np.linalg.norm(axis))
    angle = np.deg2rad(rng.uniform(3, 7)) * motion * rng.choice([-1, 1]) * np.tanh(x[:, 2] / 20.0)
    y = y + np.sin(angle)[:, None] * (y @ k.T) + (1 - np.cos(angle))[:, None] * (y @ (k @ k).T)
    centre = vertices[rng.integers(len(vertices))]
    height = motion * rng.uniform(2.5, 4.5) * rng.choice([-1, 1])
    width = rng.uniform(8, 11)
    y = y + (height * np.exp(-((x - centre) ** 2).sum(axis=1) / (2 * width**2)))[
        :, None
    ] * centre / np.linalg.norm(centre)
    for name in phantom.PV:
        y = y + np.exp(-((x - anatomy["pv"][name]["ost"]) ** 2).sum(axis=1) / 200.0)[:, None] * (
            rng.normal(size=3) * 2.0 * motion
        )
    return np.asarray(y)
