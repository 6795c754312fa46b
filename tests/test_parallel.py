"""Loops on several cores: whatever the number of threads, every row is done once and alike."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from typing import Any

import numpy as np
import pytest
from tiny import sphere

from o3dls import parallel as compiled
from o3dls.geometry.closest_point import WORTH, ClosestPoint

POINTS = np.random.default_rng(7_717).normal(size=(5 * WORTH + 3, 3)) * 30.0


def found(threads: int) -> tuple[Any, ...]:
    ball = sphere(20.0, 20)
    compiled.THREADS = threads
    return ClosestPoint(ball.vertices, ball.faces).query(POINTS)


@pytest.fixture(autouse=True)
def _threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "THREADS", compiled.THREADS)


def test_results_do_not_depend_on_the_number_of_threads() -> None:
    one = found(1)
    for threads in (2, 3, 50):
        for a, b in zip(one, found(threads), strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("threads", "count", "parts"),
    [(1, 100, 1), (2, 19, 1), (2, 20, 2), (3, 100, 9), (8, 30, 3), (2, 100, 6), (2, 0, 1)],
)
def test_every_row_is_done_once_and_no_thread_has_too_few(
    monkeypatch: pytest.MonkeyPatch, threads: int, count: int, parts: int
) -> None:
    monkeypatch.setattr(compiled, "THREADS", threads)
    done = np.zeros(count)
    sizes = list[int]()

    def kernel(rows: Any, step: float) -> None:
        sizes.append(len(rows))
        rows += step

    compiled.by_rows(kernel, 10, (done,), 2.0)
    assert (done == 2.0).all()
    assert len(sizes) == parts
    assert parts == 1 or min(sizes) >= 10


def test_a_thread_that_is_busy_with_other_work_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "THREADS", 2)
    done = np.zeros(100)
    freed = threading.Event()
    busy = compiled._thread_pool(os.getpid()).submit(freed.wait, 60.0)

    def kernel(rows: Any) -> None:
        rows += 1.0

    compiled.by_rows(kernel, 10, (done,))
    still_busy = not busy.done()
    freed.set()
    assert still_busy
    assert (done == 1.0).all()


def test_what_fails_on_a_thread_fails() -> None:
    compiled.THREADS = 2

    def kernel(rows: Any) -> None:
        if rows[0] > 0:
            raise ValueError("the second half")

    with pytest.raises(ValueError, match="the second half"):
        compiled.by_rows(kernel, 1, (np.arange(10),))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork on this system")
def test_a_fork_has_threads_of_its_own() -> None:
    """Those of its parent are not there, and waiting for them would take for ever."""
    before = found(2)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        after = pool.apply_async(found, (2,)).get(timeout=60)
    np.testing.assert_array_equal(before[0], after[0])


def test_processes_share_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled.config, "NUMBA_NUM_THREADS", 8)
    for processes, threads in ((1, 8), (3, 2), (20, 1)):
        compiled.limit_threads(processes)
        assert threads == compiled.THREADS


def test_work_that_nobody_waits_for_is_done_and_may_fail() -> None:
    done = threading.Event()

    def fails() -> None:
        done.set()
        raise OSError

    compiled.started_beside(fails)
    assert done.wait(10.0)


def test_both_return_what_two_functions_return_and_raise_what_either_raises() -> None:
    assert compiled.both(lambda: 1, lambda: "b") == (1, "b")
    with pytest.raises(ZeroDivisionError):
        compiled.both(lambda: 1, lambda: 1 // 0)


def test_each_keeps_the_order_of_its_items() -> None:
    assert compiled.each(lambda x: x * x, range(20)) == [x * x for x in range(20)]


def test_what_is_asked_once_is_computed_once_whoever_asks() -> None:
    calls = list[int]()

    def slow() -> int:
        calls.append(1)
        time.sleep(0.05)
        return 7

    asked = compiled.once(slow)
    assert compiled.each(lambda _: asked(), range(6)) == [7] * 6
    assert calls == [1]
