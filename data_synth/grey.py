"""Images as a scanner makes them of an atrium: blood, a wall of some thickness with values of its own as in
late enhancement, and what lies around, on voxels that may lie obliquely and be anisotropic.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3dls import Case, Surface, write_case

from .atrium import atrium
from .segmentation import solid
from .shapes import Array

CHUNK = 200_000  # voxels at one time
STREAM = 7919  # of the random numbers of an image, apart from those of its atrium
VOXEL = np.array([1.0, 1.0, 1.5])  # mm
SCARS, SCAR_SIZE = 3, 11.0  # patches of enhanced wall, and their radius in mm
HEALTHY, ENHANCED = 330.0, 520.0  # values of the wall: 1.1 and 1.7 times the blood's
NAME = "lge.nii.gz"


@dataclass(frozen=True, eq=False)
class Grid:
    """Voxels (ni, nj, nk) and the matrix from an index to mm in the frame of the surface."""

    shape: tuple[int, int, int]
    affine: Array

    @property
    def spacing(self) -> Array:
        return np.asarray(np.linalg.norm(self.affine[:3, :3], axis=0))

    def places(self) -> Array:
        """Centres (n, 3) of the voxels, the last axis running fastest."""
        index = np.indices(self.shape).reshape(3, -1).T
        return np.asarray(index @ self.affine[:3, :3].T + self.affine[:3, 3])


@dataclass(frozen=True)
class Tissue:
    """Values of blood and surroundings, thickness of the wall in mm, and noise (standard deviation)."""

    blood: float = 300.0
    around: float = 120.0
    thickness: float = 2.5
    noise: float = 12.0


def oblique_grid(rng: np.random.Generator, surface: Surface, spacing: Array, margin: float = 25.0) -> Grid:
    """A grid around a surface whose axes are turned at random, and no axis of the body's."""
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    axes = axes * np.sign(np.linalg.det(axes))
    along = surface.vertices @ axes
    low, high = along.min(axis=0) - margin, along.max(axis=0) + margin
    i, j, k = np.ceil((high - low) / spacing).astype(int).tolist()
    affine = np.eye(4)
    affine[:3, :3] = axes * spacing
    affine[:3, 3] = axes @ low
    return Grid((i, j, k), affine)


def late_enhancement(
    surface: Surface,
    grid: Grid,
    wall: Callable[[Array], Array],
    tissue: Tissue = Tissue(),
    rng: np.random.Generator | None = None,
) -> Array:
    """Values (ni, nj, nk): those of blood inside the surface, of `wall` at places (n, 3) within the thickness
    outside of it, and of what lies around beyond; noise where there is a generator.
    """
    shape, places = solid(surface), grid.places()
    values = np.empty(len(places))
    for start in range(0, len(places), CHUNK):
        at = places[start : start + CHUNK]
        distance = shape(at)
        within = (distance >= 0.0) & (distance <= tissue.thickness)
        chunk = np.where(distance < 0.0, tissue.blood, tissue.around)
        chunk[within] = wall(at[within])
        values[start : start + CHUNK] = chunk
    noise = 0.0 if rng is None else tissue.noise * rng.normal(size=len(values))
    return np.asarray((values + noise).reshape(grid.shape))


def scar_middles(rng: np.random.Generator, prior: Surface) -> Array:
    """Middles (n, 3) of the patches of a wall that are enhanced."""
    return np.asarray(prior.vertices[rng.choice(len(prior.vertices), SCARS, replace=False)])


def patchy(middles: Array) -> Callable[[Array], Array]:
    """Values of a wall at places (n, 3): enhanced in a patch about each middle, healthy elsewhere."""

    def wall(at: Array) -> Array:
        away = np.linalg.norm(at[:, None] - middles, axis=2).min(axis=1)
        return np.where(away < SCAR_SIZE, ENHANCED, HEALTHY)

    return wall


def enhanced(seed: int = 7) -> tuple[Case, Array, Grid]:
    """The atrium of a seed, whose prior is in LPS, and a late enhancement image (ni, nj, nk) of it on oblique
    voxels: three patches of its wall are enhanced.
    """
    rng = np.random.default_rng((seed, STREAM))
    case = atrium(seed)
    prior = case.prior
    middles = scar_middles(rng, prior)
    grid = oblique_grid(rng, prior, VOXEL)
    image = late_enhancement(prior, grid, patchy(middles), Tissue(), rng)
    return replace(case, prior_frame="LPS", image={"path": NAME}), image, grid


def write_enhanced(folder: Path, seed: int, *, force: bool = False) -> Case:
    """Write the case of `enhanced` with its image in the folder."""
    case, image, grid = enhanced(seed)
    write_case(folder, case, force=force)
    save_nifti(folder / NAME, np.clip(np.round(image), 0, 4095).astype(np.int16), grid)
    return case


def save_nifti(path: Path, values: NDArray[Any], grid: Grid) -> None:
    """Write values (ni, nj, nk) on a grid in LPS; NIfTI is in RAS."""
    import nibabel

    affine = np.diag([-1.0, -1.0, 1.0, 1.0]) @ grid.affine
    nibabel.save(nibabel.Nifti1Image(values, affine), path)  # type: ignore[no-untyped-call]
