"""A surface on a regular lattice: its signed distance near the wall, or in all that it encloses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import InputError
from ..geometry.surface import Surface
from .objects import surface_of

if TYPE_CHECKING:
    from ..levelset.grid.distance import SignedDistance

FEWEST_ACROSS, MOST_VOXELS = 10.0, 1e8  # limits of a volume: voxels along the diagonal, and in all
HALF_BAND = 3.0  # spacings on either side of the surface


@dataclass(frozen=True, eq=False)
class Voxels:
    """Voxels hold the signed distance of a surface on a box.

    phi (nx, ny, nz): distance at the centre of each voxel, in the surface's unit of length, negative inside;
    exact inside and up to the margin outside, cut there. spacing: size of a voxel; origin (3,): centre of
    the first one. In 2D arrays have an axis less.
    """

    phi: Array
    spacing: float
    origin: Array

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether the centre of each voxel lies inside, (nx, ny, nz)."""
        return np.asarray(self.phi < 0.0)

    @property
    def affine(self) -> Array:
        """The matrix (4, 4) that takes an index (i, j, k) to its voxel's centre, as that of NIfTI."""
        matrix = np.diag([self.spacing] * len(self.origin) + [1.0])
        matrix[:-1, -1] = self.origin
        return matrix


def signed_distance(surface: Any, spacing: float, *, width: float | None = None) -> SignedDistance:
    """Give the signed distance of a closed surface, on the nodes of a lattice that lie near it.

    Memory and time grow with the area of the surface, not with its volume.

    Parameters
    ----------
    surface : Surface, mesh of another library, or (vertices, faces)
        what `surface_of` takes; closed, lengths in mm. Parts that overlap are united.
    spacing : float, mm
        from one node of the lattice to the next; nodes lie on whole multiples of it.
    width : float, mm, default three spacings
        nodes up to this far from the surface are given.

    Returns
    -------
    SignedDistance
        `phi` (n,), mm, negative inside; `band.positions` (n, 3) of the nodes; `face` (n,), the closest one.

    Raises
    ------
    InputError
        where the surface is open, or the spacing or width does not suit its size.

    Examples
    --------
    >>> import o3dls
    >>> from o3dls.resources import demo_case
    >>> near = o3dls.signed_distance(o3dls.read_case(demo_case()).prior, 1.0, width=4.0)
    >>> bool(abs(near.phi).max() <= 4.0)
    True
    """
    from ..levelset.grid.distance import signed_distance

    wall = _check_suited(surface, spacing)
    reach = HALF_BAND * spacing if width is None else width
    if not spacing <= reach <= wall.diagonal:
        raise InputError(f"width = {reach:g}: must be between spacing = {spacing:g} and {wall.diagonal:.3g}")
    return signed_distance(wall.vertices, wall.faces, spacing, reach)


def voxelise(surface: Any, spacing: float, *, margin: int = 4) -> Voxels:
    """Give the voxels of a closed surface: what lies inside, and the signed distance.

    Parameters
    ----------
    surface : Surface, mesh of another library, or (vertices, faces)
        what `surface_of` takes; closed, lengths in mm. Parts that overlap are united.
    spacing : float, mm
        size of a voxel; centres lie on whole multiples of it.
    margin : int, voxels, default 4
        up to where outside the distance is exact; farther away it is margin times spacing.

    Returns
    -------
    Voxels
        `phi` (nx, ny, nz), mm, negative inside; `inside` (nx, ny, nz); `affine` (4, 4), index to mm.

    Raises
    ------
    InputError
        where the surface is open, or the spacing does not suit its size.

    Examples
    --------
    >>> import o3dls
    >>> from o3dls.resources import demo_case
    >>> voxels = o3dls.voxelise(o3dls.read_case(demo_case()).prior, 2.0)
    >>> volume = voxels.inside.sum() * voxels.spacing**3 / 1000.0  # ml
    """
    from ..levelset.grid.distance import filled_distance, signed_distance

    wall = _check_suited(surface, spacing)
    if margin < 1:
        raise InputError(f"margin = {margin} voxels: must be 1 or more")
    whole = filled_distance(wall.vertices, wall.faces, spacing, margin)
    # what lies obliquely outside is not within as many nodes of an inner one; both are on one lattice
    near = signed_distance(wall.vertices, wall.faces, spacing, margin * spacing)
    phi = np.full(whole.band.shape, margin * spacing)
    for found in (whole, near):
        phi[tuple(found.band.nodes.T)] = np.minimum(found.phi, margin * spacing)
    return Voxels(phi, spacing, whole.band.origin)


def spacing_mistake(surface: Surface, spacing: float) -> str | None:
    """Say why the spacing of a volume is too coarse or too fine for a surface, if it is."""
    if not 0.0 < spacing < np.inf:
        return f"spacing = {spacing:g}: must be above 0"
    voxels = float(np.prod(np.ptp(surface.vertices, axis=0) / spacing))
    if spacing <= surface.diagonal / FEWEST_ACROSS and voxels <= MOST_VOXELS:
        return None
    finest = spacing * (voxels / MOST_VOXELS) ** (1 / surface.dimension)
    coarsest = surface.diagonal / FEWEST_ACROSS
    between = f"a spacing between {finest:.2g} and {coarsest:.2g} would be right"
    return f"spacing = {spacing:g}: a volume of {voxels:.2g} voxels; {between}"


def _check_suited(thing: Any, spacing: float) -> Surface:
    """Return the surface of a thing that voxels of a size can show."""
    surface = surface_of(thing)
    if why := spacing_mistake(surface, spacing):
        raise InputError(why)
    return surface
