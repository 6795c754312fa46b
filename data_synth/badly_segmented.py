"""A patient's own atrium as a bad segmentation gives it: a vein cut short, another tube not there at all, and
the rest as thick voxels know it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from o3dls import Case, Surface, read_surface

from . import shapes, wall
from .chamber import Chamber, chamber
from .family import LANDMARKS, beaten, marked, named
from .mapping import Mapping, case_of, mapped
from .motion import turn
from .pose import matrix, under
from .sampling import Rows
from .shapes import Array, Shape
from .solid import meshed, sampled, solid
from .unvisited import told

VOXEL = np.array([1.25, 1.25, 2.5])  # mm, the last across the slices
CUT = (3.0, 6.0)  # mm beyond the body: what is left of the vein that is cut
NONE = 1.0  # and of the tube that is not there
BLUNT = 2.0  # mm over which a cut is rounded
SMOOTHED = 0.7  # voxels, of a mask before it is meshed
SPACING = 1.5  # mm between vertices of a remeshed prior
TILT = 0.4  # rad of the slices, at most
MARGIN = 3  # voxels around the atrium
NEAR = 1.5  # mm: where the prior is right, it lies that near to the whole anatomy


def badly_segmented(
    whole: Surface,
    seed: int = 7,
    *,
    family: str = "flow",
    landmarks: bool = True,
    how: Mapping | None = None,
    remeshed: bool = True,
) -> Case:
    """The case of a seed: the truth is a whole anatomy, moved as `family` does by a motion of strength 1, and
    mapped as `how` says; the prior is what `segmented` makes of the anatomy at rest.

    landmarks: four far places that the prior has right, L1 to L4, marked in the map within 2 mm; without them
    the start is a rigid pose that is off by 3 to 10 degrees and 3 to 10 mm.
    """
    how = how or Mapping(noise=1.5, clustered=False)
    beat, scanner, catheter, reader = np.random.default_rng((seed, 33_409)).spawn(4)
    prior, lost = segmented(reader, whole, remeshed=remeshed)
    after = beaten(whole, family, 1.0, beat, scanner)
    places = _right_places(whole, prior) if landmarks else np.zeros(0, dtype=np.int64)
    points, truth = mapped(catheter, after.wall, how, named(after.wall, places))
    said = f"{family}: seed {seed}, {after.left:.2f} mm rms after the best similarity, {lost}; {how}"
    start = marked(whole, places) if landmarks else after.rough
    found = points, replace(truth, surface=told(after.wall, chamber(after.wall)))
    return case_of(f"badly_segmented_{seed}", prior, found, start, said)


def segmented(rng: np.random.Generator, whole: Surface, *, remeshed: bool) -> tuple[Surface, str]:
    """The surface of a bad segmentation, and what is wrong with it in words. One of its tubes, drawn, is cut
    3 to 6 mm beyond the body and the one beside it is missing, as the appendage beside a left vein: the
    points there all lie off to one side, as those of a shifted part of the map would. Voxels measure
    1.25 x 1.25 x 2.5 mm along tilted axes, and are read as o3dls reads a label volume or, `remeshed`, as a
    smoothed mask is meshed.
    """
    parts = chamber(whole)
    left = dict(zip(_beside(rng, whole, parts), (float(rng.uniform(*CUT)), NONE), strict=False))
    field = sampled(_without(whole, parts, left), whole.vertices, VOXEL[0])
    axes = turn(rng, float(rng.uniform(0.0, TILT)))
    surface = _smooth(field, whole, axes) if remeshed else _read(field, whole, axes)
    said = ", ".join(f"tube {k} cut {depth:.1f} mm beyond the body" for k, depth in left.items())
    return wall.mended(wall.largest(surface)), f"{said}, " + ("remeshed" if remeshed else "a label volume")


def _beside(rng: np.random.Generator, whole: Surface, parts: Chamber) -> list[int]:
    """Numbers of a tube and of the one nearest to it; of the tube alone where there is no other."""
    middles = np.array([whole.vertices[parts.tube == k].mean(axis=0) for k in range(parts.tubes)])
    first = int(rng.integers(parts.tubes))
    return [int(k) for k in np.argsort(np.linalg.norm(middles - middles[first], axis=1))[:2]]


def _without(whole: Surface, parts: Chamber, left: dict[int, float]) -> Shape:
    """The anatomy without what tubes have beyond some depths (mm)."""
    inside, near = solid(whole), cKDTree(whole.vertices)

    def shape(p: Array) -> Array:
        row = near.query(p)[1]
        beyond = [
            np.where(parts.tube[row] == k, parts.depth[row] - depth, -np.inf) for k, depth in left.items()
        ]
        return shapes.intersection(inside, lambda _: np.max(beyond, axis=0), blend=BLUNT)(p)

    return shape


def _mask(shape: Shape, whole: Surface, axes: Array) -> tuple[Array, Array]:
    """Voxels (nx, ny, nz) whose centres a shape holds, 1 or 0, along the columns of `axes`, and the affine
    (4, 4) of their indices.
    """
    local = whole.vertices @ axes / VOXEL
    low = np.floor(local.min(axis=0)) - MARGIN
    size = (np.ceil(local.max(axis=0)) - low).astype(int) + MARGIN + 1
    affine = matrix(axes * VOXEL, axes @ (low * VOXEL))
    centres = under(affine, np.indices(tuple(size)).reshape(3, -1).T)
    return (shape(centres) < 0.0).astype(np.float64).reshape(size), affine


def _smooth(shape: Shape, whole: Surface, axes: Array) -> Surface:
    """The border of the voxels after a little smoothing, as most programs mesh a mask; of their distances,
    not of their values, which are flat wherever the border is not.
    """
    mask, affine = _mask(shape, whole, axes)
    out, inside = (ndimage.distance_transform_edt(mask == side, sampling=VOXEL) for side in (0.0, 1.0))
    soft = ndimage.gaussian_filter(np.asarray(out) - np.asarray(inside), SMOOTHED)
    back = np.asarray(np.linalg.inv(affine), dtype=np.float64)

    def level(p: Array) -> Array:
        return np.asarray(ndimage.map_coordinates(soft, under(back, p).T, order=1, mode="nearest"))

    return meshed(level, whole.vertices, SPACING)


def _read(shape: Shape, whole: Surface, axes: Array) -> Surface:
    """The voxels as a label volume, which o3dls reads."""
    import nibabel

    mask, affine = _mask(shape, whole, axes)
    ras = np.diag([-1.0, -1.0, 1.0, 1.0]) @ affine
    with TemporaryDirectory() as folder:
        path = Path(folder) / "labels.nii.gz"
        nibabel.save(nibabel.Nifti1Image(mask.astype(np.uint8), ras), path)  # type: ignore[no-untyped-call]
        return read_surface(path)


def _right_places(whole: Surface, prior: Surface) -> Rows:
    """Vertices (4,) of the anatomy for landmarks, where the prior has its wall."""
    gap = np.asarray(cKDTree(prior.vertices).query(whole.vertices)[0])
    return wall.far_places(whole, len(LANDMARKS), gap < NEAR)
