"""The program's log, listened to while something runs."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import O3dlsError, escaped_lines

log = logging.getLogger("o3dls")


class _Lines(logging.Handler):
    """This handler keeps the log's lines, from a level on, in a list."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


@contextmanager
def recorded_log(level: int) -> Iterator[list[str]]:
    """Yield a list that gets the lines of the log, from a level on, that the block gives."""
    handler = _Lines(level)
    before = log.level
    log.addHandler(handler)
    log.setLevel(min(log.getEffectiveLevel(), level))
    try:
        yield handler.lines
    finally:
        log.removeHandler(handler)
        log.setLevel(before)


@contextmanager
def log_of_failure(out: Path) -> Iterator[None]:
    """Leave `<out>.failed.log`, which says what was done and why it ended, where the block fails; remove an
    old one where it does not.
    """
    path = out.with_name(out.name + ".failed.log")
    with recorded_log(logging.INFO) as lines:
        try:
            yield
        except BaseException as error:
            lines.append(
                f"{type(error).__name__}: {error}"
                if isinstance(error, O3dlsError)
                else traceback.format_exc()
            )
            with suppress(OSError):  # what went wrong is said, whether or not there is room for a log of it
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(escaped_lines("\n".join(lines)) + "\n", encoding="utf-8", errors="replace")
            raise
    with suppress(OSError):
        path.unlink(missing_ok=True)
