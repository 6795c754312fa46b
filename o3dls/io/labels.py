"""Label volumes (NIfTI, NRRD, MetaImage) to surfaces: one chamber, sub-voxel, closed, in mm and LPS. Needs SimpleITK."""

from __future__ import annotations

import re
import zlib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, did_you_mean
from ..geometry import Array, Surface, apply
from .surface_file import SurfaceFile

MOST_VOXELS = 1 << 30
BLUR = 0.6  # of the coarsest spacing: takes the steps off the surface; what that shrinks is measured in the tests
Box = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, eq=False)
class Volume:
    """Labels (nz, ny, nx), or (nz, ny, nx, layers) where segments overlap; `affine` takes an index (i, j, k) to mm in LPS."""

    values: NDArray[Any]
    affine: Array
    spacing: Array
    space: str
    segments: dict[str, tuple[int, int]]  # name -> (layer, label)


def knows(data: bytes) -> bool:
    return data[:4] == b"NRRD" or b"NDims" in data[:400] or _nifti_header(data) is not None


def _nifti_header(data: bytes) -> bytes | None:
    """The 348 bytes of a NIfTI header, gzipped or not."""
    with suppress(zlib.error, OSError, EOFError):
        head = zlib.decompressobj(wbits=31).decompress(data[:20_000], 400) if data[:2] == b"\x1f\x8b" else data[:400]
        return head if head[344:348] in (b"n+1\0", b"ni1\0") else None
    return None


def read(path: Path, data: bytes, *, label: int | None = None, part: str | None = None, box: Box | None = None) -> SurfaceFile:
    """The closed surface of one label, or of the segment named `part`; everything outside `box` (x, y, z least, then most) is cut off.

    Only the largest connected piece is taken. Raises InputError where the label is not there, or must be said.
    """
    volume = load(path, data)
    values, label = _chosen(path, volume, label, part)
    mask = values == label
    if box is not None:
        mask &= _inside(mask.shape, volume.affine, box)
    mask, dropped = _largest(path, mask, label)
    surface = mask_surface(mask, volume.affine, volume.spacing)
    facts = {"label": label, "voxels": int(mask.sum()), "voxels_of_smaller_pieces": dropped}
    return SurfaceFile(surface, volume.space, "mm", facts)


def load(path: Path, data: bytes) -> Volume:
    """The volume with its geometry. Raises InputError where the file is damaged or does not state how it lies in space."""
    try:
        import SimpleITK as sitk
    except ImportError as error:
        raise InputError(f"{path}: label volumes need SimpleITK: pip install 'o3dls[images]'") from error
    space = _stated_space(path, data)
    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    try:
        reader.ReadImageInformation()
        if np.prod([float(n) for n in reader.GetSize()]) > MOST_VOXELS or reader.GetDimension() != 3:
            raise InputError(f"{path}: has size {reader.GetSize()}: must be a volume in 3D of at most {MOST_VOXELS} voxels")
        image = reader.Execute()
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise InputError(f"{path}: is no readable image: {reason[:200]}; it is truncated or damaged") from None
    spacing = np.array(image.GetSpacing())
    affine = np.eye(4)
    affine[:3, :3] = np.array(image.GetDirection()).reshape(3, 3) * spacing
    affine[:3, 3] = image.GetOrigin()
    if not np.isfinite(affine).all() or abs(np.linalg.det(affine)) < 1e-9:
        raise InputError(f"{path}: its spacing and direction span no volume: {affine[:3, :3].tolist()}")
    return Volume(sitk.GetArrayFromImage(image), affine, spacing, space, _segments(image))


def _stated_space(path: Path, data: bytes) -> str:
    """SimpleITK hands out LPS whatever the file holds; this tells where the file holds nothing."""
    if data[:4] == b"NRRD":
        return "LPS" if re.search(rb"^space:", data[:10_000], re.MULTILINE) else "unknown"
    header = _nifti_header(data)
    if header is not None and header[252:256] == b"\0\0\0\0":
        raise InputError(f"{path}: its header has neither qform nor sform, so it does not say how it lies in space; set one first")
    return "LPS"


def _segments(image: Any) -> dict[str, tuple[int, int]]:
    """Names of a Slicer segmentation with their layer and label."""
    found, k = {}, 0
    while image.HasMetaDataKey(f"Segment{k}_Name"):
        numbers = [
            image.GetMetaData(f"Segment{k}_{key}") if image.HasMetaDataKey(f"Segment{k}_{key}") else "" for key in ("Layer", "LabelValue")
        ]
        layer, label = (int(text) if text.strip().isdecimal() else default for text, default in zip(numbers, (0, 1), strict=True))
        found[image.GetMetaData(f"Segment{k}_Name")] = (layer, label)
        k += 1
    return found


def _chosen(path: Path, volume: Volume, label: int | None, part: str | None) -> tuple[NDArray[Any], int]:
    """The layer and the label in it that are meant; where nothing is said there must be one only."""
    layers = volume.values if volume.values.ndim == 4 else volume.values[..., None]
    if part is not None:
        if part not in volume.segments:
            raise InputError(f"{path}: has no segment '{part}'" + (did_you_mean(part, list(volume.segments)) if volume.segments else ""))
        layer, label = volume.segments[part]
        return layers[..., min(layer, layers.shape[-1] - 1)], label
    found = {k: _labels(path, layers[..., k]) for k in range(layers.shape[-1])}
    known = {value: k for k, values in found.items() for value in values}
    hint = f"; say --label (there are {', '.join(map(str, sorted(known)))})" + (
        f" or --part ({', '.join(volume.segments)})" if volume.segments else ""
    )
    if label is None:
        if sum(map(len, found.values())) != 1:
            raise InputError(f"{path}: holds {sum(map(len, found.values()))} labels" + hint)
        label = next(iter(known))
    if label not in known:
        raise InputError(f"{path}: has no label {label}" + hint)
    if sum(label in values for values in found.values()) > 1:
        raise InputError(f"{path}: label {label} is in several layers" + hint)
    return layers[..., known[label]], label


def _labels(path: Path, values: NDArray[Any]) -> list[int]:
    """Labels other than 0. Raises InputError for an image of grey values."""
    whole = values if values.dtype.kind in "iu" else values.astype(np.int64)
    if (whole != values).any():
        raise InputError(f"{path}: holds values that are no whole numbers; it is an image, not a label volume")
    found = np.unique(whole)
    if len(found) > 1000:
        raise InputError(f"{path}: holds {len(found)} different values; it is an image, not a label volume")
    return [int(value) for value in found if value != 0]


def _inside(shape: tuple[int, ...], affine: Array, box: Box) -> NDArray[np.bool_]:
    """Voxels whose centre lies in the box, (nz, ny, nx)."""
    k, j, i = np.indices(shape, sparse=True)
    inside = np.ones(shape, dtype=bool)
    for axis in range(3):
        position = affine[axis, 0] * i + affine[axis, 1] * j + affine[axis, 2] * k + affine[axis, 3]
        inside &= (position >= box[axis]) & (position <= box[axis + 3])
    return inside


def _largest(path: Path, mask: NDArray[np.bool_], label: int) -> tuple[NDArray[np.bool_], int]:
    """The largest piece, connected over faces, and how many voxels the others had."""
    from scipy.ndimage import label as connected

    pieces, n = connected(mask)
    if n == 0:
        raise InputError(f"{path}: no voxel of label {label} lies in the box")
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    return pieces == sizes.argmax(), int(sizes.sum() - sizes.max())


def mask_surface(mask: NDArray[np.bool_], affine: Array, spacing: Array) -> Surface:
    """Closed surface between the voxels of a mask (nz, ny, nx): the half-way level of the mask blurred just enough to hide its steps.

    Voxel centres are at whole indices. The mask is padded, so what leaves the volume is closed by a flat cap.
    """
    import open3d as o3d
    from scipy.ndimage import gaussian_filter

    sigma = BLUR * spacing.max() / spacing[::-1]
    pad = int(np.ceil(3 * sigma.max())) + 1
    low = np.maximum([axis.min() for axis in np.nonzero(mask)], 0)
    high = np.array([axis.max() for axis in np.nonzero(mask)]) + 1
    part = np.pad(mask[tuple(map(slice, low, high))], pad).astype(np.float32)
    smooth = np.ascontiguousarray(gaussian_filter(part, sigma))
    mesh = o3d.t.geometry.TriangleMesh.create_isosurfaces(o3d.core.Tensor.from_numpy(smooth), [0.5])
    indices = mesh.vertex.positions.numpy().astype(np.float64) + low[::-1] - pad
    surface = Surface(apply(affine, indices), mesh.triangle.indices.numpy())
    return surface if surface.volume > 0 else Surface(surface.vertices, surface.faces[:, ::-1])  # a mirroring affine turns it
