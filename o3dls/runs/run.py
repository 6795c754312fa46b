"""A finished run: every estimate with its scores and its validity, and how it all was made."""

from __future__ import annotations

import logging
import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..case import Case, Points
from ..estimate import Estimate
from ..evaluation.distances import SAMPLING_SEED, distances, landmark_errors, measure, summary, truth_scores
from ..evaluation.validity import faults, validity

if TYPE_CHECKING:
    from ..pipeline.pipeline import Pipeline

log = logging.getLogger("o3dls")
PACKAGES = ("o3dls", "numpy", "scipy", "open3d", "pymeshlab", "numba")
Record = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Run:
    """Estimates by name (`start` first), their scores by set and their validity.

    points: the case's points with a column `distance_<estimate>_mm` for each estimate, and
    `left_out_<estimate>_mm` from the cross-validation; held_out: the held-out points likewise. provenance:
    versions, seeds, threads and the record of the pipeline; pipeline itself is None where the run was read
    from its folder.
    """

    case: Case
    pipeline: Pipeline | None
    estimates: Mapping[str, Estimate]
    scores: Mapping[str, Mapping[str, Record]]
    validity: Mapping[str, Record]
    provenance: Record
    points: Points
    held_out: Points | None = None

    @classmethod
    def scored(
        cls, case: Case, pipeline: Pipeline, estimates: Mapping[str, Estimate], left_out: Mapping[str, Array]
    ) -> Run:
        """Score estimates and judge their surfaces; `left_out` are the cross-validated distances of the eam
        points.
        """
        return cls(
            case=case,
            pipeline=pipeline,
            estimates=estimates,
            scores={
                name: _scores(case, e, pipeline.fitted(name), left_out.get(name))
                for name, e in estimates.items()
            },
            validity={name: validity(e.surface, case.prior, case.units) for name, e in estimates.items()},
            points=_with_distances(case, estimates, left_out),
            held_out=_held_out(case, estimates),
            provenance=provenance(pipeline),
        )

    @property
    def final(self) -> str:
        """Name of the estimate that the run ends with."""
        return list(self.estimates)[-1]

    @property
    def unit(self) -> str:
        """Unit of lengths in the names of scores and columns."""
        return self.case.units

    @property
    def faults(self) -> list[str]:
        """Why the final surface is not valid, one sentence each; empty where it is."""
        return self.faults_of(self.final)

    def faults_of(self, name: str) -> list[str]:
        """Why the surface of an estimate is not valid; `start` is the prior in another pose, so its faults
        are the prior's.
        """
        return faults(
            self.validity[name],
            self.validity["start"],
            reshaped=bool(self.estimates[name].facts.get("changes")),
        )

    def __str__(self) -> str:
        from .tables import score_table

        return score_table(self)

    def write(self, folder: str | Path | None = None, *, force: bool = False) -> Path:
        """Write the run folder, whole or not at all, with what the pipeline's writers add. Raises InputError
        where it exists.
        """
        from .folder import write_run

        return write_run(self, folder, force=force)


def _scores(
    case: Case, estimate: Estimate, fitted: tuple[str, ...], left_out: Array | None
) -> dict[str, Record]:
    sets = measure(case, estimate, fitted) | ({} if left_out is None else {"cross_validated": left_out})
    scores: dict[str, Record] = {name: summary(values, case.units) for name, values in sets.items()}
    if case.truth is not None and case.truth.surface is not None:
        scores["truth"] = truth_scores(sets, estimate.surface, case.truth.surface, case.units)
    return scores


def _with_distances(case: Case, estimates: Mapping[str, Estimate], left_out: Mapping[str, Array]) -> Points:
    """The case's points with their distance to every estimate; a landmark's is that to its moved partner."""
    columns = dict(case.points.columns)
    marks, eam = case.points.type == "landmark", case.points.type == "eam"
    names = columns.get("name", np.full(len(case.points), "")).tolist()
    paired = [k for k, name in enumerate(names) if marks[k] and name in case.prior_landmarks]
    for name, estimate in estimates.items():
        gap = distances(case.points.xyz, estimate.surface)
        gap[marks] = np.nan
        gap[paired] = landmark_errors(case, estimate)
        columns[f"distance_{name}_{case.units}"] = gap
        if name in left_out:
            column = np.full(len(case.points), np.nan)
            column[eam] = left_out[name]
            columns[f"left_out_{name}_{case.units}"] = column
    return replace(case.points, columns=columns)


def _held_out(case: Case, estimates: Mapping[str, Estimate]) -> Points | None:
    truth = case.truth
    if truth is None or truth.held_out is None:
        return None
    columns: dict[str, Any] = {} if truth.unseen is None else {"unseen": truth.unseen.astype(int)}
    columns |= {
        f"distance_{name}_{case.units}": distances(truth.held_out, e.surface) for name, e in estimates.items()
    }
    return Points(truth.held_out, np.full(len(truth.held_out), "eam"), columns)


def provenance(pipeline: Pipeline) -> Record:
    """What a reader needs to make the run again: the pipeline with every default, versions, seeds,
    threads.
    """
    threads = {
        name: os.environ.get(name)
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
    }
    return {
        "pipeline": pipeline.record(),
        "versions": {"python": platform.python_version()} | {name: _version(name) for name in PACKAGES},
        "seeds": {"surface_samples": SAMPLING_SEED},
        "threads": {"processors": os.cpu_count(), **threads},
    }


def _version(package: str) -> str | None:
    for name in (package, f"{package}-cpu"):  # open3d-cpu imports as open3d
        try:
            return version(name)
        except PackageNotFoundError:
            continue
    return None
