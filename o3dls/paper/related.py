"""Systems that the paper relates to: surfaces from points alone, with few points and with enough of them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from data_synth import atrium as synthetic_atrium

from ..arrays import Array
from ..errors import InputError
from ..evaluation.distances import distances, sample
from ..geometry.surface import Surface
from ..pipeline.pipeline import Pipeline
from ..report.drawing.figures import plain_figure, png
from ..stages.deform import Deform
from ..stages.icp import ICP
from ..stages.landmarks import Landmarks
from ..stages.level_set import LevelSet
from .blocks import Block, Figure, Heading, Table, Text
from .experiment import Outcome, Row, Scope, Task, judged, mean_sd, truth_of
from .results import Results, column

COUNTS = (250, 1000, 4000, 16000)
NOISE = 0.5
CELL = 2.0  # mm
NEIGHBOURS = 12
LENGTHS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # ticks, mm
METHODS = {
    "hoppe": ("tangent planes (Hoppe)"),
    "zhao": ("weighted minimal surface (Zhao)"),
    "poisson": "Poisson",
    "alpha_shape": "alpha shape",
    "similarity": "prior by similarity ICP alone",
    "level_set": "level set with prior (ours)",
}
STYLES = {
    "hoppe": ("#e69f00", "^"),
    "zhao": ("#009e73", "v"),
    "poisson": ("#d55e00", "s"),
    "alpha_shape": ("#cc79a7", "D"),
    "similarity": ("#8a8f98", "x"),
    "level_set": ("#0072b2", "o"),
}


def tasks(scope: Scope) -> list[Task]:
    counts = COUNTS if not scope.quick else COUNTS[:1]
    return [
        Task("related", f"related systems, {n} points, seed {seed}", fit, (seed, n))
        for n in counts
        for seed in scope.seeds(2)
    ]


def left_out(scope: Scope) -> dict[str, str]:
    return {}


def fit(seed: int, count: int) -> Outcome:
    """All systems on one atrium, seen everywhere, without outliers: as kind to them as can be."""
    case = synthetic_atrium(seed, points=count, noise=NOISE, outliers=0.0, unseen=0.0)
    points = case.points.of("eam").xyz
    truth = truth_of(case)
    start = Pipeline([Landmarks(), ICP()], folds=0)
    plan = Pipeline([*start.stages, Deform(), LevelSet()], folds=0)
    makers: dict[str, Callable[[], Surface]] = {
        "hoppe": lambda: tangent_planes(points),
        "zhao": lambda: minimal_surface(points),
        "poisson": lambda: poisson(points),
        "alpha_shape": lambda: alpha_shape(points),
        "similarity": lambda: start.fit(case)["icp"].surface,
        "level_set": lambda: plan.fit(case)["level_set"].surface,
    }
    rows = [
        {"seed": seed, "points": count, "method": name} | _scored(make, truth)
        for name, make in makers.items()
    ]
    return Outcome(rows)


def _scored(make: Callable[[], Surface], truth: Surface) -> Row:
    """Errors both ways; a system that finds no surface says so."""
    began = time.perf_counter()
    try:
        surface = make()
    except InputError as error:
        return {"failed": str(error)}
    seconds = time.perf_counter() - began
    there, back = distances(sample(truth), surface).mean(), distances(sample(surface), truth).mean()
    return {"truth_to_surface": float(there), "assd": float(there + back) / 2.0, "seconds": seconds} | judged(
        surface
    )


def neighbours(points: Array) -> int:
    """Points that make a tangent plane: enough to be wider than the noise where points are dense."""
    return max(NEIGHBOURS, len(points) // 300)


def _cloud(points: Array) -> Any:
    """An Open3D cloud with oriented normals."""
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    around = neighbours(points)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(around))
    cloud.orient_normals_consistent_tangent_plane(around)
    normals = np.asarray(cloud.normals)
    if ((points - points.mean(axis=0)) * normals).sum() < 0.0:
        cloud.normals = o3d.utility.Vector3dVector(-normals)
    return cloud


def _surface(mesh: Any) -> Surface:
    if len(mesh.triangles) == 0:
        raise InputError("no surface")
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.triangles))


def poisson(points: Array) -> Surface:
    """Screened Poisson reconstruction (Kazhdan 2013) by Open3D."""
    import open3d as o3d

    return _surface(
        o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(_cloud(points), depth=6, n_threads=1)[0]
    )


def alpha_shape(points: Array) -> Surface:
    """Alpha shape by Open3D, its radius three times the points' distance."""
    import open3d as o3d

    spacing = _spacing(points)
    return _surface(
        o3d.geometry.TriangleMesh.create_from_point_cloud_alpha_shape(
            o3d.geometry.PointCloud(_cloud(points)), 3.0 * spacing
        )
    )


def _spacing(points: Array) -> float:
    """How far apart points lie: the median distance of the sixth neighbour."""
    from scipy.spatial import cKDTree

    return float(np.median(np.asarray(cKDTree(points).query(points, k=7)[0])[:, -1]))


def _lattice(points: Array) -> tuple[Array, list[Array]]:
    """Nodes (k, 3) and axes of a lattice about the points."""
    axes = [
        np.arange(low - 5 * CELL, high + 6 * CELL, CELL)
        for low, high in zip(points.min(axis=0), points.max(axis=0), strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), axes


def _zero_set(phi: Array, axes: list[Array]) -> Surface:
    import open3d as o3d

    if not (phi < 0.0).any():
        raise InputError("no surface: the level set vanished")
    mesh = o3d.t.geometry.TriangleMesh.create_isosurfaces(
        o3d.core.Tensor.from_numpy(np.ascontiguousarray(phi.T.astype(np.float32))), [0.0]
    )
    faces = mesh.triangle.indices.numpy()[:, ::-1].astype(np.int64)
    if len(faces) == 0:
        raise InputError("no surface: the level set does not change its sign")
    return Surface(
        mesh.vertex.positions.numpy().astype(np.float64) * CELL + [axis[0] for axis in axes], faces
    )


def tangent_planes(points: Array) -> Surface:
    """Zero set of the signed distance to the tangent plane of the nearest neighbourhood (Hoppe 1992), where a
    point is near.
    """
    from scipy.spatial import cKDTree

    nodes, axes = _lattice(points)
    normals = np.asarray(_cloud(points).normals)
    middles = points[cKDTree(points).query(points, k=neighbours(points))[1]].mean(axis=1)
    nearest = cKDTree(middles).query(nodes)[1]
    signed = ((nodes - middles[nearest]) * normals[nearest]).sum(axis=1)
    found = _zero_set(signed.reshape([len(axis) for axis in axes]), axes)
    known = np.asarray(cKDTree(points).query(found.vertices)[0]) < 2.0 * _spacing(points) + CELL
    return Surface(found.vertices, found.faces[known[found.faces].all(axis=1)])


def minimal_surface(points: Array) -> Surface:
    """Minimiser of the integral of the distance d over the surface (Zhao 2000): phi_t = |grad phi| (d kappa)
    + grad d . grad phi.

    From outside of the points inward, and half as far again as the points lie: its only global minimum is the
    empty surface.
    """
    from scipy.ndimage import distance_transform_edt
    from scipy.spatial import cKDTree

    nodes, axes = _lattice(points)
    shape = [len(axis) for axis in axes]
    d = np.asarray(cKDTree(points).query(nodes)[0]).reshape(shape)
    slope = np.gradient(d, CELL)
    outside = max(1.5 * _spacing(points), 2.0 * CELL)
    phi = _filled(d - outside, distance_transform_edt)
    dt = 0.2 * CELL / max(1.0, float(np.percentile(d, 95)) / CELL)
    for step in range(int(1.5 * outside / dt)):
        g = np.gradient(phi, CELL)
        size = np.sqrt(sum(a * a for a in g)) + 1e-6
        bend = sum(np.gradient(a / size, CELL, axis=k) for k, a in enumerate(g))
        phi = phi + dt * (
            d * np.clip(bend, -1.0 / CELL, 1.0 / CELL) * size
            + sum(a * b for a, b in zip(slope, g, strict=True))
        )
        if step % 10 == 9:
            phi = _filled(phi, distance_transform_edt)
    return _zero_set(phi, axes)


def _filled(phi: Array, edt: Callable[..., Any]) -> Array:
    """Signed distance of the outer boundary of phi < 0: cavities that nothing reaches from outside are
    inside.
    """
    from scipy.ndimage import binary_fill_holes

    inside = binary_fill_holes(phi < 0.0)
    near = np.abs(phi) < CELL
    coarse = CELL * (edt(~inside) - edt(inside) + np.where(inside, 0.5, -0.5))
    return np.where(near & ((phi < 0.0) == inside), phi, coarse)


def blocks(results: Results) -> list[Block]:
    rows = results.of("related")
    counts = sorted({row["points"] for row in rows})
    lines = []
    for name, words in METHODS.items():
        for n in counts:
            own = [row for row in rows if row["method"] == name and row["points"] == n]
            lines.append(
                [
                    f"{words}, {n}",
                    *(
                        mean_sd(column(own, key))
                        for key in ("truth_to_surface", "assd", "components", "seconds")
                    ),
                ]
            )
    return [
        Heading("Related systems: surfaces from points alone"),
        Text(
            f"The same atria with {', '.join(map(str, counts))} points seen everywhere, noise {NOISE:g} "
            "mm, no outliers: as kind "
            "to systems without a prior as can be. With an EAM's 250 points they lose or invent veins "
            "and are no better than "
            "the prior in its best pose; with enough points they work, and pass it."
        ),
        Figure("related", "Error both ways against the number of points.", _curve(rows, counts)),
        Table(
            "Mean ± standard deviation over seeds, mm",
            ["system, points", "truth to surface", "both ways", "pieces", "s"],
            lines,
        ),
    ]


def _curve(rows: list[Row], counts: list[int]) -> bytes:
    with plain_figure(7.2, 3.4) as figure:
        ax = figure.subplots()
        for name, (colour, marker) in STYLES.items():
            values = [
                column([row for row in rows if row["method"] == name and row["points"] == n], "assd")
                for n in counts
            ]
            drawn = [(n, v.mean(), v.std()) for n, v in zip(counts, values, strict=True) if len(v)]
            if drawn:
                at, mean, sd = zip(*drawn, strict=True)
                ax.errorbar(at, mean, sd, color=colour, marker=marker, capsize=3, label=METHODS[name])
        ax.set(xscale="log", yscale="log", xlabel="points", ylabel="mean distance both ways, mm")
        ax.set_xticks(counts, [str(n) for n in counts])
        ax.set_yticks(LENGTHS, [f"{length:g}" for length in LENGTHS])
        ax.minorticks_off()
        ax.grid(alpha=0.25)
        ax.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0))
        figure.tight_layout()
        return png(figure)
