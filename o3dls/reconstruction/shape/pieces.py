"""From a reconstruction to its wall: phi on a lattice, without what points contradict, in one piece without
handles that they do not show, and its zero set.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import distance_transform_edt, find_objects, gaussian_filter, label

from ...arrays import Array, Ints, Mask
from ...geometry.components import components_and_euler
from ...geometry.surface import Surface
from ...levelset.grid.distance import around_zero
from ...levelset.grid.isosurface import zero_set
from ...levelset.grid.masks import gaps, widened
from ...levelset.grid.regularised import regularised
from ...levelset.repair import Mesher
from ...levelset.settings import LatticeSettings
from ...noise.contact import contact_density
from ..field.equations import floating
from ..field.reconstruction import Reconstruction
from ..neighbours import nearest
from ..points.point_density import PointDensity
from ..settings import ReconstructionSettings
from .handles import without_handles
from .surplus import surplus

EVEN = 0.8  # area of wall per node on it and squared spacing, for a surface of any direction


def reconstructed_wall(
    found: Reconstruction, settings: ReconstructionSettings, mesh: Mesher
) -> tuple[Surface, int, int]:
    """Return the wall of phi, one piece without handles but such as points show; how many parts were taken
    away, and how many pockets of the outside filled, because points contradict them.

    mesh: what will mesh phi. Where that has another topology, as where walls are closer than the lattice
    tells apart, the wall is a mesh of fewer faces than the zero set has.
    """
    prior, least = found.prior, LatticeSettings().least_outside * found.prior.spacing
    begun = phi = _on_lattice(found, settings)
    phi, removed = without_pinched_off(phi, found, settings)
    if found.template:
        phi, cut = without_surplus(phi, found, settings)
        removed += cut
    else:
        phi, removed = own_parts_kept(phi, found, settings)
    outside, filled = without_pinched_off(-phi, found, settings)
    phi = smooth_cuts(-outside, begun, settings.cut_smoothing)
    around = _around_wall(phi, 2)
    corner = prior.low + [side.start for side in around]
    density = PointDensity(found.wall.points, found.sigma, corner, prior.spacing, settings.handles)
    asked = settings.handles.least_cut * (found.radius / prior.spacing) ** 2
    phi[around] = without_handles(phi[around], density.log_likelihoods, settings.handles, least, asked)
    made = around_zero(phi, prior.spacing, prior.clip, prior.low)
    wall = Surface(*zero_set(made.band, made.phi))
    meshed = mesh(made)
    if components_and_euler(*meshed) != components_and_euler(wall.vertices, wall.faces):
        wall = regularised(wall, prior.spacing)
    return wall, removed, filled


def without_surplus(phi: Array, found: Reconstruction, settings: ReconstructionSettings) -> tuple[Array, int]:
    """Return phi without parts of a template that the map shows to be absent, and how many were taken
    away.
    """
    shown = found.wall.of(~floating(found.wall, found.prior, settings.splines))
    away, _ = surplus(phi, shown, found.prior, found.radius, found.between, settings.surplus)
    parts, cut = label(away)
    # a part that holds points known to be inside must be there
    there = np.unique(parts[tuple(_nearest_nodes(found.inside, found).T)])
    away &= ~np.isin(parts, there)
    least = LatticeSettings().least_outside * found.prior.spacing
    return np.where(away, np.maximum(-phi, least), phi), cut - int(np.count_nonzero(there))


def own_parts_kept(phi: Array, found: Reconstruction, settings: ReconstructionSettings) -> tuple[Array, int]:
    """Return phi with the lost parts of a patient's own anatomy put back, but for those that points
    contradict; and how many points contradict.

    A part is lost where the moved prior's inside is farther than `own_parts.reach` from the one piece of the
    new inside that is largest. Points contradict it if they are likelier on the new wall than on the moved
    prior's, as where they close its mouth, and none is known to be inside it.
    """
    prior, chosen = found.prior, settings.own_parts
    inside, own = _keep_largest(phi < 0.0), prior.box < 0.0
    reach = chosen.reach * prior.clip / prior.spacing
    parts, count = label(own & ~np.isfinite(gaps(inside, reach)))
    there = np.unique(parts[tuple(_nearest_nodes(found.inside, found).T)])
    node = _nearest_nodes(found.wall.points, found)
    kept, contradicted = phi.copy(), 0
    for k in range(1, count + 1):
        near = np.isfinite(gaps(parts == k, reach))
        if k not in there and _gain_over_prior(phi, found, near[tuple(node.T)]) > chosen.evidence:
            contradicted += 1
        else:
            lost = near & own
            kept[lost] = np.minimum(kept[lost], prior.box[lost])
    return kept, contradicted


def _keep_largest(mask: Mask) -> Mask:
    """Keep the largest piece of a mask."""
    pieces, count = label(mask)
    return mask if count < 2 else np.asarray(pieces == 1 + np.bincount(pieces[mask])[1:].argmax())


def _gain_over_prior(phi: Array, found: Reconstruction, rows: Mask) -> float:
    """Return by how many nats the points of a mask (n,) are likelier on the zero set of phi than on the moved
    prior's wall.
    """
    prior, contact, near = found.prior, found.contact, found.wall.of(rows)
    after = replace(prior, box=phi).at(near.points)

    def likely(distance: Array) -> float:
        fraction = contact.outlier_fraction
        touching = (1.0 - fraction) * contact_density(distance, near.noise**2)
        return float(np.log(touching + fraction * contact.outlier_density(distance)).sum())

    return likely(after) - likely(prior.at(near.points))


def smooth_cuts(phi: Array, before: Array, width: float) -> Array:
    """Return phi without the steps of the lattice where its sign was changed: there it is averaged over
    `width` nodes.
    """
    changed = (phi < 0.0) != (before < 0.0)
    if not changed.any():
        return phi
    far = int(4.0 * width + 0.5)  # nodes beyond which the average is not felt
    [there] = find_objects(changed.astype(np.int8))
    around = tuple(slice(max(0, side.start - far - 2), side.stop + far + 2) for side in there)
    changed, part = changed[around], phi[around]
    edge = widened(changed, 2) & widened(~changed, 2)
    near = 2.0 * np.median(np.abs(part[edge])) if edge.any() else 0.0
    smooth = phi.copy()
    smooth[around] = np.where(edge, gaussian_filter(np.clip(part, -near, near), width, radius=far), part)
    return smooth


def _on_lattice(found: Reconstruction, settings: ReconstructionSettings) -> Array:
    """Return phi on the box of the moved prior, where the prior or a point is near."""
    prior = found.prior
    phi = prior.box.copy()
    marked = np.zeros(phi.shape, dtype=bool)
    marked[tuple(_nearest_nodes(np.vstack([found.wall.feet, found.inside]), found).T)] = True
    reach = max(settings.around * prior.clip, settings.around_between * found.between)
    alone = settings.bare_between * found.between
    faded = alone + settings.fading * prior.clip
    gap = gaps(marked, max(reach, faded) / prior.spacing) * prior.spacing
    near = (np.abs(phi) < prior.clip) | (gap < reach)
    told = np.clip((faded - gap) / (faded - alone), 0.0, 1.0)
    phi += np.where(near, told * found.field.on_box(prior.low, phi.shape, prior.spacing), 0.0)
    # the box ends outside, or the wall would stay open there: far from points the field may say anything
    least = LatticeSettings().least_outside * prior.spacing
    ends = np.pad(np.zeros(np.subtract(phi.shape, 2), dtype=bool), 1, constant_values=True)
    phi[ends] = np.maximum(phi[ends], least)
    return phi


def _nearest_nodes(points: Array, found: Reconstruction) -> Ints:
    """Return the indices (n, 3) in the box of the nodes nearest to points."""
    inside = np.round(points / found.prior.spacing).astype(np.int64) - found.prior.low
    return np.asarray(np.clip(inside, 0, np.array(found.prior.box.shape) - 1))


def without_pinched_off(
    phi: Array, found: Reconstruction, settings: ReconstructionSettings
) -> tuple[Array, int]:
    """Return phi without pinched-off veins: parts that hang on the rest by a thin neck or not at all and have
    room for many points, though hardly one lies on them, while the wall around the neck has some.
    """
    spacing = found.prior.spacing
    neck = float(np.clip(settings.neck * found.between, spacing, settings.widest_neck * found.radius))
    around = _around_wall(phi, int(np.ceil(neck / spacing)) + 2)
    whole, phi = phi, phi[around]
    inside = phi < 0.0
    core, parts = label(inside & (gaps(~inside, neck / spacing) * spacing > neck))
    if parts < 2:
        return whole, 0
    low = [side.start for side in around]
    sizes = np.bincount(core.ravel())
    sizes[0] = 0
    closest = distance_transform_edt(core == 0, return_distances=False, return_indices=True)
    part = np.where(inside, core[tuple(closest)], 0)
    wall = inside & widened(~inside)
    walls = np.bincount(part[wall], minlength=parts + 1)
    at = _nearest_nodes(found.wall.feet, found) - low
    near = _gaps_to_nearest(np.argwhere(wall), at) * spacing < settings.surplus.reach * found.between
    supported = np.bincount(part[wall][near], minlength=parts + 1) / np.maximum(walls, 1)
    expected = EVEN * spacing**2 * walls / found.between**2
    known = np.clip(_nearest_nodes(found.inside, found) - low, 0, np.array(part.shape) - 1)
    expected[part[tuple(known.T)]] = 0.0
    removed = 0
    whole = whole.copy()
    phi = whole[around]
    for k in range(1, parts + 1):
        if k == sizes.argmax() or expected[k] < settings.expected or supported[k] > settings.supported:
            continue
        mine = part == k
        joint = mine & widened(inside & ~mine)
        reach = (neck + found.between) / spacing
        if (
            not joint.any()
            or (_gaps_to_nearest(at, np.argwhere(joint)) < reach).sum() >= settings.around_neck
        ):
            phi[mine] = np.maximum(-phi[mine], LatticeSettings().least_outside * spacing)
            removed += 1
    return whole, removed


def _around_wall(phi: Array, margin: int) -> tuple[slice, ...]:
    """Return the part of a box that holds the zero set of phi and so many nodes around it."""
    enclosed = (phi < 0.0) != (phi[0, 0, 0] < 0.0)
    sides = []
    for axis in range(3):
        there = np.flatnonzero(enclosed.any(axis=tuple({0, 1, 2} - {axis})))
        first, last = (there[0], there[-1]) if len(there) else (0, 0)
        sides.append(slice(max(0, first - margin), last + margin + 1))
    return tuple(sides)


def _gaps_to_nearest(nodes: Ints, others: Ints) -> Array:
    """Return the distances (n,), in nodes, of nodes (n, 3) from the nearest of others (m, 3)."""
    return nearest(others.astype(np.float64), nodes.astype(np.float64), 1)[0][:, 0]
