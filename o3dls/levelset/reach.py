"""From a moved prior to its refined level set: topology by evidence, corrections by evidence, and no tear or merger without it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..geometry import Array, Ints, Surface
from .closest import ClosestPoint
from .distance import SignedDistance, signed_distance
from .observe import Measured
from .operators import largest_piece, pieces, zero_set
from .reshape import reshape
from .solver import Correction, Limits, refine

HALF_BAND = 3.0  # half width of the band of phi, in spacings


@dataclass(frozen=True, eq=False)
class Reached:
    """A level set phi, the wall that it is the signed distance of (with fields per vertex), and how it was reached."""

    phi: SignedDistance
    wall: Surface
    sigma: float
    status: str
    converged: bool
    trace: tuple[Mapping[str, float], ...] = ()
    warnings: tuple[str, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)
    islands: bool = False  # whether pieces beside the largest belong to the result

    def faults(self, mesh: Surface) -> tuple[str, ...]:
        """What a mesh of phi has that the wall has not, as a warning; nothing where islands belong to the result."""
        found, meant = topology(mesh.vertices, mesh.faces), topology(self.wall.vertices, self.wall.faces)
        if found == meant or self.islands:
            return ()
        return (f"the mesh has pieces and Euler number {found}, the moved prior {meant}: where that runs into itself, walls are united",)


def reach(
    surface: Surface, observe: Callable[[Surface, SignedDistance], Measured], doubt: Array, limits: Limits, *, change: float
) -> Reached:
    """Refine a surface: changes of topology that earn `change` nats, then corrections along the normals.

    observe: the points as seen from a surface with its signed distance; doubt (v,): relative standard deviation that the motion leaves
    at every vertex. The result is the surface itself where there is nothing to add.
    """

    def seen(wall: Surface) -> Measured:
        return observe(wall, psi if wall.vertices is surface.vertices else band_of(wall, limits.spacing))

    psi = band_of(surface, limits.spacing)
    base, changes = reshape(surface, seen, spacing=limits.spacing, threshold=change)
    base = replace(base, fields=read_at(surface, {**surface.fields, "doubt": doubt}, base.vertices if changes else None))
    measured = seen(base)
    found = refine(base, measured, base.fields["doubt"], limits)
    wall, phi, warnings = _settled(base, found, limits.spacing, None if changes else psi)
    fields = {name: values for name, values in wall.fields.items() if name != "doubt"}
    status = "; ".join([*(c.sentence for c in changes), found.status])
    sigma = found.noise * float(np.median(measured.likelihood.sigma))
    facts = {"changes": [c.sentence for c in changes], "fields": [f.record for f in found.fields], "band_nodes": len(phi.band)}
    return Reached(phi, replace(wall, fields=fields), sigma, status, found.converged, found.trace, warnings, facts)


def band_of(surface: Surface, spacing: float) -> SignedDistance:
    """The signed distance of a surface on a band of the usual width."""
    return signed_distance(surface.vertices, surface.faces, spacing, HALF_BAND * spacing)


def read_at(surface: Surface, fields: Mapping[str, Array], points: Array | None) -> dict[str, Array]:
    """Fields per vertex read at the surface's closest points to `points` (n, d); as they are where these are the vertices (None)."""
    if points is None:
        return dict(fields)
    _, face, _, weights = ClosestPoint(surface.vertices, surface.faces).query(points)
    corners = surface.faces[face]
    return {name: np.asarray(np.einsum("nc,nc...->n...", weights, values[corners])) for name, values in fields.items()}


def _settled(
    base: Surface, found: Correction, spacing: float, psi: SignedDistance | None
) -> tuple[Surface, SignedDistance, tuple[str, ...]]:
    """The corrected wall and its level set: the correction is halved while it would tear or merge the surface, then the spacing.

    A wall that runs into itself all the same is united there; the mesh may still come out whole.
    """
    kind = topology(base.vertices, base.faces)
    for share in (1.0, 0.5, 0.25, 0.0) if found.fields else (0.0,):
        u = share * found.u
        wall = replace(base, vertices=base.vertices + u[:, None] * base.vertex_normals, fields={**base.fields, "correction": u})
        phi, same = _one_piece(psi if psi and not u.any() else band_of(wall, spacing), kind)
        if same:
            short = share < 1.0 and len(found.fields) > 0
            return wall, phi, (f"the correction was taken by {share:.0%}: more would tear or merge the surface",) * short
    fine, same = _one_piece(band_of(wall, 0.5 * spacing), kind)
    if same:
        return wall, fine, (f"lattice spacing halved to {0.5 * spacing:g}: at {spacing:g} the level set would merge walls",)
    return wall, phi, ()


def _one_piece(phi: SignedDistance, kind: tuple[int, int]) -> tuple[SignedDistance, bool]:
    """The level set without the shreds that a folded wall leaves, and whether its zero set is of the given kind."""
    vertices, faces = zero_set(phi.band, phi.phi)
    found = topology(vertices, faces)
    if kind[0] == 1 and found[0] > 1:
        piece = largest_piece(vertices, faces)
        phi, found = signed_distance(*piece, phi.band.spacing, phi.band.width), topology(*piece)
    return phi, found == kind


def topology(vertices: Array, faces: Ints) -> tuple[int, int]:
    """Pieces and Euler number of a closed surface (2 per piece without handles in 3D, 0 in 2D)."""
    used, index = np.unique(faces, return_inverse=True)
    count = len(np.unique(pieces(len(used), index.reshape(faces.shape))))
    return count, len(used) - (len(faces) // 2 if faces.shape[1] == 3 else len(faces))  # a triangle has half of three edges
