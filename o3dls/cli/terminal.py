"""How text reaches the terminal: the log's lines, and letters that its encoding has not."""

from __future__ import annotations

import codecs
import io
import logging
import shutil
import sys
from textwrap import wrap

from ..errors import escaped
from .words import WHOLE

CLOCK = 10  # letters of the seconds before a line


class Lines(logging.Formatter):
    """Lines show progress as plain text; a line on something wrong says so first. On a terminal each begins
    with the seconds since the start.
    """

    def __init__(self, terminal: bool) -> None:
        super().__init__()
        self.terminal = terminal

    def format(self, record: logging.LogRecord) -> str:
        said = escaped(record.getMessage())
        if record.levelno > logging.INFO:
            said = f"{record.levelname.lower()}: {said}"
        if not self.terminal:
            return said
        line = f"{record.relativeCreated / 1000.0:6.1f} s  {said}"
        wide = shutil.get_terminal_size().columns
        return "\n".join(wrap(line, wide, subsequent_indent=" " * CLOCK, **WHOLE))


def prepare() -> None:
    """Set up the log and stdout."""
    handler = logging.StreamHandler()
    handler.setFormatter(Lines(sys.stderr.isatty()))
    logging.basicConfig(handlers=[handler], level=logging.WARNING)
    logging.getLogger("o3dls").setLevel(logging.INFO)
    codecs.register_error("o3dls", _write_unknown)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="o3dls")


def _write_unknown(error: UnicodeError) -> tuple[str | bytes, int]:
    """Write letters that the terminal does not know as in a literal of Python. Names of folders may hold
    bytes that are no text: they go out as they came in.
    """
    try:
        return codecs.lookup_error("surrogateescape")(error)
    except UnicodeError:
        return codecs.backslashreplace_errors(error)
