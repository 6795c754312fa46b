"""Fewer faces, by quadrics: of surfaces that are drawn, and of a prior with more faces than a fit can use."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..case import Case
from ..geometry.components import components_and_euler
from ..geometry.surface import Surface
from ..run_warning import RunWarning

MOST_FACES = 100_000  # of a prior: edges of .7 mm on an atrium, half of what a contact errs by
MOST_REFIT = 30_000  # of a prior that is only measured from: edges of 1.2 mm bow by .02 mm on an atrium


def reduced(surface: Surface, faces: int) -> Surface:
    """Return a surface in 3D of about so many faces, without fields; closed and of the same topology where
    the surface is closed.

    By quadrics (Garland and Heckbert 1997) without regard to the topology, which is quick; where it was lost,
    by a method that keeps it.
    """
    from fast_simplification import simplify

    vertices, corners = simplify(
        np.ascontiguousarray(surface.vertices), surface.faces.astype(np.int32), target_count=faces
    )
    small = Surface(np.asarray(vertices, dtype=np.float64), np.asarray(corners, dtype=np.int64))
    if surface.watertight and not (small.watertight and _have_one_topology(small, surface)):
        from .mending import decimated

        return decimated(replace(surface, fields={}), faces)
    return small


def _have_one_topology(one: Surface, other: Surface) -> bool:
    kinds = (components_and_euler(surface.vertices, surface.faces) for surface in (one, other))
    return next(kinds) == next(kinds)


def with_working_prior(case: Case) -> tuple[Case, tuple[RunWarning, ...]]:
    """Return the case with a prior of at most MOST_FACES faces, with its fields, and what was done; as it is
    where it has no more.
    """
    small = _with_fewer_faces(case, MOST_FACES)
    if small is case:
        return case, ()
    said = (
        f"the prior has {len(case.prior.faces)} faces, more than a fit can use: a copy with "
        f"{len(small.prior.faces)} was fitted, and every estimate has these; your file is not changed"
    )
    return small, (RunWarning("prior-reduced", said),)


def with_refit_prior(case: Case) -> Case:
    """Return the case as a refit of the cross-validation needs it: a patient's own prior has at most
    MOST_REFIT faces, since of the surface only the distances of points that were left out are kept. A
    template keeps its faces: what of its wall is changed can hang on them.
    """
    return _with_fewer_faces(case, MOST_REFIT) if case.prior_of == "patient" else case


def _with_fewer_faces(case: Case, most: int) -> Case:
    prior = case.prior
    if prior.dimension == 2 or len(prior.faces) <= most:
        return case
    from .meshing import carry_fields

    return replace(case, prior=carry_fields(prior, reduced(prior, most)))
