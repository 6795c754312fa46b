"""Ctrl-C and being told to end: both become one exception, so that what is half made is removed, and said.

Until `listen` Python answers by itself, with a traceback: it imports little.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

SIGNALS = (signal.SIGINT, signal.SIGTERM)
LATER = 0.05  # seconds
_heard: list[int] = []  # numbers of the signals that came, in their order


class Interrupted(BaseException):
    """This exception ends the process with the exit code that shells define for the first signal. No
    KeyboardInterrupt, to which libraries have answers of their own.
    """


def listen() -> None:
    """Let signals raise Interrupted from now on."""
    for number in SIGNALS:
        signal.signal(number, _raise_once)
    sys.unraisablehook = _raise_again


def end_at_once() -> None:
    """End the process with the code of the first signal. Libraries get no say: one that was interrupted in
    its import, or in its compiler, may crash where it ends in order. But what Python shares between processes
    is given back, since its tracker would say that it was not.
    """
    if shared := sys.modules.get("multiprocessing.util"):
        shared._exit_function()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # nobody reads it any more
            stream.flush()
    os._exit(128 + _heard[0])


def _raise_once(number: int, _: object) -> None:
    """Raise Interrupted, unless it was raised before and what is half made is being removed."""
    _heard.append(number)
    if not isinstance(sys.exc_info()[1], Interrupted):
        raise Interrupted


def _raise_again(lost: sys.UnraisableHookArgs) -> None:
    """Raise once more, a little later, what ended in a place that no exception leaves, such as a destructor.

    Once it was raised, destructors of what is half made fail, and have nothing to say.
    """
    if isinstance(lost.exc_value, Interrupted):
        from threading import Timer

        Timer(LATER, os.kill, [os.getpid(), _heard[0]]).start()
    elif not _heard:
        sys.__unraisablehook__(lost)


@contextmanager
def first_told(tell: Callable[[], None]) -> Iterator[None]:
    """Tell of the first Ctrl-C within this block, so that what runs may end in order; only the next one
    raises. The command ends as interrupted after either.
    """

    def hear(number: int, frame: object) -> None:
        if _heard:
            _raise_once(number, frame)
        else:
            _heard.append(number)
            tell()

    before = signal.signal(signal.SIGINT, hear)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def heeded() -> Iterator[None]:
    """End the block as interrupted once a signal came, whatever became of the exception on its way: some
    libraries make another one of it, or none.
    """
    try:
        yield
    except BaseException as error:
        if _heard:
            raise Interrupted from error
        raise
    if _heard:
        raise Interrupted


def too_late() -> None:
    """Let signals change nothing from now on: what was to be done is done, and said."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
