"""How far a batch is, as a bar on the last line of a terminal."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic

from ..pipeline.outcome import Outcome

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
        full = "#" * (LENGTH * ended // max(self.cases, 1))
        computed = ended - self.skipped
        estimate = f", about {_write_duration(seconds / computed * left)}" if computed and left else ""
        return f"[{full:.<{LENGTH}}] {self.done} done, {self.failed} failed, {left} left{estimate}"

    def show(self) -> None:
        """Draw the bar anew."""
        sys.stderr.write(WIPE + self.text(monotonic() - self._begun))
        sys.stderr.flush()


def _write_duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


@contextmanager
def bar(cases: int) -> Iterator[Bar | None]:
    """Show a bar below the lines of the log, on a terminal whose user asks for progress; else None."""
    handlers = logging.getLogger().handlers
    if not sys.stderr.isatty() or all(handler.level > logging.INFO for handler in handlers):
        yield None
        return
    shown = Bar(cases)
    for handler in handlers:
        handler.addFilter(_wipe_bar)
    shown.show()
    try:
        yield shown
    finally:
        for handler in handlers:
            handler.removeFilter(_wipe_bar)
        sys.stderr.write(WIPE)


def _wipe_bar(_: logging.LogRecord) -> bool:
    """Wipe the bar before a line of the log takes its place."""
    sys.stderr.write(WIPE)
    return True
