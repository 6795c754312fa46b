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


def test_a_motion_without_joint_posterior_keeps_none(tmp_path: Path) -> None:
    folder = finished(tmp_path / "run")
    assert not list(folder.glob("estimates/*/posterior.npy"))
    again = read_run(folder)
    with pytest.raises(InputError, match="no joint posterior"):
        suggest(again.case, again.estimates["level_set"])
