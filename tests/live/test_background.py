"""The process of the full fits: held while points come, and never longer than the session lives."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from queue import SimpleQueue

import numpy as np
import pytest

from o3dls.io.case_reader import read_case
from o3dls.live.background import HELD, SHARE, Background
from o3dls.live.fitting import FullFit
from o3dls.live.session import Session, actions_of, empty
from o3dls.resources import demo_case

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="fits are held on Linux only")
FEW = 60
PATIENCE = 120.0  # seconds
HELD_FOR_GOOD = """
import sys, time
from tests.live.test_background import held, few
from o3dls.live.background import Background
if __name__ == "__main__":
    fits, background = held(few())
    print(background._pid, flush=True)
    time.sleep(600)
"""


def few() -> Session:
    case = read_case(demo_case())
    session = Session(empty(case))
    for one in islice(actions_of(case), FEW):
        session.apply(one)
    return session


def held(session: Session) -> tuple[SimpleQueue[FullFit], Background]:
    """A background whose second fit is held, with what has come of the first and will of the second."""
    fits: SimpleQueue[FullFit] = SimpleQueue()
    background = Background(fits.put)
    background.__enter__()
    background.begin(session)
    first = fits.get(timeout=PATIENCE)
    background.taken()
    comes_about(lambda: background._pid is not None)
    background.begin(session)
    background._since = time.monotonic() - 3600.0  # as if it had long been running
    background.make_way()
    fits.put(first)
    return fits, background


def state(process: int) -> str:
    """R: it runs, S: it waits, T: it is held, Z or nothing: it is no more."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return ""


def comes_about(condition: Callable[[], bool]) -> bool:
    end = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < end:
        time.sleep(0.02)
    return condition()


def test_a_fit_that_was_held_ends_as_one_that_was_not() -> None:
    fits, background = held(few())
    with background:
        process = background._pid
        assert process is not None
        assert comes_about(lambda: state(process) == "T")
        assert background.held_until is not None
        assert background.held_until <= time.monotonic() + HELD
        background.go_on()
        assert comes_about(lambda: state(process) in "RS")
        first, second = fits.get(timeout=PATIENCE), fits.get(timeout=PATIENCE)
        background.taken()
        background.make_way()
        assert state(process) in "RS"  # nothing runs: there is nothing to hold
    assert first.estimate is not None
    assert second.estimate is not None
    np.testing.assert_array_equal(first.estimate.surface.vertices, second.estimate.surface.vertices)


def test_a_fit_gets_its_share_of_the_time_however_fast_points_come() -> None:
    _, background = held(few())
    with background:
        process = background._pid
        assert process is not None
        comes_about(lambda: state(process) == "T")
        background._since = time.monotonic() - 1.0
        background._held = 1.01 * SHARE
        background.make_way()
        assert comes_about(lambda: state(process) in "RS")
        background.make_way()
        assert state(process) in "RS"


def test_a_fit_that_is_held_ends_with_its_session() -> None:
    root = Path(__file__).parents[2]
    with subprocess.Popen(
        [sys.executable, "-c", HELD_FOR_GOOD],
        stdout=subprocess.PIPE,
        text=True,
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root)},
    ) as session:
        assert session.stdout is not None
        process = int(session.stdout.readline())
        assert comes_about(lambda: state(process) == "T")
        os.kill(session.pid, signal.SIGKILL)
        assert comes_about(lambda: state(process) in ("", "Z"))
