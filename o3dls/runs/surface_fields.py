"""What each vertex of an estimate's surface carries.

How far it moved, how sure that is, how near the data are.
"""

from __future__ import annotations

import logging
from collections.abc import Collection
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from ..arrays import Array
from ..case import Case, Points
from ..errors import InputError
from ..estimate import Estimate
from ..evaluation.distances import moved
from ..evaluation.electrical import with_electrical
from ..evaluation.interpolation import REACH
from ..evaluation.transfer import between
from ..evaluation.wall_image import Layer, values_on_wall
from ..geometry.cut_wall import on_cut
from ..geometry.similarity import apply
from ..geometry.surface import Surface
from ..io.grey.of_case import LABELS, open_kept_image

log = logging.getLogger("o3dls")


def with_fields(case: Case, estimate: Estimate, fitted: Collection[str]) -> Surface:
    """Return the surface with what is known of each vertex, and its own fields.

    These are `displacement_mm`, `sd_mm` (where there is a posterior), `distance_to_nearest_point_mm`,
    `prior_only` (1 farther than `REACH` from every such point, and where the image ended), the electrical
    values of the points carried to it (NaN where they are far), and `image_value` and `image_ratio` where the
    case has a grey image of its prior.

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
    return _with_image(case, estimate, replace(surface, fields={**surface.fields, **fields}))


def _with_image(case: Case, estimate: Estimate, surface: Surface) -> Surface:
    """Return the surface with the values of the case's image on its wall, carried by the motion."""
    if not case.image or case.image.get("shows") == LABELS:
        return surface
    on_wall = _image_on_prior(case)
    if on_wall is None:
        return surface
    return between(on_wall, surface, source_motion=partial(moved, estimate))


@lru_cache(maxsize=1)  # the estimates of a run share their case
def _image_on_prior(case: Case) -> Surface | None:
    """Return the prior with the values of the case's image; None where it has none that can be read, which
    goes to the log: a run is not lost for it.
    """
    try:
        return values_on_wall(open_kept_image(case), case.prior, Layer())[0]
    except InputError as error:
        log.warning("no values of the image on the wall: %s", error)
        return None


@lru_cache(maxsize=1)  # estimates that follow each other may share their surface
def _with_electrical(surface: Surface, points: Points) -> Surface:
    return with_electrical(surface, points)


def displacement(prior: Surface, estimate: Estimate) -> Array:
    """Return the signed distance (n,) of the estimate's vertices from the prior under `T_map_prior`.

    Outward is positive.
    """
    if estimate.only_posed(prior):
        return np.zeros(len(prior.vertices))
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
