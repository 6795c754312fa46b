"""A run folder keeps how the posterior's errors go together: a run read back proposes what the run did."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from o3dls import Deform, InputError, Pipeline, read_run, suggest
from o3dls.case import Case
from o3dls.runs.run import Run
from tests.chamber import chamber, measured
from tests.finished import finished


def sparse() -> Case:
    """A chamber that was stretched since it was imaged, with few points."""
    return measured(chamber(20), np.diag([1.0, 1.15, 0.95, 1.0]), 60, noise=1.0)


@pytest.fixture(scope="module")
def run() -> Run:
    return Pipeline([Deform()], folds=0).run(sparse())


@pytest.fixture
def folder(run: Run, tmp_path: Path) -> Path:
    return run.write(tmp_path / "run")


def test_a_run_read_back_proposes_the_same(run: Run, folder: Path) -> None:
    again = read_run(folder)
    first = suggest(run.case, run.estimates["deform"], 3).places
    found = suggest(again.case, again.estimates["deform"], 3).places
    assert len(first) == 3
    for a, b in zip(first, found, strict=True):
        # the folder keeps six digits, of modes and of surfaces
        assert np.allclose(a.xyz, b.xyz, atol=1e-3)
        assert (a.before, a.after, a.gain) == pytest.approx((b.before, b.after, b.gain), rel=1e-4)


def test_equal_runs_keep_equal_bytes(run: Run, folder: Path, tmp_path: Path) -> None:
    other = run.write(tmp_path / "other")
    name = "estimates/deform/posterior.npy"
    assert (folder / name).read_bytes() == (other / name).read_bytes()
    assert name in (folder / "manifest.txt").read_text(encoding="utf-8")


def test_a_damaged_posterior_is_refused(folder: Path) -> None:
    path = folder / "estimates/deform/posterior.npy"
    whole = path.read_bytes()
    path.write_bytes(whole[:-100])
    with pytest.raises(InputError, match=r"posterior\.npy: is damaged"):
        read_run(folder)
    np.save(path, np.full((4, 3), 1e9))
    with pytest.raises(InputError, match="must have a vertex of the prior"):
        read_run(folder)
    np.save(path, np.array(["text"]))
    with pytest.raises(InputError, match="is damaged"):
        read_run(folder)


def test_a_run_read_back_gives_the_same_samples(run: Run, folder: Path) -> None:
    first, found = run.estimates["deform"], read_run(folder).estimates["deform"]
    samples, again = (one.samples(6, seed=7_312) for one in (first, found))
    # the folder keeps the surface with six digits
    assert np.allclose(samples.vertices, again.vertices, atol=1e-3)
    assert np.allclose(first.covariance(), found.covariance(), atol=1e-3)
    assert samples.vertices.std(axis=0).max() > 0.5


def test_a_run_read_back_and_written_again_keeps_the_same_posterior(folder: Path, tmp_path: Path) -> None:
    other = read_run(folder).write(tmp_path / "other")
    name = "estimates/deform/posterior_rows.npz"
    assert (folder / name).read_bytes() == (other / name).read_bytes()
    assert name in (other / "manifest.txt").read_text(encoding="utf-8")


def test_a_run_of_an_earlier_version_is_read_and_says_that_it_has_no_samples(folder: Path) -> None:
    (folder / "estimates/deform/posterior_rows.npz").unlink()
    found = read_run(folder).estimates["deform"]
    with pytest.raises(InputError, match="no posterior in space; run a pipeline with the stage 'deform'"):
        found.samples(3)


def test_damaged_rows_of_a_posterior_are_refused(folder: Path) -> None:
    path = folder / "estimates/deform/posterior_rows.npz"
    whole = path.read_bytes()
    with np.load(path) as arrays:
        kept = dict(arrays)
    for damaged in (whole[:-100], whole[: len(whole) // 2], b"", b"PK\x03\x04", whole[:200] + whole[260:]):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"posterior_rows\.npz: is damaged"):
            read_run(folder)
    np.savez(path, **{**kept, "at": kept["at"][:-1]})
    with pytest.raises(InputError, match=r"is damaged \(errors has another shape"):
        read_run(folder)
    np.savez(path, **{**kept, "sds": np.array(["text"])})
    with pytest.raises(InputError, match=r"is damaged \(it holds what is no number"):
        read_run(folder)


def test_a_motion_without_joint_posterior_keeps_none(tmp_path: Path) -> None:
    folder = finished(tmp_path / "run")
    assert not list(folder.glob("estimates/*/posterior*.np*"))
    again = read_run(folder)
    with pytest.raises(InputError, match="no joint posterior"):
        suggest(again.case, again.estimates["level_set"])
