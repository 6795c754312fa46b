"""What the stages `level_set` and `paper_level_set` share: points as an estimate left them, the mesh of what
was reached, and the estimate that it makes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..case import FITTED_TYPES, Case
from ..estimate import Estimate
from ..geometry.similarity import rms_radius
from ..geometry.surface import Surface

if TYPE_CHECKING:
    from ..adapters.meshing import Extraction
    from ..levelset.result import Result
    from ..motion.result import MotionFit
    from ..reconstruction.points.believed import Believed


@dataclass(frozen=True, eq=False)
class GivenPoints:
    """These points may touch the wall, and `of_mapping` turns their probabilities of contact (n,) into those
    of the mapping points.
    """

    believed: Believed
    of_mapping: Callable[[Array], Array]


def given_points(case: Case, start: Estimate) -> GivenPoints:
    """Return the points as a motion left them; where none was fitted, as they lie off the surface of the
    start.
    """
    template = case.prior_of == "template"
    if start.fit is None:
        return _off_surface(case, start.surface, template=template)
    fit = start.fit
    return GivenPoints(believed(fit, template=template), lambda weights: _of_mapping(fit, weights))


def believed(fit: MotionFit, *, template: bool) -> Believed:
    """Return the points that may touch the wall as the motion left them, and those that are known to be
    inside.

    template: whether the prior is one (`prior_of`).
    """
    from ..reconstruction.points.believed import Believed, Inside

    data, state = fit.problem.data, fit.state
    wall = ~data.inside
    noise, points, stretch = state.scales.noises[data.group] * data.relative, data.points, None
    if fit.drift is not None:  # where points were without the errors that they share
        offsets, left = fit.drift.offsets()
        # what is left of these does not average out among the points that share it
        sharing = 2.0 * min(fit.drift.settings.shifts)
        noise, points = np.sqrt(noise**2 + sharing * left), points - offsets
        stretch = (data.place_in_order[wall] // max(fit.drift.settings.shifts)).astype(np.int64)
    inside = Inside(points[~wall], noise[~wall])
    touching = points[wall], state.weights[wall], noise[wall], data.outlier_odds[wall]
    return Believed(*touching, state.contact, inside, template, fit.motion.doubt, stretch)


def _of_mapping(fit: MotionFit, weights: Array) -> Array:
    """Return the probabilities of contact (k,) of the mapping points, of those of all points that may
    touch.
    """
    wall = ~fit.problem.data.inside
    every = fit.state.weights.copy()
    every[wall] = weights
    return replace(fit, state=replace(fit.state, weights=every)).weights


def _off_surface(case: Case, surface: Surface, *, template: bool) -> GivenPoints:
    """Return the points with the noise and the outliers that their distances from a surface tell."""
    from ..noise.contact import Contact
    from ..noise.duplicates import distinct_places, duplicate_distance
    from ..noise.mixture import fit_mixture
    from ..noise.settings import ContactSettings
    from ..reconstruction.points.believed import Believed, Inside
    from ..topology.wall import Wall

    every = case.points.of(*FITTED_TYPES)
    radius = rms_radius(case.prior.vertices)
    within = duplicate_distance(every.xyz, every.type, radius)
    rows, place = distinct_places(every.xyz, every.type, within)
    points, relative = every.select(rows), every.relative_noise()[rows]
    wall = points.type != "inside"
    found = fit_mixture(Wall(surface).look(points.xyz[wall])[0], radius)
    contact = Contact.expected(radius, ContactSettings())
    contact = replace(contact, outlier_fraction=found.outlier_fraction)
    noise = found.sigma * relative
    inside = Inside(points.xyz[~wall], noise[~wall])
    odds = np.ones(len(found.weights))
    touching = points.xyz[wall], found.weights, noise[wall], odds

    def of_mapping(weights: Array) -> Array:
        of_place = np.zeros(len(points))
        of_place[wall] = weights
        return np.asarray(of_place[place[every.type == "eam"]])

    return GivenPoints(Believed(*touching, contact, inside, template), of_mapping)


def meshed(reached: Result, spacing: float, smoothing: int, keep: float) -> tuple[Result, Extraction]:
    """Return the mesh of what was reached, and its phi as a distance everywhere; a wall that is a valid mesh
    stays as it is.

    smoothing: Taubin passes; keep: fraction of the isosurface's faces that decimation keeps.
    """
    from ..adapters.meshing import Extraction, extract, isosurface
    from ..levelset.grid.distance import signed_distance
    from ..levelset.settings import LatticeSettings

    if reached.valid:
        return reached, Extraction(reached.wall, 0.0, 0.0, len(reached.wall.faces))
    raw = reached.wall if reached.exact else None
    mesh = extract(
        reached.phi,
        smoothing=smoothing,
        keep=keep,
        islands=reached.islands,
        smallest=reached.smallest,
        raw=raw,
    )
    if reached.warnings and not reached.exact:  # phi is no distance where gaps were closed or parts cut
        width = max(LatticeSettings().half_band * spacing, reached.phi.band.width)
        reached = replace(reached, phi=signed_distance(*isosurface(reached.phi), spacing, width))
    return reached, mesh


def estimate_of(start: Estimate, reached: Result, mesh: Extraction) -> Estimate:
    """Return the start with the mesh of what was reached; the motion, its fit and the weights stay."""
    from ..adapters.meshing import carry_fields

    shifts = {"meshing_shift_mean": mesh.shift_mean, "meshing_shift_max": mesh.shift_max}
    source = reached.wall if reached.fields is None else start.surface
    surface = source if reached.valid else carry_fields(source, mesh.surface)
    if reached.fields is not None:
        surface = replace(surface, fields={**surface.fields, **reached.fields(surface.vertices)})
    changes = [*start.facts.get("changes", []), *reached.facts.get("changes", [])]
    return replace(
        start,
        surface=surface,
        status=reached.status,
        converged=reached.converged,
        iterations=max(len(reached.trace) - 1, 0),
        sigma=start.sigma if reached.sigma is None else _all_errors(start, reached.sigma),
        phi=reached.phi,
        trace=reached.trace,
        facts={**reached.facts, "changes": changes, **shifts},
    )


def _all_errors(start: Estimate, noise: float) -> float:
    """Return the deviation of all errors of the points: their own noise, and what they have in common."""
    together = np.zeros(0) if start.fit is None else start.fit.state.scales.drift_sds
    return float(np.hypot(noise, np.linalg.norm(together)))


def with_existence(surface: Surface, points: Believed) -> Surface:
    """Return the surface with the field `existence`: how likely there is wall, by the points."""
    from ..reconstruction.points.existence import existence
    from ..reconstruction.settings import ReconstructionSettings

    between = float(np.sqrt(surface.area / len(points.points)))
    likely = existence(surface.vertices, points, between, ReconstructionSettings())
    return replace(surface, fields={**surface.fields, "existence": likely})
