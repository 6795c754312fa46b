"""Commands run in this process: their exit code, and all that they print."""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from typing import Any

from o3dls.cli.commands import run_command


def said_by(*arguments: Any) -> tuple[int, str]:
    """Return the exit code and all that a command of o3dls prints."""
    out = io.StringIO()
    with redirect_stdout(out), redirect_stderr(out):
        code = run_command([str(argument) for argument in arguments])
    return code, out.getvalue()
