"""Processes beside this one end when the block that asked for them is interrupted, whatever they do."""

from __future__ import annotations

import subprocess
import sys

import pytest

from o3dls.pipeline.workers import workers

# the thread that takes results is held, so that a large one is on its way when the block is interrupted
INTERRUPTED = """
import time
from threading import Event
from o3dls.pipeline.workers import workers

def hold(_):
    held.set()
    time.sleep(1.0)

held = Event()
with workers(1) as pool:
    pool.submit(int).result()
    pool.submit(time.sleep, 0.2).add_done_callback(hold)
    pool.submit(bytes, 50_000_000)
    held.wait()
    time.sleep(0.5)
    raise KeyboardInterrupt
"""


def test_a_process_that_is_interrupted_while_it_sends_a_result_is_not_waited_for() -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stderr.rstrip().endswith("KeyboardInterrupt"), done.stderr


def test_a_pool_that_was_shut_down_is_interrupted_like_any_other() -> None:
    def interrupted() -> None:
        with workers(1) as pool:
            pool.shutdown(wait=False)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
