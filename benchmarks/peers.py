"""Other methods, run as their authors mean them to be run, on the same case from the same pose: what they
find for the prior's surface.

    python -m benchmarks.peers tune FOLDER...       choose each peer's setting per group on development cases

Each peer is a function (case, pose, parameters) -> surface. Every setting of its grid in GRIDS is tried on
the first case of a group, the best quarter on the others. The lowest mean symmetric distance to the truth
wins, and is written to benchmarks/tuned.json with the number of settings tried: about an hour for all groups.
Real cases are tuned on themselves, in the peers' favour. Make development cases (seeds below 1000) as `python
-m benchmarks.accuracy --help` shows. Crossed atria share one setting per number of points (`cross_250`,
whatever the noise; clustered maps with 2 mm of noise and outliers have their own), families one per name and
strength (`family_flow_1`).
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from itertools import groupby, product
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.cases import Listed, find, tuned_as
from benchmarks.scores import truth_distances
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.geometry.closest_point import ClosestPoint
from o3dls.geometry.surface import Surface
from o3dls.pipeline.start import start_estimate
from o3dls.stages.icp import ICP

Peer = Callable[..., Surface]
ROUNDS = 15  # most re-associations of the warp
STILL = 1e-3  # mean step, in rms distances of the start, at which a warp stands still
COARSE_FACES = 2000  # nricp solves for the prior decimated to this; its motion is carried to the full mesh
MOST = 2000  # points: the dense solvers get no more, each the mean of some; so even in the peers' favour
CPD_MOVING = 1500  # points that it may move: it solves for as many weights in every round
CPD_NODES = 700  # pycpd is dense: this many vertices of the prior, its motion interpolated by its own kernel
LEAST_FACES = 100  # of a Poisson reconstruction: fewer are no surface
TUNED = Path(__file__).with_name("tuned.json")
SAMPLES = 4000
KEPT = 0.25  # share of the settings that go on to the second case


def thin_plate(case: Case, pose: Array, *, kernel: str, smoothing: float, reject: float) -> Surface:
    """Biharmonic warp of scipy, re-associated to closest points; points beyond median + `reject` robust
    deviations are left out.
    """
    from scipy.interpolate import RBFInterpolator

    posed = case.prior.transformed(pose)
    points = _thin_points(case.points.of("eam").xyz)
    moved = posed.vertices
    tree = ClosestPoint(posed.vertices, posed.faces)
    still = STILL * float(np.sqrt(tree.query(points)[0].mean()))
    for _ in range(ROUNDS):
        keep, feet = _find_believed(tree, points, posed, reject)
        # two points with one foot make the system singular
        at, first = np.unique(np.round(feet[keep], 6), axis=0, return_index=True)
        warp = RBFInterpolator(at, points[keep][first] - at, kernel=kernel, smoothing=smoothing)
        before = moved
        moved = posed.vertices + warp(posed.vertices)
        tree = tree.at(moved)
        if np.linalg.norm(moved - before, axis=1).mean() < still:
            break
    return posed.with_vertices(moved)


def nricp_sumner(
    case: Case, pose: Array, *, smooth: float, landmarks: float, reject: float, rounds: int
) -> Surface:
    """trimesh's non-rigid ICP after Sumner and Popovic, the points as landmarks of their feet, re-associated
    `rounds` times.
    """
    import trimesh
    from scipy.interpolate import RBFInterpolator

    posed = case.prior.transformed(pose)
    points = _thin_points(case.points.of("eam").xyz)
    coarse = _decimate_surface(posed)
    mesh = trimesh.Trimesh(coarse.vertices, coarse.faces, process=False)
    moved = coarse.vertices
    tree = ClosestPoint(coarse.vertices, coarse.faces)
    for _ in range(rounds):
        keep, _ = _find_believed(tree, points, coarse, reject)
        _, face, _, bary = tree.query(points[keep])
        # no correspondences but the points: there is no target surface
        steps = [[0.0, 1e-3, smooth, landmarks, 0.0]]
        # trimesh asks for a target all the same; its own vertices, weighted zero, are one
        moved = trimesh.registration.nricp_sumner(
            mesh, moved, (face, bary), points[keep], steps=steps, use_faces=False
        )
        moved = np.asarray(moved)
        tree = tree.at(moved)
    shift = RBFInterpolator(coarse.vertices, moved - coarse.vertices, neighbors=16, kernel="linear")
    return posed.with_vertices(posed.vertices + shift(posed.vertices))


def cpd(case: Case, pose: Array, *, moves: str, alpha: float, beta: float, outliers: float) -> Surface:
    """pycpd's deformable registration, in units of the prior's rms radius; `moves` says which side is the
    moving one.

    Points that move onto the prior leave its unseen areas alone, but the motion wanted is then the inverse of
    what they did.
    """
    from pycpd import DeformableRegistration

    posed = case.prior.transformed(pose)
    centre = posed.vertices.mean(axis=0)
    size = float(np.sqrt(((posed.vertices - centre) ** 2).sum(axis=1).mean()))
    most = MOST if moves == "prior" else CPD_MOVING
    points = (_thin_points(case.points.of("eam").xyz, most) - centre) / size
    vertices = (posed.vertices - centre) / size
    nodes = vertices[np.linspace(0, len(vertices) - 1, min(CPD_NODES, len(vertices))).round().astype(int)]
    still, moving = (nodes, points) if moves == "points" else (points, nodes)
    fit = DeformableRegistration(X=still, Y=moving, alpha=alpha, beta=beta, w=outliers, max_iterations=60)
    fit.register()
    if moves == "prior":
        return posed.with_vertices(centre + size * (vertices + _evaluate_cpd(fit, vertices)))
    back = vertices
    for _ in range(10):  # y + field(y) = x, by fixed point
        back = vertices - _evaluate_cpd(fit, back)
    return posed.with_vertices(centre + size * back)


def _evaluate_cpd(fit, at):  # type: ignore[no-untyped-def]
    from scipy.spatial.distance import cdist

    return np.exp(-cdist(at, fit.Y, "sqeuclidean") / (2.0 * fit.beta**2)) @ fit.W


def open3d_icp(case: Case, pose: Array, *, reach: float, kernel: str, samples: int) -> Surface:
    """Open3D's point-to-point ICP with scale, from the points to samples of the prior; `reach` in rms
    distances of the start.
    """
    import open3d as o3d

    from o3dls.evaluation.distances import sample

    posed = case.prior.transformed(pose)
    points = case.points.of("eam").xyz
    rms = float(np.sqrt((ClosestPoint(posed.vertices, posed.faces).query(points)[0]).mean()))
    clouds = [
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(_add_third_axis(x)))
        for x in (points, sample(posed, samples))
    ]
    reg = o3d.pipelines.registration
    found = (
        reg.registration_icp(
            *clouds,
            reach * rms,
            np.eye(4),
            reg.TransformationEstimationPointToPoint(with_scaling=True),
            reg.ICPConvergenceCriteria(max_iteration=200),
        )
        if kernel == "none"
        else _run_shrinking(reg, clouds, reach * rms)
    )
    back = np.linalg.inv(found.transformation)
    keep = [*range(case.dimension), 3]
    return posed.transformed(back[np.ix_(keep, keep)])


def _run_shrinking(reg, clouds, reach):  # type: ignore[no-untyped-def]
    """ICP whose reach shrinks from round to round, as coarse-to-fine recipes do: the scaled estimator takes
    no robust kernel.
    """
    pose = np.eye(4)
    for factor in (4.0, 2.0, 1.0):
        found = reg.registration_icp(
            *clouds,
            factor * reach,
            pose,
            reg.TransformationEstimationPointToPoint(with_scaling=True),
            reg.ICPConvergenceCriteria(max_iteration=100),
        )
        pose = found.transformation
    return found


def poisson(case: Case, pose: Array, *, depth: int, neighbours: int) -> Surface:
    """Open3D's screened Poisson reconstruction of the points alone, untrimmed; normals by the plane through
    the nearest points, turned to the side that the prior at its closest point looks to. Raises ValueError
    where nothing comes of it.
    """
    import open3d as o3d

    posed = case.prior.transformed(pose)
    points = case.points.of("eam").xyz
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(min(neighbours, len(points))))
    normals = np.asarray(cloud.normals)
    _, face, _, _ = ClosestPoint(posed.vertices, posed.faces).query(points)
    sides = np.sign((normals * posed.face_normals[face]).sum(axis=1))
    cloud.normals = o3d.utility.Vector3dVector(np.where(sides == 0.0, 1.0, sides)[:, None] * normals)
    # one thread: with more, equal inputs do not give equal surfaces
    mesh, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth, n_threads=1)
    if len(mesh.triangles) < LEAST_FACES:
        raise ValueError(f"Poisson reconstruction gives {len(mesh.triangles)} faces")
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.triangles)).without_unused()


def _thin_points(points: Array, most: int = MOST) -> Array:
    """The points, where they are too many the means of those that share a voxel."""
    size = float(np.ptp(points, axis=0).max()) / 400.0
    while len(points) > most:
        _, cell = np.unique(np.floor(points / size).astype(np.int64), axis=0, return_inverse=True)
        count = np.bincount(cell.ravel())
        if len(count) <= most:
            return np.column_stack([np.bincount(cell.ravel(), axis) / count for axis in points.T])
        size *= 1.1
    return points


def _find_believed(tree: ClosestPoint, points: Array, rest: Surface, reject: float) -> tuple[Array, Array]:
    """Mask of the points within median + reject * 1.48 MAD of the moved surface, and their feet on the
    surface at rest.
    """
    squared, face, _, bary = tree.query(points)
    distance = np.sqrt(squared)
    middle = float(np.median(distance))
    spread = 1.4826 * float(np.median(np.abs(distance - middle)))
    return distance <= middle + reject * spread, np.einsum(
        "nc,ncd->nd", bary, rest.vertices[rest.faces[face]]
    )


def _decimate_surface(surface: Surface) -> Surface:
    import open3d as o3d

    if len(surface.faces) <= COARSE_FACES:
        return surface
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(surface.vertices),
        o3d.utility.Vector3iVector(surface.faces.astype(np.int32)),
    )
    mesh = mesh.simplify_quadric_decimation(COARSE_FACES)
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.triangles))


def _add_third_axis(points: Array) -> Array:
    return np.column_stack([points, np.zeros((len(points), 3 - points.shape[1]))])


PEERS: Mapping[str, Peer] = {
    "thin-plate": thin_plate,
    "nricp_sumner": nricp_sumner,
    "pycpd": cpd,
    "open3d icp": open3d_icp,
    "poisson": poisson,
}
# what a peer may raise where a setting is not for a case
FAILURES = (np.linalg.LinAlgError, ValueError, RuntimeError)


def _list_settings(**values: tuple[object, ...]) -> list[dict[str, object]]:
    return [dict(zip(values, chosen, strict=True)) for chosen in product(*values.values())]


GRIDS: Mapping[str, list[dict[str, object]]] = {
    "thin-plate": _list_settings(
        kernel=("linear", "thin_plate_spline"),
        smoothing=(1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0),
        reject=(2.5, 4.0, 8.0),
    ),
    "nricp_sumner": _list_settings(
        smooth=(0.1, 1.0, 10.0, 100.0),
        landmarks=(1.0, 10.0, 100.0, 1000.0),
        reject=(2.5, 4.0, 8.0),
        rounds=(5,),
    ),
    "pycpd": _list_settings(
        moves=("points", "prior"),
        alpha=(0.1, 0.3, 1.0, 3.0, 10.0),
        beta=(0.15, 0.3, 0.6, 1.2),
        outliers=(0.1, 0.3),
    ),
    "open3d icp": _list_settings(
        reach=(1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 100.0),
        kernel=("none", "shrinking"),
        samples=(3000, 10000, 30000),
    ),
    "poisson": _list_settings(depth=(5, 6, 7, 8), neighbours=(8, 12, 20, 30, 60)),
}
NEEDS_TRIANGLES = ("nricp_sumner", "poisson")
NEEDS_PACKAGE = {"pycpd": "pycpd"}  # of the extra `bench`


def applicable(case: Case) -> list[str]:
    """Names of the peers that can work on the case and are installed; what is not is said on stderr."""
    missing = {name for name, package in NEEDS_PACKAGE.items() if find_spec(package) is None}
    for name in missing:
        print(f"{name} is not installed (pip install o3dls[bench]), left out", file=sys.stderr)
    fit = [name for name in PEERS if case.dimension == 3 or name not in NEEDS_TRIANGLES]
    return [name for name in fit if name not in missing]


def tuned() -> dict[str, dict[str, dict[str, Any]]]:
    """Settings by group and peer."""
    found: dict[str, dict[str, dict[str, Any]]] = json.loads(TUNED.read_text()) if TUNED.is_file() else {}
    return found


def pose_of(case: Case) -> Array:
    """The pose that every non-rigid method starts from: our robust similarity ICP."""
    return ICP()(case.visible(), start_estimate(case.visible())).T_map_prior


def cost(case: Case, surface: Surface) -> float:
    """Mean symmetric distance between a surface and the truth."""
    there, back = truth_distances(case, surface, SAMPLES)
    return float(there.mean() + back.mean()) / 2.0


def tune_peer(cases: list[tuple[Case, Array]], peer: str) -> dict[str, Any]:
    """The best of a peer's grid over the cases of one group."""
    settings = list(GRIDS[peer])
    costs = np.zeros(len(GRIDS[peer]))
    for k, (case, pose) in enumerate(cases):
        if k == 1:
            best = np.argsort(costs, kind="stable")[: max(1, int(KEPT * len(settings)))]
            settings = [settings[i] for i in best]
            costs = costs[best]
        costs = costs + np.array([_try_setting(case, pose, peer, setting) for setting in settings])
    winner = int(costs.argmin())
    return {
        "parameters": settings[winner],
        "cost": round(float(costs[winner]) / len(cases), 4),
        "tried": len(GRIDS[peer]),
        "cases": len(cases),
    }


def _try_setting(case: Case, pose: Array, peer: str, setting: Mapping[str, Any]) -> float:
    # a setting that fails has lost, and says so
    try:
        return cost(case, PEERS[peer](case, pose, **setting))
    except FAILURES as error:
        print(f"{case.name}: {peer} {setting}: {error}", file=sys.stderr)
        return float("inf")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["tune"])
    parser.add_argument("folders", nargs="+", type=Path, help="case folders, or folders of them")
    parser.add_argument(
        "--again", action="store_true", help="tune groups that benchmarks/tuned.json has already"
    )
    parser.add_argument("--peer", choices=PEERS, action="append", help="only these; default: all")
    arguments = parser.parse_args()
    listed = sorted(find(arguments.folders), key=lambda c: tuned_as(c.group))
    for group, members in groupby(listed, key=lambda c: tuned_as(c.group)):
        _tune_group(group, list(members), arguments.peer or list(PEERS), arguments.again)


def _tune_group(group: str, members: list[Listed], peers: list[str], again: bool) -> None:
    cases = [(case, pose_of(case)) for case in (m.read() for m in members)]
    for peer in applicable(cases[0][0]):
        if peer in peers and (again or peer not in tuned().get(group, {})):
            begin = perf_counter()
            found = tune_peer(cases, peer)
            print(f"{group}: {peer}: {found}, {perf_counter() - begin:.0f} s", flush=True)
            merged = tuned()
            merged.setdefault(group, {})[peer] = found
            TUNED.write_text(json.dumps(merged, indent=1, sort_keys=True) + "\n")


if __name__ == "__main__":
    main()
