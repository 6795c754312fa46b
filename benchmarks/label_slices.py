"""How near the surface of a label volume comes to the chamber, by thickness of the slices:
`python -m benchmarks.label_slices DATA` (the folder that holds real/kit_mri_to_eam).

Its prior and its closed truth are voxelised (a voxel is inside where its centre is) along three axes and
obliquely, each at several positions of the voxels, and read back.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from o3dls.arrays import Array
from o3dls.evaluation.distances import distances, occupancy, sample
from o3dls.geometry.surface import Surface
from o3dls.io.images.pieces import Mask, joined
from o3dls.io.images.wall import mask_surface, slices_first
from o3dls.io.surfaces import read_surface

SEED = 40_417
SAMPLES = 10_000
SPACINGS = ((1, 1, 1), (3, 3, 3), (0.78, 0.78, 1.5), (1, 1, 3), (1, 1, 5), (1, 1, 8), (1, 1, 10))  # mm


def orientations() -> list[Array]:
    """Three turns of the axes into each other and two oblique ones, (3, 3) each."""
    oblique = [np.linalg.qr(np.random.default_rng(SEED + k).normal(size=(3, 3)))[0] for k in (0, 1)]
    turns = [np.roll(np.eye(3), k, axis=0) for k in range(3)] + oblique
    return [turn * [1.0, 1.0, np.linalg.det(turn)] for turn in turns]


def voxelised(surface: Surface, spacing: Array, turn: Array, shift: Array) -> tuple[Mask, Array]:
    """Mask (nz, ny, nx) of the voxels whose centres a closed surface encloses, and its affine (4, 4); the
    columns of `turn` are the axes i, j, k, and `shift` (3,) moves the voxels, in voxels.
    """
    local = surface.with_vertices(surface.vertices @ turn)
    low = local.vertices.min(axis=0) - spacing * (1.0 + shift)
    counts = np.ceil((local.vertices.max(axis=0) - low) / spacing).astype(int) + 1
    axes = [a + h * np.arange(n) for a, h, n in zip(low, spacing, counts, strict=True)]
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = turn * spacing, turn @ low
    return np.ascontiguousarray(occupancy(local, axes).transpose(2, 1, 0)), affine


def read_back(mask: Mask, affine: Array) -> Surface:
    """As a file with this mask is read."""
    first, turned, spacing = slices_first(mask, affine)
    return mask_surface(joined(first, spacing)[0], turned)


def unsmoothed(mask: Mask, affine: Array) -> Surface:
    """The level half-way between the voxels of the mask as it is."""
    import open3d as o3d

    values = o3d.core.Tensor.from_numpy(np.pad(mask, 1).astype(np.float32))
    mesh = o3d.t.geometry.TriangleMesh.create_isosurfaces(values, [0.5])
    surface = Surface(mesh.vertex.positions.numpy() - 1.0, mesh.triangle.indices.numpy())
    return surface.transformed(affine)


def compared(found: Surface, truth: Surface) -> tuple[float, float]:
    """Volume off the truth's, relative, and mean distance in mm, half of it from each to the other."""
    there, back = (distances(sample(a, SAMPLES), b).mean() for a, b in ((found, truth), (truth, found)))
    return abs(found.volume) / truth.volume - 1.0, float(there + back) / 2.0


def chambers(data: Path) -> Iterator[tuple[str, Surface]]:
    """The prior of the kit case, and its truth with the openings closed."""
    import pymeshlab

    yield "MRI atrium, 128 ml", read_surface(data / "prior.ply")
    shell = read_surface(data / "truth.ply")
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(shell.vertices, shell.faces.astype(np.int32)))
    meshes.meshing_repair_non_manifold_vertices()
    meshes.meshing_close_holes(maxholesize=100, selfintersection=False)
    closed = meshes.current_mesh()
    yield "EAM shell, 174 ml", Surface(closed.vertex_matrix(), closed.face_matrix())


def row(truth: Surface, spacing: Array, positions: int) -> str:
    """Volume off the truth's, mean and worst, and off the labels' own; distance, mean and worst, and what no
    smoothing would give; seconds.
    """
    shifts = np.random.default_rng(SEED).uniform(size=(positions, 3))
    found, plain, kept, seconds = [], [], [], []
    for turn in orientations():
        for shift in shifts:
            volume = voxelised(truth, spacing, turn, shift)
            start = time.process_time()
            surface = read_back(*volume)
            seconds.append(time.process_time() - start)
            found.append(compared(surface, truth))
            kept.append(abs(surface.volume) / (volume[0].sum() * spacing.prod()) - 1.0)
            plain.append(compared(unsmoothed(*volume), truth))
    (volumes, gaps), without = np.array(found).T, np.array(plain)[:, 1]
    worst = volumes[np.abs(volumes).argmax()]
    return (
        f"{volumes.mean():+.1%} | {worst:+.1%} | {np.mean(kept):+.1%} | {gaps.mean():.2f} | "
        f"{gaps.max():.2f} | {without.mean():.2f} | {(gaps < without).sum()} of {len(gaps)} | "
        f"{np.mean(seconds):.1f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--positions", type=int, default=4, help="of the voxels, in each orientation")
    options = parser.parse_args()
    print(
        "| chamber | voxels (mm) | volume | at worst | off the labels' | distance (mm) | at worst "
        "| unsmoothed | nearer | s |"
    )
    print("|---" * 10 + "|")
    for name, truth in chambers(options.data / "real/kit_mri_to_eam"):
        for spacing in SPACINGS:
            text = " x ".join(map(str, spacing))
            print(
                f"| {name} | {text} | {row(truth, np.array(spacing, float), options.positions)} |", flush=True
            )


if __name__ == "__main__":
    main()
