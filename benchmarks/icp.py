"""ICP against ICP: accuracy of the variants on case folders, seconds beside Open3D and small_gicp, and the
search without a start.

    python -m benchmarks.icp accuracy CASES...                held-out mean and scale error of each variant
    python -m benchmarks.icp speed CASE [--faces N]           milliseconds of one warm registration
    python -m benchmarks.icp search CASES... [--rotations N]  how often the global search finds the pose again
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import Listed, find
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import distances
from o3dls.geometry.similarity import apply, fit_similarity, scale_of, similarity
from o3dls.geometry.surface import Surface
from o3dls.pipeline.start import start_estimate
from o3dls.registration.global_pose import angle_of
from o3dls.registration.search import even_rotations
from o3dls.stages.global_pose import GlobalPose
from o3dls.stages.icp import ICP

VARIANTS: dict[str, ICP] = {
    "standard": ICP(preset="standard"),
    "modified": ICP(preset="modified"),
    "point to plane": ICP(preset="standard", metric="point_to_plane"),
    "standard, scaled": ICP(preset="standard", scale=True),
    "Open3D point to point, scaled": ICP(preset="standard", engine="open3d", scale=True),
    "point to plane, scaled": ICP(preset="standard", metric="point_to_plane", scale=True),
    "symmetric, scaled": ICP(preset="standard", metric="symmetric", scale=True),
    "generalized, scaled": ICP(preset="standard", metric="generalized", scale=True),
    "tukey, scaled": ICP(preset="standard", metric="point_to_plane", scale=True, kernel="tukey"),
    "robust, rigid": ICP(scale=False),
    "robust": ICP(),
}
REPEATS = 15


def accuracy(listed: list[Listed]) -> None:
    """One row per variant: mean held-out distance, its worst excess over the rigid robust variant, scale
    error, iterations.
    """
    held: dict[str, list[float]] = {name: [] for name in VARIANTS}
    scale: dict[str, list[float]] = {name: [] for name in VARIANTS}
    rounds: dict[str, list[int]] = {name: [] for name in VARIANTS}
    for item in listed:
        case = item.read()
        seen = case.visible()
        wanted = _find_best_scale(case)
        start = start_estimate(seen)
        for name, stage in VARIANTS.items():
            found = stage(seen, start)
            held[name].append(float(_measure_held_out(case, found.surface).mean()))
            scale[name].append(found.scale - wanted)
            rounds[name].append(found.iterations)
    print(f"{len(listed)} cases: {', '.join(item.name for item in listed)}")
    print(
        f"{'':32}{'held-out':>9}{'worst':>8}{'- rigid':>9}{'scale rms':>11}{'max':>7}{'> .02':>7}{'steps':>7}"
    )
    for name in VARIANTS:
        over = max(np.subtract(held[name], held["robust, rigid"]))
        size = np.abs(scale[name])
        errors = f"{np.mean(held[name]):9.3f}{max(held[name]):8.2f}{over:9.2f}"
        sizes = f"{np.sqrt((size**2).mean()):11.4f}{size.max():7.3f}{(size > 0.02).sum():7d}"
        print(f"{name:32}{errors}{sizes}{np.mean(rounds[name]):7.1f}")


def _measure_held_out(case: Case, surface: Surface) -> Array:
    """Distances of the held-out points, or of the true vertices where the case has none."""
    assert case.truth is not None
    points = case.truth.held_out if case.truth.held_out is not None else case.truth.surface.vertices  # type: ignore[union-attr]
    return distances(points, surface)


def _find_best_scale(case: Case) -> float:
    """Scale of the best similarity to the true correspondences: named ones, or those of meshes with equal
    faces; NaN where unknown.
    """
    truth = case.truth
    if truth is not None and truth.correspondence is not None:
        return scale_of(fit_similarity(*truth.correspondence))
    if truth is None or truth.surface is None or not np.array_equal(truth.surface.faces, case.prior.faces):
        return float("nan")
    return scale_of(fit_similarity(case.prior.vertices, truth.surface.vertices))


def speed(item: Listed, faces: int) -> None:
    """One row per method: best and median milliseconds from arrays in memory to the pose, and the median
    distance it leaves.
    """
    case = item.read().visible()
    case = replace(case, prior=_remesh_prior(case.prior, faces))
    start = start_estimate(case)
    points = case.points.of("eam").xyz
    methods: dict[str, Callable[[], Array]] = {
        f"o3dls {name}": lambda stage=stage: stage(case, start).T_map_prior  # type: ignore[misc]
        for name, stage in VARIANTS.items()
        if stage.engine == "o3dls"
    }
    methods |= _list_open3d(case.prior, points, start) | _list_small_gicp(case.prior, points, start)
    print(f"{item.name}: {len(points)} points, {len(case.prior.faces)} faces")
    print(f"{'':40}{'best ms':>9}{'median ms':>11}{'median gap':>12}{'mean gap':>10}")
    for name, method in methods.items():
        pose = method()  # warm: compiled kernels, imported packages
        seconds = sorted(_time_call(method) for _ in range(REPEATS))
        gaps = distances(points, case.prior.transformed(pose))
        print(
            f"{name:40}{1e3 * seconds[0]:9.1f}{1e3 * seconds[REPEATS // 2]:11.1f}"
            f"{np.median(gaps):12.2f}{gaps.mean():10.2f}"
        )


def _time_call(method: Callable[[], Array]) -> float:
    begin = time.perf_counter()
    method()
    return time.perf_counter() - begin


def _remesh_prior(prior: Surface, faces: int) -> Surface:
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(prior.vertices), o3d.utility.Vector3iVector(prior.faces.astype(np.int32))
    )
    mesh = mesh.subdivide_midpoint(1).simplify_quadric_decimation(faces)
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.triangles))


def _list_open3d(prior: Surface, points: Array, start: Estimate) -> dict[str, Callable[[], Array]]:
    """Open3D's legacy registration: points against the prior's vertices, 30 steps at most, as its defaults
    are.
    """
    import open3d as o3d

    registration = o3d.pipelines.registration
    begin = np.linalg.inv(start.T_map_prior)

    def run(estimator: Any) -> Array:
        source, target = (
            o3d.geometry.PointCloud(o3d.utility.Vector3dVector(xyz)) for xyz in (points, prior.vertices)
        )
        target.normals = o3d.utility.Vector3dVector(prior.vertex_normals)
        return np.asarray(
            np.linalg.inv(
                registration.registration_icp(source, target, 30.0, begin, estimator).transformation
            )
        )

    return {
        "Open3D legacy point to point": lambda: run(registration.TransformationEstimationPointToPoint()),
        "Open3D legacy point to point, scaled": lambda: run(
            registration.TransformationEstimationPointToPoint(True)
        ),
        "Open3D legacy point to plane": lambda: run(registration.TransformationEstimationPointToPlane()),
    }


def _list_small_gicp(prior: Surface, points: Array, start: Estimate) -> dict[str, Callable[[], Array]]:
    """small_gicp on the prior's vertices, where it is installed (extra `bench`)."""
    try:
        import small_gicp
    except ImportError:
        print("small_gicp is not installed: pip install o3dls[bench]")
        return {}
    begin = np.linalg.inv(start.T_map_prior)

    def run(kind: str) -> Array:
        found = small_gicp.align(
            prior.vertices,
            points,
            begin,
            registration_type=kind,
            downsampling_resolution=1e-3,
            max_correspondence_distance=30.0,
        )
        return np.asarray(np.linalg.inv(found.T_target_source))

    return {f"small_gicp {kind}": lambda kind=kind: run(kind) for kind in ("ICP", "PLANE_ICP", "GICP")}  # type: ignore[misc]


def search(listed: list[Listed], rotations: int) -> None:
    """One row per case: how often the search, from the points turned by each rotation, comes within 10
    degrees of the best pose.
    """
    print(f"{'':32}{'right':>8}{'lowest sure':>13}{'sure if wrong':>15}{'median s':>10}{'longest s':>11}")
    for item in listed:
        case = item.read().visible()
        points = case.points.of("eam")
        still = Estimate(case.prior, np.eye(4), "no start")
        best = GlobalPose(starts=20_000)(replace(case, points=points), still).T_map_prior
        seconds, right, sure = [], [], []
        for turn in even_rotations(rotations, 3):
            frame = similarity(turn, np.array([40.0, -25.0, 60.0]))
            turned = replace(case, points=replace(points, xyz=apply(frame, points.xyz)))
            begin = time.perf_counter()
            found = GlobalPose()(turned, still)
            seconds.append(time.perf_counter() - begin)
            right.append(np.degrees(angle_of(found.T_map_prior, frame @ best)) < 10.0)
            sure.append(found.facts["confidence"])
        wrong = max((s for s, ok in zip(sure, right, strict=True) if not ok), default=float("nan"))
        print(
            f"{item.name:32}{sum(right):5d}/{rotations}{min(sure):11.3f}{wrong:15.3f}{np.median(seconds):10.2f}{max(seconds):11.2f}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("accuracy", "speed", "search"))
    parser.add_argument("cases", nargs="+", type=Path)
    parser.add_argument("--faces", type=int, default=30_000)
    parser.add_argument("--rotations", type=int, default=40)
    given = parser.parse_args()
    listed = [item for item in find(given.cases) if item.points is None]
    if given.what == "accuracy":
        accuracy(listed)
    elif given.what == "speed":
        speed(listed[0], given.faces)
    else:
        search(listed, given.rotations)


if __name__ == "__main__":
    main()
