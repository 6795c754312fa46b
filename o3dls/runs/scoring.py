"""From estimates to a finished run: distances, validity, and how it all was made."""

from __future__ import annotations

import os
import platform
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from ..case import Case, Points
from ..estimate import Estimate
from ..evaluation.distances import SAMPLING_SEED, distances, landmark_errors, measure, summary, truth_scores
from ..evaluation.left_out import LeftOut
from ..evaluation.validity import validity
from ..geometry.surface import Surface
from .record import SCHEMA, CaseRecord, Provenance, plain
from .run import Record, Run

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
PACKAGES = ("o3dls", "numpy", "scipy", "open3d", "pymeshlab", "numba")


def scored(
    case: Case,
    estimates: Mapping[str, Estimate],
    *,
    fitted: Mapping[str, tuple[str, ...]],
    left_out: Mapping[str, LeftOut],
    pipeline: Record,
) -> Run:
    """Score the estimates by name and judge their surfaces: their run.

    fitted: by estimate, the types of the points that it was shown; left_out: by estimate, how the eam points
    lie to what was fitted without them; pipeline: its record, with every default written out.
    """
    from ..parallel import both  # imported late: who only checks a file needs no numba

    estimates = _share_surfaces(estimates)
    # pymeshlab, of which validity is made, works on one core; distances are compiled loops on the other
    judged, scores = both(
        lambda: _judge_surfaces(case, estimates),
        lambda: {
            name: score_sets(case, e, fitted[name], left_out.get(name)) for name, e in estimates.items()
        },
    )
    return Run(
        case=case,
        estimates=estimates,
        fitted=fitted,
        scores=scores,
        validity=judged,
        points=with_distances(case, estimates, left_out),
        held_out=with_held_out(case, estimates),
        provenance=provenance(case, pipeline),
    )


def _judge_surfaces(case: Case, estimates: Mapping[str, Estimate]) -> dict[str, Record]:
    """Return the validity of each estimate's surface; the shape of one, and of the prior, is judged once."""
    found: dict[Surface, Record] = {}
    posed: Record | None = None
    for estimate in estimates.values():
        surface = estimate.surface
        if surface in found:
            continue
        as_prior = estimate.only_posed(case.prior)
        known = next(
            (found[other] for other in found if _same_wall(surface, other)), posed if as_prior else None
        )
        found[surface] = validity(surface, case.prior, case.units, known)
        posed = posed or (found[surface] if as_prior else None)
    return {name: found[estimate.surface] for name, estimate in estimates.items()}


def _share_surfaces(estimates: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """Return the estimates; one whose stage moved nothing gets the surface of the one before, so that what is
    worked out of a surface is worked out once.
    """
    found: dict[str, Estimate] = {}
    before: Surface | None = None
    for name, estimate in estimates.items():
        same = before is not None and _same_surface(before, estimate.surface)
        found[name] = replace(estimate, surface=before) if same and before is not None else estimate
        before = found[name].surface
    return found


def _same_wall(a: Surface, b: Surface) -> bool:
    return np.array_equal(a.vertices, b.vertices) and np.array_equal(a.faces, b.faces)


def _same_surface(a: Surface, b: Surface) -> bool:
    return (
        _same_wall(a, b)
        and a.fields.keys() == b.fields.keys()
        and all(np.array_equal(values, b.fields[name], equal_nan=True) for name, values in a.fields.items())
    )


def score_sets(
    case: Case, estimate: Estimate, fitted: tuple[str, ...], left_out: LeftOut | None = None
) -> dict[str, Record]:
    """Return the summaries of an estimate's distances by set, and its scores against the truth; `fitted` are
    the types of the points that it was shown.
    """
    sets = measure(case, estimate, fitted) | (
        {} if left_out is None else {"cross_validated": left_out.distance}
    )
    scores: dict[str, Record] = {name: summary(values, case.units) for name, values in sets.items()}
    if case.truth is not None and case.truth.surface is not None:
        scores["truth"] = truth_scores(sets, estimate.surface, case.truth.surface, case.units)
    return scores


def with_distances(case: Case, estimates: Mapping[str, Estimate], left_out: Mapping[str, LeftOut]) -> Points:
    """Return the case's points with their distance to every estimate; a landmark's is that to its moved
    partner.
    """
    columns = dict(case.points.columns)
    marks, eam = case.points.type == "landmark", case.points.type == "eam"
    paired = list(case.landmark_partners())
    for name, estimate in estimates.items():
        gap = distances(case.points.xyz, estimate.surface)
        gap[marks] = np.nan
        gap[paired] = landmark_errors(case, estimate)
        columns[f"distance_{name}_{case.units}"] = gap
        if name in left_out:
            whole = LeftOut.unknown(len(case.points))
            whole.fill(eam, left_out[name])
            columns[f"left_out_{name}_{case.units}"] = whole.distance
            if np.isfinite(whole.deviation).any():
                columns[f"left_out_sd_{name}_{case.units}"] = whole.deviation
    return replace(case.points, columns=columns)


def with_held_out(case: Case, estimates: Mapping[str, Estimate]) -> Points | None:
    """Return the held-out points with their distance to every estimate; None where there are none."""
    truth = case.truth
    if truth is None or truth.held_out is None:
        return None
    columns: dict[str, Any] = {} if truth.unseen is None else {"unseen": truth.unseen.astype(int)}
    columns |= {
        f"distance_{name}_{case.units}": distances(truth.held_out, e.surface) for name, e in estimates.items()
    }
    return Points(truth.held_out, np.full(len(truth.held_out), "eam"), columns)


def provenance(case: Case, pipeline: Record) -> Provenance:
    """Return how a run was made: its case, the record of the pipeline, versions, seeds, threads."""
    image: dict[str, Any] = {"image": dict(case.image)} if case.image else {}
    return Provenance(
        schema=SCHEMA,
        case=CaseRecord(
            **{key: getattr(case, key) for key in ("name", "units", "frame", "dimension", "prior_of")},
            points=dict(sorted(Counter(case.points.type.tolist()).items())),
            columns=dict(case.columns),
            **image,
            files=dict(sorted(case.files.items())),
        ),
        pipeline=plain(pipeline),
        versions={"python": platform.python_version(), **{name: version_of(name) for name in PACKAGES}},
        seeds={"surface_samples": SAMPLING_SEED},
        threads={"processors": os.cpu_count(), **{name: os.environ.get(name) for name in THREADS}},
        seconds=0.0,  # until the run is whole
    )


def version_of(package: str) -> str | None:
    """Return the version of an installed package, None where it is not."""
    for name in (package, f"{package}-cpu"):  # open3d-cpu imports as open3d
        try:
            return version(name)
        except PackageNotFoundError:
            continue
    return None
