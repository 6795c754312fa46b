"""A grey image of the prior (NIfTI, NRRD, MetaImage, a DICOM series): where it lies is read at once, its
voxels only where they are asked for.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...geometry.similarity import apply, inverse
from ..images import dicom, metaimage, nifti, nrrd
from ..images.layout import WHOLE, Grey, Layout, Volume, Window
from ..images.registry import checked, read_image
from ..images.sidecar import check_agreed
from ..images.voxels import Image, count
from ..kinds import kind_of
from ..text import read_bytes, read_head
from .overlap import check_size, settle_frame, share_inside
from .series import read_series

HEAD = 1_000_000  # bytes that are looked at for a header
WHOLE_PRIOR = 0.999  # share of its vertices: of fewer it is said
TAKES = "must be NIfTI, NRRD, MetaImage, or a folder with a DICOM series"


@dataclass(frozen=True, eq=False)
class Held:
    """A held volume is one whose file had to be read as a whole."""

    image: Image

    @property
    def shape(self) -> tuple[int, int, int]:
        k, j, i = self.image.values.shape
        return i, j, k

    @property
    def affine(self) -> Array:
        return self.image.affine

    @property
    def space(self) -> str:
        return self.image.space

    def check(self) -> None:
        """Do nothing: the reader has checked it."""

    def slab(self, low: int, high: int, window: Window = WHOLE) -> Grey:
        return np.asarray(self.image.values[(slice(low, high), *window)], dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Part:
    """A part of an image is held in memory: values (nk, nj, ni), and the affine of their indices."""

    values: Grey
    affine: Array

    def sample(self, points: Array, *, nearest: bool = False) -> Array:
        """Return the values (...) at points (..., 3), linear between the centres of voxels or those of the
        `nearest`; NaN outside.
        """
        from scipy.ndimage import map_coordinates

        index = apply(inverse(self.affine), points)[..., ::-1]
        size = np.array(self.values.shape)
        found = map_coordinates(
            self.values,
            np.moveaxis(index, -1, 0),
            order=0 if nearest else 1,
            mode="nearest",
            output=np.float64,
        )
        inside = ((index >= -0.5) & (index <= size - 0.5)).all(axis=-1)
        return np.where(inside, found, np.nan)


@dataclass(frozen=True, eq=False)
class GreyImage:
    """A grey image is a volume whose `affine` takes an index (i, j, k) to mm in the prior's frame, which is
    `frame` (LPS, RAS, or unknown).
    """

    path: Path
    volume: Volume
    affine: Array
    frame: str

    @property
    def spacing(self) -> Array:
        """Distances (3,) of the voxels along i, j, k."""
        return np.asarray(np.linalg.norm(self.affine[:3, :3], axis=0))

    def gap(self, vertices: Array) -> str | None:
        """Return a sentence on how little of a prior the image holds; None where it holds all of it."""
        share = share_inside(self.affine, self.volume.shape, vertices)
        if share >= WHOLE_PRIOR:
            return None
        return f"holds {share:.0%} of the prior's vertices: what lies outside of it has no values"

    def around(self, points: Array, margin: float = 0.0) -> Part:
        """Read the part around points (n, 3), with a margin in mm. Raises InputError where it cannot be read,
        or holds none of them.
        """
        index = apply(inverse(self.affine), points)
        reach = 1 + np.ceil(margin / self.spacing)
        low = np.maximum(np.floor(index.min(axis=0) - reach), 0).astype(int)
        high = np.minimum(np.ceil(index.max(axis=0) + reach) + 1, self.volume.shape).astype(int)
        if (high <= low).any():
            raise InputError(f"{self.path}: the image holds nothing of what is to be drawn on it")
        columns, rows = (slice(int(low[k]), int(high[k])) for k in (0, 1))
        values = self.volume.slab(int(low[2]), int(high[2]), (rows, columns))
        affine = self.affine.copy()
        affine[:3, 3] = apply(self.affine, low)
        return Part(np.ascontiguousarray(values), affine)


def open_image(path: Path, vertices: Array, prior_frame: str, *, whole: bool = True) -> GreyImage:
    """Open the image of a prior with vertices (n, 3) in mm in the frame `prior_frame`; its voxels are looked
    through where it is to be `whole`, and none is kept.

    Raises InputError where it is missing or damaged, and where the prior does not lie in it.
    """
    volume = open_volume(path)
    check_size(path, volume)
    frame, turn = settle_frame(path, volume, vertices, prior_frame)
    if whole:
        volume.check()
    return GreyImage(path, volume, turn @ volume.affine, frame)


def image_hash(path: Path) -> str:
    """Return the SHA-256 of an image's file, read piece by piece; of a folder, that of its slices' names and
    hashes. Raises InputError where it is not there.
    """
    if not path.is_dir():
        read_head(path, 1)
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    lines = [f"{image_hash(one)} {one.name}\n" for one in sorted(path.iterdir()) if dicom.is_dicom(one)]
    return hashlib.sha256("".join(lines).encode("utf-8", "replace")).hexdigest()


def open_volume(path: Path) -> Volume:
    """Open an image: how it lies, and its voxels where asked for. Raises InputError where it is none."""
    if path.is_dir():
        return _check_voxels(path, read_series(path))
    data = read_head(path, HEAD)
    if dicom.knows(data):
        raise InputError(f"{path}: is one file of DICOM: name the folder that holds the slices of the series")
    if not (nrrd.knows(data) or metaimage.knows(data) or nifti.knows(data)):
        what = kind_of(data)
        raise InputError(f"{path}: is {what if what else 'not an image that o3dls knows'}; it {TAKES}")
    read = nrrd if nrrd.knows(data) else metaimage if metaimage.knows(data) else nifti
    found: Layout | None = read.layout(path, data)
    if found is None:
        image = read_image(path, read_bytes(path))
        _check_one_volume(path, image.values.shape[::-1])
        return Held(image)
    _check_one_volume(path, found.sizes)
    return _check_voxels(path, found)


def _check_one_volume(path: Path, sizes: tuple[int, ...]) -> None:
    if len(sizes) != 3:
        raise InputError(
            f"{path}: has {len(sizes)} axes of {list(sizes)}: a grey image is one volume in 3D; save the "
            "phase or channel that the prior was segmented in as a file of its own"
        )


def _check_voxels(path: Path, volume: Volume) -> Volume:
    """Return the volume unchanged. Raises InputError where it has more voxels than any image of a heart, or
    of sizes that no scanner has, or a sidecar contradicts them.
    """
    count(path, list(volume.shape))
    no_values = np.broadcast_to(np.float32(0), volume.shape[::-1])
    check_agreed(path, checked(Image(no_values, volume.affine, volume.space), str(path)))
    return volume
