"""What each vertex of an estimate's surface carries.

How far it moved, how sure that is, how near the data are.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..arrays import Array
from ..case import Case, Points
from ..estimate import Estimate
from ..evaluation.distances import moved
from ..evaluation.electrical import with_electrical
from ..evaluation.interpolation import REACH
from ..geometry.cut_wall import on_cut
from ..geometry.similarity import apply
from ..geometry.surface import Surface


def with_fields(case: Case, estimate: Estimate, fitted: Collection[str]) -> Surface:
    """Return the surface with what is known of each vertex, and its own fields.

    These are `displacement_mm`, `sd_mm` (where there is a posterior), `distance_to_nearest_point_mm`,
    `prior_only` (1 farther than `REACH` from every such point, and where the image ended), and the electrical
    values of the points carried to it (NaN where they are far).

    The points are those at the wall: eam, and ablation where these are among the types that were `fitted`.
    displacement is signed, outward positive: from the prior under `T_map_prior`, so it shows what a
    similarity cannot explain.
    """
    surface = _with_electrical(estimate.surface, case.points)
    unit = case.units
    gap = _distance_to_points(case.points.of("eam", *({"ablation"} & set(fitted))), surface)
    fields = {
        f"displacement_{unit}": displacement(case.prior, estimate),
        f"distance_to_nearest_point_{unit}": gap,
    }
    fields["prior_only"] = ((gap > REACH) | on_cut(surface)).astype(np.float64)
    if estimate.motion is not None and f"sd_{unit}" not in surface.fields:
        fields[f"sd_{unit}"] = estimate.motion.sd(on_prior(case.prior, estimate), surface.vertex_normals)
    return replace(surface, fields={**surface.fields, **fields})


@lru_cache(maxsize=1)  # estimates that follow each other may share their surface
def _with_electrical(surface: Surface, points: Points) -> Surface:
    return with_electrical(surface, points)


def displacement(prior: Surface, estimate: Estimate) -> Array:
    """Return the signed distance (n,) of the estimate's vertices from the prior under `T_map_prior`.

    Outward is positive.
    """
    rest = prior.with_vertices(apply(estimate.T_map_prior, prior.vertices))
    squared, face, foot, weights = rest.closest_point.query(estimate.surface.vertices)
    normal = np.einsum("nk,nkd->nd", weights, rest.vertex_normals[rest.faces[face]])
    return np.asarray(np.sqrt(squared) * np.sign(((estimate.surface.vertices - foot) * normal).sum(axis=1)))


def on_prior(prior: Surface, estimate: Estimate) -> Array:
    """Return the points (n, d) of the prior that came to lie nearest the estimate's vertices."""
    from ..geometry.closest_point import ClosestPoint

    _, face, _, weights = ClosestPoint(moved(estimate, prior.vertices), prior.faces).query(
        estimate.surface.vertices
    )
    return np.asarray(np.einsum("nk,nkd->nd", weights, prior.vertices[prior.faces[face]]))


def _distance_to_points(points: Points, surface: Surface) -> Array:
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(points.xyz).query(surface.vertices)[0])
