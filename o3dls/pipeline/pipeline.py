"""A pipeline folds stages over a case.

Each makes an estimate from an earlier one, and every estimate is kept and scored.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, Self

import numpy as np

from ..case import Case
from ..errors import InputError, PipelineError, SolverError
from ..estimate import Estimate
from ..evaluation.trusted_landmarks import contradiction_of_landmarks
from ..plugins.stage import Stage
from ..run_warning import RunWarning, each_once, of_stage
from ..runs.far_points import warned_of_far_points
from ..runs.run import Run
from ..runs.scoring import scored
from ..runs.writers import Writer
from .cross_validation import Folds, ending, too_many
from .doubts import doubtful_points
from .mistakes import mistakes
from .start import (
    components_without_points,
    doubtful_pose,
    misfit,
    pose_unknown,
    say_unpaired,
    start_digest,
    start_estimate,
)

START = "start"
# what the log says at the end of a stage and of a fold, and at the beginning of a file
STEPS = ("%s: %s (%.2f s)", "fold %d of %d: %d points left out", "writing %s")
log = logging.getLogger("o3dls")


@dataclass(frozen=True)
class Pipeline:
    """A pipeline has stages in order, writers of what the run shall leave behind, and the number of folds.

    The folds are of the cross-validation (0: none). A run ends with an earlier estimate where left-out points
    clearly prefer it, unless `keep_last`. `case` and `out` are folders, and only needed where `run` and
    `write` are not told. Raises PipelineError with every mistake.
    """

    stages: Sequence[Stage]
    writes: Sequence[Writer] = ()
    case: Path | None = field(default=None, kw_only=True)
    out: Path | None = field(default=None, kw_only=True)
    folds: int = field(default=5, kw_only=True)
    keep_last: bool = field(default=False, kw_only=True)
    # digest of the case whose start `allowed_by` has already found to be sound
    sound_start: str = field(default="", kw_only=True, compare=False, repr=False)

    def __post_init__(self) -> None:
        for name, kind in (("stages", Stage), ("writes", Writer)):
            object.__setattr__(self, name, tuple(getattr(self, name)))
            if wrong := [thing for thing in getattr(self, name) if not isinstance(thing, kind)]:
                raise PipelineError(f"{name}: {wrong[0]!r} is none: give a list of them, such as [ICP()]")
        for name in ("case", "out"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, Path(getattr(self, name)))
        if found := mistakes(self.stages, self.writes, self.names, self.folds, self.keep_last):
            raise PipelineError(*found)

    @property
    def names(self) -> list[str]:
        """Names of the estimates in order, `start` first."""
        return [START, *(stage.estimate_name for stage in self.stages)]

    @property
    def steps(self) -> int:
        """How many lines of a run's log, those of STEPS, say how far it is."""
        return len(self.stages) + self.folds + len(self.writes)

    @property
    def sources(self) -> dict[str, str]:
        """The estimate that each stage starts from, by the name of its own."""
        return {
            stage.estimate_name: stage.after or before
            for stage, before in zip(self.stages, self.names, strict=False)
        }

    def fitted(self, name: str) -> tuple[str, ...]:
        """Return types of the points that an estimate, or one that it started from, was given."""
        chain = self.chain(name)
        return tuple(
            sorted({kind for stage in self.stages if stage.estimate_name in chain for kind in stage.fits})
        )

    def chain(self, name: str) -> list[str]:
        """Return an estimate and those that it started from, back to `start`."""
        return [name, *self.chain(self.sources[name])] if name in self.sources else [name]

    def run(self, case: Case | None = None, pool: Executor | None = None) -> Run:
        """Fit, cross-validate and score; `pool`: a process for some folds, and nothing else afterwards.

        Raises InputError where the case cannot be fitted so, SolverError where a stage fails.
        """
        from ..parallel import compiling_said  # imported late: who only checks a file needs no numba

        with compiling_said():
            return self._run_case(case or self._own_case(), pool)

    def _run_case(self, case: Case, pool: Executor | None) -> Run:
        from ..adapters.decimation import with_refit_prior, with_working_prior
        from ..parallel import started_beside

        begin = perf_counter()
        case, reduction = with_working_prior(case)
        self._check_case(case)
        say_unpaired(case)
        for writer in self.writes:
            started_beside(writer.prepare)
        refit = partial(self.fit, level=logging.DEBUG)
        folds = Folds(refit, with_refit_prior(case), self.folds, pool) if self.folds else None
        estimates = _warned(self._fit_and_judge(case), reduction)
        for warning in each_once(one for estimate in estimates.values() for one in estimate.warnings):
            log.warning("%s", warning.sentence, extra={"kind": warning.kind})
        left_out = folds.left_out() if folds else {}
        if pool:
            pool.shutdown(wait=False)  # not waited for: a process takes its time to end
        corrected = estimates[self.names[-1]].corrected(case)
        chain = self.chain(self.names[-1])[:-1]
        run = scored(
            corrected,
            estimates,
            fitted={name: self.fitted(name) for name in estimates},
            left_out=left_out,
            pipeline=self.record(),
        )
        faulty = {name for name in chain if run.faults_of(name)}
        final, warnings = ending(chain, left_out, corrected, faulty, keep_last=self.keep_last)
        for warning in warnings:
            log.warning("%s", warning.sentence, extra={"kind": warning.kind})
        run = replace(run, estimates=_warned(run.estimates, warnings))
        made_in = run.provenance.model_copy(update={"seconds": perf_counter() - begin})
        run = warned_of_far_points(replace(run, ends_with=final))
        return replace(run, provenance=made_in, out=self.out, additions=self.writes)

    def judged(self, case: Case) -> dict[str, Estimate]:
        """Return the estimates of `fit` with the warnings on the start, which every estimate depends on.
        Raises InputError and SolverError as `run`.
        """
        self._check_case(case)
        return self._fit_and_judge(case)

    def _fit_and_judge(self, case: Case) -> dict[str, Estimate]:
        return self._with_start_warnings(case.visible(), self.fit(case))

    def _check_case(self, case: Case) -> None:
        if why := self.refusals(case):
            raise InputError("; ".join(why))

    def fit(self, case: Case, level: int = logging.INFO) -> dict[str, Estimate]:
        """Return estimates by name, `start` first.

        Each stage is given the points that it fits, and neither truth nor held-out data.
        """
        estimates = {START: start_estimate(case.visible())}
        for stage in self.stages:
            begin, name = perf_counter(), stage.estimate_name
            source = estimates[self.sources[name]]
            log.debug("%s: %s", name, stage.record())
            estimate = stage(source.corrected(case).visible(stage.fits), source)
            if not np.isfinite(estimate.T_map_prior).all():
                raise SolverError(f"{name}: the pose found is not finite")
            seconds = perf_counter() - begin
            warnings = of_stage(estimate.warnings, name)
            estimates[name] = replace(estimate, seconds=seconds, warnings=warnings)
            log.log(level, "%s: %s (%.2f s)", name, estimate.status, seconds)
        return estimates

    def _with_start_warnings(self, case: Case, estimates: dict[str, Estimate]) -> dict[str, Estimate]:
        """Return the estimates with the warnings on their common start, which every one of them depends
        on.
        """
        found = doubtful_pose(case, estimates[START], self.sound_start) if self._knows_pose else []
        final = estimates[self.names[-1]]
        found += components_without_points(case, final.T_map_prior)
        found += contradiction_of_landmarks(case)
        found += doubtful_points(case, estimates[START], final)
        found += [RunWarning("values-missing", f"points: {note}") for note in case.points.notes]
        found += [RunWarning("landmark-names-doubtful", said) for said in case.landmark_doubts()]
        common = of_stage(found, START)
        return {name: replace(one, warnings=(*common, *one.warnings)) for name, one in estimates.items()}

    def record(self) -> dict[str, Any]:
        """Return the pipeline with every default written out, shaped as its file.

        Without folders, which say nothing of the result.
        """
        return {
            "folds": self.folds,
            "keep_last": self.keep_last,
            "stage": [stage.record() for stage in self.stages],
            "write": [writer.record() for writer in self.writes],
        }

    def refusals(self, case: Case) -> list[str]:
        """Return why a run on the case would end before any work, one sentence each."""
        plugins = (*self.stages, *self.writes)
        found = [
            f"{plugin.name}: {why}"
            for plugin in plugins
            if (why := plugin.obstacle(case) or plugin.mistake(case))
        ]
        found += too_many(case, self.folds)
        found += misfit(case, start_estimate(case), pose_is_known=self._knows_pose)
        return [f"case {case.name}: {why}" for why in found]

    @property
    def _knows_pose(self) -> bool:
        return not any(stage.finds_pose for stage in self.stages)

    def allowed_by(self, case: Case) -> Self:
        """Return the pipeline without the stages and writers that cannot work on the case, and beginning with
        `global_pose` where nothing else gives the pose.

        The log names each one that is skipped or added.
        """
        for plugin in (*self.stages, *self.writes):
            if why := plugin.obstacle(case):
                log.info("Skipping '%s': %s", plugin.name, why)
        stages = [stage for stage in self.stages if not stage.obstacle(case)]
        if unknown := self._knows_pose and pose_unknown(case):
            from ..stages.global_pose import GlobalPose

            log.info(
                "Adding 'global_pose': neither 3 landmark pairs nor an init matrix give a start, and the "
                "points do not lie on the prior"
            )
            stages = [GlobalPose(), *stages]
        writes = [writer for writer in self.writes if not writer.obstacle(case)]
        sound = start_digest(case) if self._knows_pose and not unknown else ""
        return replace(self, stages=stages, writes=writes, sound_start=sound)

    def _own_case(self) -> Case:
        from ..io.case_reader import read_case

        if self.case is None:
            raise InputError('the pipeline names no case: give one to run(), or set case = "folder"')
        return read_case(self.case)


def _warned(estimates: Mapping[str, Estimate], warnings: Sequence[RunWarning]) -> dict[str, Estimate]:
    """Return the estimates, each with further warnings."""
    return {name: replace(one, warnings=(*one.warnings, *warnings)) for name, one in estimates.items()}
