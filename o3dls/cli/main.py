"""The command line: arguments in, one result on stdout, progress and one line of error on stderr, an exit
code that means something. What takes time to import comes after signals are listened to.
"""

from __future__ import annotations

import gc
import sys

from .environment import delay_unused, open_streams, settle_variables
from .interrupts import Interrupted, end_at_once, heeded, listen, too_late

# between two garbage collections; Python's 700 is too few: most objects live to the end, and collecting takes
# a twentieth of a run
ALLOCATIONS = 50_000


def main() -> None:
    """Run a command and end the process with its exit code."""
    listen()
    open_streams()
    settle_variables()
    gc.set_threshold(ALLOCATIONS)
    try:
        with heeded():
            from ..child_processes import protect_path
            from .words import prepare

        protect_path()
        delay_unused()
        prepare()
        code = answer(sys.argv[1:])
        too_late()
    except Interrupted:
        too_late()
        print("o3dls: interrupted", file=sys.stderr)
        end_at_once()  # in here: what the exception holds may not be released either
    gc.freeze()  # a last collection would take half a second, and the process ends anyway
    sys.exit(code)


def answer(arguments: list[str]) -> int:
    """Run a command and return its exit code; errors become one line on stderr, only what is our own mistake
    shows a traceback. Raises Interrupted.
    """
    with heeded():
        from .commands import run_command
    return run_command(arguments)
