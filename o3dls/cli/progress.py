"""How far a run or a batch is, as a bar on the last line of a terminal."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread
from time import monotonic
from typing import TYPE_CHECKING

from ..pipeline.outcome import Outcome
from ..pipeline.pipeline import STEPS

if TYPE_CHECKING:
    from ..pipeline.pipeline import Pipeline

LENGTH = 24  # letters
WIPE = "\r\x1b[K"


class Bar:
    """The bar shows how many cases are done, failed and left, and estimates the time that the rest takes."""

    def __init__(self, cases: int) -> None:
        self.cases, self.done, self.failed, self.skipped = cases, 0, 0, 0
        self._begun = monotonic()

    def count(self, outcome: Outcome) -> None:
        """Count a case that ended."""
        self.failed += outcome.error is not None
        self.done += outcome.error is None
        self.skipped += outcome.skipped

    def text(self, seconds: float) -> str:
        """Write the bar, so many seconds after the beginning."""
        ended = self.done + self.failed
        left = self.cases - ended
        computed = ended - self.skipped
        estimate = f", about {_write_duration(seconds / computed * left)}" if computed and left else ""
        share = _draw_share(ended, self.cases)
        return f"{share} {self.done} done, {self.failed} failed, {left} left{estimate}"

    def show(self) -> None:
        """Draw the bar anew."""
        sys.stderr.write(WIPE + self.text(monotonic() - self._begun))
        sys.stderr.flush()


class RunBar(logging.Handler):
    """The bar shows how many stages, folds and files of a run are done, and how long it has been at it."""

    def __init__(self, steps: int) -> None:
        super().__init__(logging.INFO)
        self.steps, self.done = steps, 0
        self._begun = monotonic()

    def emit(self, record: logging.LogRecord) -> None:
        self.done += record.msg in STEPS

    def text(self, seconds: float) -> str:
        """Write the bar, so many seconds after the beginning."""
        done = min(self.done, self.steps)
        return f"{_draw_share(done, self.steps)} {done} of {self.steps} steps, {_write_duration(seconds)}"

    def show(self) -> None:
        """Draw the bar anew."""
        sys.stderr.write(WIPE + self.text(monotonic() - self._begun))
        sys.stderr.flush()


def _draw_share(done: int, of: int) -> str:
    return f"[{'#' * (LENGTH * done // max(of, 1)):.<{LENGTH}}]"


def _write_duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


@contextmanager
def bar(cases: int) -> Iterator[Bar | None]:
    """Show a bar below the lines of the log, on a terminal whose user asks for progress; else None."""
    if not _asks_for_progress():
        yield None
        return
    shown = Bar(cases)
    with _below_the_log():
        shown.show()
        yield shown


@contextmanager
def run_bar(plan: Pipeline) -> Iterator[RunBar | None]:
    """Show a bar of a run of a pipeline while the block runs, drawn anew each second; else as `bar`."""
    if not _asks_for_progress():
        yield None
        return
    shown = RunBar(plan.steps)
    ended = Event()

    def tick() -> None:
        while not ended.wait(1.0):
            shown.show()

    log, clock = logging.getLogger("o3dls"), Thread(target=tick, daemon=True)
    log.addHandler(shown)
    try:
        with _below_the_log():
            clock.start()
            yield shown
            ended.set()
            clock.join()
    finally:
        ended.set()
        log.removeHandler(shown)


def _asks_for_progress() -> bool:
    handlers = logging.getLogger().handlers
    return sys.stderr.isatty() and any(handler.level <= logging.INFO for handler in handlers)


@contextmanager
def _below_the_log() -> Iterator[None]:
    """Wipe the bar before each line of the log, and at the end."""
    handlers = logging.getLogger().handlers
    for handler in handlers:
        handler.addFilter(_wipe_bar)
    try:
        yield
    finally:
        for handler in handlers:
            handler.removeFilter(_wipe_bar)
        sys.stderr.write(WIPE)


def _wipe_bar(_: logging.LogRecord) -> bool:
    """Wipe the bar before a line of the log takes its place."""
    sys.stderr.write(WIPE)
    return True
