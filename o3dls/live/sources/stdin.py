"""Actions that are read from stdin, where a session has no page."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from threading import Thread
from typing import BinaryIO

from ...errors import InputError
from ..host import Host
from ..messages import MOST, error, parse_action


@contextmanager
def serve_stdin(host: Host, *, alone: bool) -> Iterator[None]:
    """Do the actions that are read from stdin, a line of JSON each, while the block runs. Where nothing else
    gives points, and they are `alone`, the end of stdin ends the session: nobody else could.
    """
    # a reader of its own: the interpreter aborts at its end where a thread still reads sys.stdin
    lines = open(sys.stdin.fileno(), "rb", closefd=False)  # noqa: SIM115
    Thread(target=obey_lines, args=(host, lines, alone), daemon=True).start()
    yield


def obey_lines(host: Host, lines: BinaryIO, alone: bool) -> None:
    """Do the actions of lines, to their end."""
    for number in count(1):
        line = lines.readline(MOST + 1)
        if not line:
            break
        while len(line) > MOST and not line.endswith(b"\n") and (rest := lines.readline(MOST)):
            line = line[:MOST] + rest[-1:]  # what is too long is read to its end, and not kept
        if line.strip():
            try:
                host.act(parse_action(line, f"line {number}"))
            except InputError as refused:
                host.tell(error(str(refused)))
            except Exception as fault:  # our own mistake must not leave a session that hears nothing
                host.tell(error(f"internal error, please report it: {type(fault).__name__}: {fault}"))
    if alone and not host.ending:
        host.act({"do": "end"})
