"""What a clinic has of a patient: the map as an OpenEP file without a landmark, and the image's label volume
with thick slices that run askew.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from o3dls import Case, Surface

from .pose import matrix, under
from .shapes import Array

SPACING = np.array([1.0, 1.0, 5.0])  # mm: in a slice, and from one to the next
MARGIN = 3  # voxels around the atrium, across and along the slices


@dataclass(frozen=True, eq=False)
class Study:
    """Positions (n, 3) and values of the map in a frame of its own, the labels (nx, ny, nz) with the affine
    (4, 4) of their voxels in RAS, and the true wall in the frame of the map.
    """

    positions: Array
    bipolar: Array
    lat: Array
    labels: Array
    affine: Array
    truth: Surface


def study(case: Case, seed: int = 7) -> Study:
    """The study of a case in LPS: its map is turned into any pose, and its prior cut into slices."""
    rng = np.random.default_rng((seed, 90_127))
    turn, tilt = _rotation(rng, np.pi), _rotation(rng, np.radians(25.0))
    to_map = matrix(turn, rng.uniform(-80.0, 80.0, 3))
    points, truth = case.points.of("eam"), case.truth
    if truth is None or truth.surface is None:
        raise ValueError("the case has no true wall")
    labels, affine = _sliced(case.prior, tilt)
    return Study(
        under(to_map, points.xyz),
        points.numbers("bipolar"),
        points.numbers("lat"),
        labels,
        affine,
        truth.surface.with_vertices(under(to_map, truth.surface.vertices)),
    )


def write_study(folder: Path, found: Study) -> None:
    """Write `map.mat`, `la_labels.nii.gz` and `true_wall.ply`, which nothing but the score may see."""
    import nibabel
    from scipy.io import savemat

    from o3dls import write_surface

    folder.mkdir(parents=True, exist_ok=True)
    savemat(folder / "map.mat", {"userdata": _openep(found)}, do_compression=True, oned_as="column")
    image = nibabel.Nifti1Image(found.labels.astype(np.uint8), found.affine)  # type: ignore[no-untyped-call]
    image.header.set_xyzt_units("mm")  # type: ignore[no-untyped-call]
    nibabel.save(image, folder / "la_labels.nii.gz")
    write_surface(folder / "true_wall.ply", found.truth)


def _openep(found: Study) -> dict[str, Any]:
    """The map as OpenEP keeps it, without a shell."""
    n = len(found.positions)
    first = float(np.nanmin(found.lat))
    return {
        "notes": "synthetic, research software, not for clinical use",
        "electric": {
            "egmX": found.positions,
            "include": np.ones((n, 1)),
            "sampleFrequency": 1000.0,
            "voltages": {"bipolar": found.bipolar[:, None]},
            "annotations": {
                "mapAnnot": np.round(found.lat - first)[:, None] + 1.0,
                "referenceAnnot": np.full((n, 1), 1.0 - np.round(first)),
            },
        },
    }


def _rotation(rng: np.random.Generator, most: float) -> Array:
    """A rotation (3, 3) by half to all of an angle about any axis."""
    from scipy.spatial.transform import Rotation

    axis = rng.normal(size=3)
    return np.asarray(
        Rotation.from_rotvec(rng.uniform(0.5, 1.0) * most * axis / np.linalg.norm(axis)).as_matrix()
    )


def _sliced(prior: Surface, axes: Array) -> tuple[Array, Array]:
    """Labels (nx, ny, nz) of voxels along the columns of `axes` whose centres lie inside a surface in LPS,
    and their affine in RAS.
    """
    import open3d as o3d

    local = prior.vertices @ axes / SPACING
    low = np.floor(local.min(axis=0)).astype(int) - MARGIN
    shape = np.ceil(local.max(axis=0)).astype(int) + MARGIN + 1 - low
    affine = matrix(axes * SPACING, axes @ (low * SPACING))
    centres = under(affine, np.indices(tuple(shape)).reshape(3, -1).T)
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        o3d.core.Tensor(prior.vertices.astype(np.float32)), o3d.core.Tensor(prior.faces.astype(np.uint32))
    )
    inside = scene.compute_occupancy(o3d.core.Tensor(centres.astype(np.float32)), nthreads=1, nsamples=3)
    return inside.numpy().reshape(shape), np.diag([-1.0, -1.0, 1.0, 1.0]) @ affine
