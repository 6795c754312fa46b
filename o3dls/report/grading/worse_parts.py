"""Parts of the mapped wall that are clearly worse than the rest: what the pictures show dark."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from ...arrays import Array, Mask
from ...evaluation.interpolation import REACH
from ...evaluation.next_places import MEAN_OVER_SD
from ..subject import Subject
from ..surfaces.beliefs import BELIEVED, beliefs

WORSE = 2.0  # times the mean of the mapped wall: less is hardly seen in the pictures
APART = 2 * REACH  # mm from part to part
FEWEST = 3  # left-out points of a part
SHUFFLES, SEED = 200, 271_828
UNLIKELY = 0.05  # chance of any such part on a wall whose points are equally far off everywhere
MOST = 4000  # left-out points that are looked at, of a dense map
SMALLEST = 0.005  # of the wall: smaller parts by the model are rims of the wall without points


@dataclass(frozen=True, eq=False)
class WorsePart:
    """A worse part has a place (3,) on the wall, its error in mm, and by what that is known."""

    place: Array
    error: float
    known_by: str


@lru_cache(maxsize=1)  # pictures and answers name the same parts
def worse_parts(subject: Subject) -> list[WorsePart]:
    """Return the parts, the worst first; none in 2D and in pixels."""
    if subject.case.dimension == 2 or subject.unit != "mm":
        return []
    found = [*_worse_by_points(subject), *_worse_by_deviation(subject)]
    return sorted(found, key=lambda one: -one.error)


def _worse_by_points(subject: Subject) -> Iterator[WorsePart]:
    """List the parts where the mean distance of the left-out points within `REACH` of each other is at least
    twice that of all, and higher, in standard errors, than all but 5 % of the highest that arise where the
    same distances are dealt out to the points anew (a permutation test of the largest of all places).
    """
    xyz, gaps = _left_out_points(subject)
    near = _list_neighbours(xyz)
    if near.shape[0] == 0 or gaps.std() == 0.0:
        return
    count = near.sum(axis=1)
    rng = np.random.default_rng(SEED)
    dealt = np.column_stack([gaps, *(rng.permutation(gaps) for _ in range(SHUFFLES))])
    excess = (near @ dealt / count[:, None] - gaps.mean()) * np.sqrt(count)[:, None]
    highest = np.quantile(excess[:, 1:].max(axis=0), 1.0 - UNLIKELY)
    mean = near @ gaps / count
    worse = (excess[:, 0] > highest) & (mean >= WORSE * gaps.mean())
    middle = near @ xyz / count[:, None]
    vertices = subject.last.estimate.surface.vertices
    for k, _ in _choose_apart(middle, mean, worse):
        place = vertices[cKDTree(vertices).query(middle[k])[1]]
        yield WorsePart(place, float(mean[k]), f"at {int(count[k])} left-out points")


def _left_out_points(subject: Subject) -> tuple[Array, Array]:
    """Return positions (n, 3) and distances (n,) of left-out points that touch the wall, as far as the fit to
    all believes.
    """
    run, key = subject.last.run, subject.last.key
    gaps = run.points.columns.get(f"left_out_{key}_{subject.unit}", np.full(len(run.points), np.nan))
    known = (run.points.type == "eam") & np.isfinite(gaps) & ~(beliefs(run, key) < BELIEVED)
    step = max(1, -(-int(known.sum()) // MOST))
    return run.points.xyz[known][::step], gaps[known][::step]


def _list_neighbours(xyz: Array) -> sparse.csr_array:
    """Return a row (n,) for each point with enough others within `REACH`: 1 for each of these and itself."""
    if len(xyz) < FEWEST:
        return sparse.csr_array((0, len(xyz)))
    pairs = cKDTree(xyz).query_pairs(REACH, output_type="ndarray")
    itself = np.repeat(np.arange(len(xyz))[:, None], 2, axis=1)
    rows, columns = np.concatenate([pairs, pairs[:, ::-1], itself]).T
    near = sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(xyz), len(xyz)))
    return near[np.flatnonzero(near.sum(axis=1) >= FEWEST)]


def _worse_by_deviation(subject: Subject) -> Iterator[WorsePart]:
    """List the parts of the mapped wall where the model expects at least twice the error of the rest."""
    surface = subject.last.estimate.surface
    sd, far = (surface.fields.get(name) for name in (f"sd_{subject.unit}", "prior_only"))
    if sd is None or far is None:
        return
    area = np.where((far == 0) & np.isfinite(sd), surface.vertex_areas, 0.0)
    if not area.any():
        return
    error = MEAN_OVER_SD * np.nan_to_num(sd)
    worse = (area > 0) & (error >= WORSE * (area @ error) / area.sum())
    for k, part in _choose_apart(surface.vertices, error, worse):
        if area[part].sum() >= SMALLEST * surface.area:
            yield WorsePart(
                surface.vertices[k], float(np.average(error[part], weights=area[part])), "by the model"
            )


def _choose_apart(places: Array, value: Array, worse: Mask) -> Iterator[tuple[int, Mask]]:
    """Choose the worst of the places (n, 3) that are worse, each with those (n,) near it, then the worst of
    the rest, and so on.
    """
    while worse.any():
        k = int(np.where(worse, value, -np.inf).argmax())
        part = worse & (np.linalg.norm(places - places[k], axis=1) <= APART)
        yield k, part
        worse = worse & ~part
