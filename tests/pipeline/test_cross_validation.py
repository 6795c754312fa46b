"""Cross-validation: each point is left out once, with its neighbours, and refitted without."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from tiny import Nudge, Spy, ball_case, sphere

from o3dls import parallel
from o3dls.case import Case
from o3dls.errors import InputError, SolverError
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import distances
from o3dls.evaluation.left_out import LeftOut, blocks, fold_of, left_out_points
from o3dls.pipeline.cross_validation import Folds, cross_validate, ending, without
from o3dls.pipeline.outcome import outcome_of
from o3dls.pipeline.pipeline import Pipeline
from o3dls.pipeline.start import start_estimate
from o3dls.pipeline.workers import second_process, workers
from o3dls.report.subject import read_subject
from o3dls.runs.folder import read_run

FOLDS = 4
log = logging.getLogger("o3dls")


@pytest.mark.parametrize("count", [1, 2, 5, 12, 15])
def test_blocks_are_compact_equal_and_cover_everything(count: int) -> None:
    points = ball_case().points.of("eam").xyz
    found = blocks(points, np.arange(60), count)
    assert sorted(np.concatenate(found).tolist()) == list(range(60))
    assert len(found) == count
    assert max(map(len, found)) - min(map(len, found)) <= 1
    spread = np.mean(
        [np.linalg.norm(points[rows] - points[rows].mean(axis=0), axis=1).mean() for rows in found]
    )
    # the sphere's radius, shrinking as the share of its area does
    assert spread < 1.05 * 20.0 / np.sqrt(max(1, count / 3))


def test_folds_are_of_equal_size_and_repeat() -> None:
    points = ball_case(points=103).points.of("eam").xyz
    fold = fold_of(points, 5)
    assert np.ptp(np.bincount(fold)) <= 3  # one per block
    np.testing.assert_array_equal(fold, fold_of(points, 5))
    assert set(fold_of(points[:12], 5).tolist()) == set(range(5))


def test_neighbours_mostly_leave_together() -> None:
    points = ball_case(points=300).points.of("eam").xyz
    fold = fold_of(points, 5)
    nearest = np.argsort(np.linalg.norm(points[:, None] - points, axis=2), axis=1)[:, 1]
    assert (fold[nearest] == fold).mean() > 0.6  # of single points left out at random, a fifth


def test_every_fold_is_fitted_without_its_points_and_scored_on_them() -> None:
    case = ball_case()
    Spy.seen.clear()
    left_out = cross_validate(Pipeline([Spy(), Nudge()]).fit, case, FOLDS)
    eam = case.points.of("eam").xyz
    label = fold_of(eam, FOLDS)
    assert set(left_out) == {"start", "spy", "nudge"}
    for fold, seen in enumerate(Spy.seen):
        shown = {tuple(p) for p in seen.points.of("eam").xyz}
        assert shown == {tuple(p) for p in eam[label != fold]}
        refit = Pipeline([Nudge()]).fit(without(case, np.flatnonzero(label == fold)))["nudge"]
        np.testing.assert_allclose(
            left_out["nudge"].distance[label == fold], distances(eam[label == fold], refit.surface)
        )


def test_the_whole_run_reports_it_and_zero_folds_turn_it_off() -> None:
    case = replace(ball_case(), truth=None)
    assert Pipeline([Nudge()], folds=FOLDS).run(case).scores["nudge"]["cross_validated"]["n"] == 60
    run = Pipeline([Nudge()], folds=0).run(case)
    assert "cross_validated" not in run.scores["nudge"]
    assert "left_out_nudge_mm" not in run.points.columns


def test_a_left_out_point_has_the_deviation_that_the_fit_without_it_predicts() -> None:
    surface = sphere(20.0)
    sd = np.where(surface.vertices[:, 0] > 0.0, 3.0, 0.0)
    estimate = Estimate(replace(surface, fields={"sd_mm": sd}), np.eye(4), "found", sigma=4.0)
    xyz = np.array([[25.0, 0.0, 0.0], [-22.0, 0.0, 0.0]])
    found = left_out_points(xyz, estimate, "mm")
    np.testing.assert_allclose(found.distance, [5.0, 2.0], atol=0.2)
    np.testing.assert_allclose(found.deviation, [5.0, 4.0])  # of the wall, 3 or 0 mm, and of the noise
    unsure = left_out_points(xyz, replace(estimate, sigma=None), "mm")
    assert np.isnan(unsure.deviation).all()


def test_deviations_of_left_out_points_are_kept_where_there_is_a_posterior() -> None:
    run = Pipeline([Nudge()], folds=FOLDS).run(replace(ball_case(), truth=None))
    assert "left_out_sd_nudge_mm" not in run.points.columns


@pytest.mark.parametrize("kind", ["ablation", "landmark"])
def test_only_eam_points_are_left_out(kind: str) -> None:
    case = ball_case()
    rows = np.flatnonzero(case.points.type == "eam")[:5]
    assert len(without(case, rows).points.of(kind)) == len(case.points.of(kind))
    assert without(case, rows).truth is None


def test_a_fold_that_cannot_be_fitted_is_named() -> None:
    def picky(case: Case) -> dict[str, Estimate]:
        raise SolverError("too few points")

    with pytest.raises(
        SolverError,
        match=r"in fold 1 of 4 of .*, with 15 points left out: too few points; folds = 0 leaves it away",
    ):
        cross_validate(picky, ball_case(), FOLDS)


def test_there_are_no_more_folds_than_points() -> None:
    assert (
        Pipeline([Nudge()], folds=12).run(ball_case(points=12)).scores["nudge"]["cross_validated"]["n"] == 12
    )
    with pytest.raises(
        InputError, match="folds = 13: 12 points of type eam are there: must be at most 12, or 0"
    ):
        Pipeline([Nudge()], folds=13).run(ball_case(points=12))


@pytest.fixture(scope="module")
def pool() -> Iterator[Executor]:
    """A process beside this one, which has begun."""
    with workers(1, beside=1) as pool:
        pool.submit(int).result()
        yield pool


@dataclass(frozen=True)
class SlowHere:
    """A fit of Nudge that waits in the process that it was made in, so that the other does folds too."""

    process: int
    refused: bool = False  # in the other process
    ends: bool = False  # the other process

    def __call__(self, case: Case) -> dict[str, Estimate]:
        here = os.getpid() == self.process
        if here:
            time.sleep(0.2)
        elif self.ends:
            os._exit(1)
        elif self.refused:
            time.sleep(0.3)  # on a busy machine too the first fold is begun here before all are refused there
            raise SolverError("too few points")
        log.debug("fitted")
        return {"pid": start_estimate(case), "nudge": Nudge()(case, start_estimate(case))}


def test_a_second_process_does_folds_from_the_last_one_on_and_gives_the_same(
    pool: Executor, caplog: pytest.LogCaptureFixture
) -> None:
    case, fit = ball_case(), SlowHere(os.getpid())
    folds = Folds(fit, case, FOLDS, pool)
    with caplog.at_level(logging.DEBUG, "o3dls"):
        found = folds.left_out()
    assert FOLDS - 1 in folds._beside
    assert 0 not in folds._beside
    assert caplog.messages.count("fitted") == FOLDS  # -v prints what the other process says too
    assert sum(message.startswith("fold ") for message in caplog.messages) == FOLDS
    alone = cross_validate(fit, case, FOLDS)
    assert list(found) == list(alone)
    for name, gaps in alone.items():
        np.testing.assert_array_equal(found[name].distance, gaps.distance)


def test_a_fold_that_cannot_be_fitted_in_the_other_process_is_named(pool: Executor) -> None:
    folds = Folds(SlowHere(os.getpid(), refused=True), ball_case(), FOLDS, pool)
    with pytest.raises(SolverError, match=r"in fold [234] of 4 of .*15 points left out: too few points"):
        folds.left_out()


def test_a_fold_whose_process_is_ended_is_done_here() -> None:
    case = ball_case()
    with workers(1, beside=1) as pool:
        pool.submit(int).result()
        found = Folds(SlowHere(os.getpid(), ends=True), case, FOLDS, pool).left_out()
    for name, gaps in cross_validate(SlowHere(os.getpid()), case, FOLDS).items():
        np.testing.assert_array_equal(found[name].distance, gaps.distance)


def test_where_no_process_can_be_begun_one_does_all_and_a_batch_says_why(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")  # as of a /dev/shm that is root's alone

    monkeypatch.setattr("o3dls.pipeline.workers.ProcessPoolExecutor", refused)
    monkeypatch.setattr(parallel, "THREADS", 2)
    with second_process(FOLDS) as pool:
        assert pool is None
    with pytest.raises(InputError, match=r"Permission denied.*/dev/shm"), workers(2):
        pass


INTERRUPTED = """
from multiprocessing import get_context

def interrupt():
    from o3dls.pipeline.workers import workers
    with workers(1):
        raise SystemExit  # long before the process of the pool has begun

if __name__ == "__main__":
    child = get_context("spawn").Process(target=interrupt)
    child.start()
    child.join()
"""


def test_a_process_that_has_not_begun_when_its_parent_ends_says_nothing(tmp_path: Path) -> None:
    """As the engine of a live session that ends at once: Python takes its semaphores away as it ends."""
    (tmp_path / "interrupted.py").write_text(INTERRUPTED)
    done = subprocess.run([sys.executable, tmp_path / "interrupted.py"], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_there_is_a_second_process_only_for_folds_and_where_a_core_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(parallel, "THREADS", 1)
    with second_process(FOLDS) as pool:
        assert pool is None
    monkeypatch.setattr(parallel, "THREADS", 2)
    with second_process(0) as pool:
        assert pool is None
    with second_process(FOLDS) as pool:
        assert pool is not None


@pytest.mark.parametrize(("harm", "final"), [(0.6, "motion"), (0.01, "wall"), (-0.6, "wall")])
def test_a_run_ends_with_an_earlier_estimate_where_left_out_points_clearly_prefer_it(
    harm: float, final: str
) -> None:
    case = ball_case()
    count = int((case.points.type == "eam").sum())
    rng = np.random.default_rng(310_412)
    motion = np.abs(rng.normal(1.5, 0.3, count))
    chance = rng.normal(0.0, 0.3, count)
    wall = motion + harm + chance - chance.mean()
    gaps = {"start": motion + 5.0, "motion": motion, "wall": wall}
    left_out = {name: LeftOut(gap, np.full(count, np.nan)) for name, gap in gaps.items()}
    found, said = ending(["wall", "motion"], left_out, case)
    assert found == final
    assert [(one.code, one.stage) for one in said] == ([("stage-rejected", "wall")] if harm > 0.5 else [])
    assert ending(["wall", "motion"], {}, case) == ("wall", [])  # without folds nothing is rejected


def test_a_run_ends_with_no_surface_that_is_not_valid_where_its_last_one_is() -> None:
    case = ball_case()
    motion = np.abs(np.random.default_rng(310_414).normal(1.5, 0.3, int((case.points.type == "eam").sum())))
    gaps = {"motion": motion, "wall": 1.5 * motion}
    left_out = {name: LeftOut(gap, np.full(len(gap), np.nan)) for name, gap in gaps.items()}
    chain = ["wall", "motion"]
    assert ending(chain, left_out, case)[0] == "motion"
    kept, (why,) = ending(chain, left_out, case, {"motion"})
    assert (kept, why.code) == ("wall", "stage-kept")
    assert why.sentence.startswith("wall lies ")
    assert "farther from left-out points than motion (" in why.sentence  # by which a remedy names it
    assert "the surface of motion is not valid; compare the two" in why.sentence
    assert ending(chain, left_out, case, {"motion", "wall"})[0] == "motion"


@pytest.mark.parametrize(("harm", "final"), [(1.01, "wall"), (1.06, "motion")])
def test_what_is_as_much_farther_at_all_points_as_nobody_minds_stays(harm: float, final: str) -> None:
    """A mesh that was made anew lies a hundredth of a millimetre elsewhere: no chance, and nothing."""
    case = ball_case()
    motion = np.abs(np.random.default_rng(310_413).normal(1.5, 0.3, int((case.points.type == "eam").sum())))
    gaps = {"motion": motion, "wall": harm * motion}
    left_out = {name: LeftOut(gap, np.full(len(gap), np.nan)) for name, gap in gaps.items()}
    assert ending(["wall", "motion"], left_out, case)[0] == final


class Away(Nudge):
    """Moves what is right far off, and turns it inside out."""

    name: ClassVar[str] = "away"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        surface = start.surface.with_vertices(start.surface.vertices + 6.0)
        return replace(start, surface=replace(surface, faces=surface.faces[:, ::-1]))


def test_the_final_estimate_is_written_read_back_and_warned_of(tmp_path: Path) -> None:
    run = Pipeline([Nudge(), Away()], folds=4).run(ball_case())
    assert run.final == "nudge"
    assert "stage-rejected" in {warning.code for warning in run.estimates[run.final].warnings}
    again = read_run(run.write(tmp_path / "run"))
    assert again.final == "nudge"
    assert read_subject([tmp_path / "run"]).last.key == "nudge"
    assert run.faults_of("away")
    assert outcome_of(tmp_path / "run").faults == run.faults == []  # of what it ends with


def test_the_last_estimate_is_kept_where_the_pipeline_says_so_and_warned_of_all_the_same(
    tmp_path: Path,
) -> None:
    pipeline = Pipeline([Nudge(), Away()], folds=4, keep_last=True)
    run = pipeline.run(ball_case())
    assert run.final == "away"
    codes = {warning.code for warning in run.estimates["away"].warnings}
    assert "stage-kept" in codes
    assert "stage-rejected" not in codes
    again = read_run(run.write(tmp_path / "run"))
    assert again.final == "away"
    assert again.provenance.pipeline["keep_last"] is True
    assert outcome_of(tmp_path / "run").faults == run.faults != []
