"""What all commands speak: exit codes, kinds of arguments, and how text reaches the terminal."""

from __future__ import annotations

import codecs
import io
import json
import logging
import os
import shutil
import sys
from pathlib import Path
from textwrap import wrap
from typing import Any

import click

from ..errors import escaped, escaped_lines

DONE, NOT_VALID, WRONG_INPUT, INTERNAL = 0, 1, 2, 3
INTERRUPTED, UNREAD = 130, 141  # 128 + SIGINT for Ctrl-C, 128 + SIGPIPE for a closed stdout
MOST_LETTERS = 4000  # in a sentence: room for two file paths of the greatest length
WHOLE: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}  # paths are to be copied
CLOCK = 10  # letters of the seconds before a line of the log
FILE = FOLDER = click.Path(path_type=Path)


def say(sentence: object, *, error: bool = False, colour: str | None = None) -> None:
    """Print one line; what of it comes out of files is shown and not obeyed.

    A colour reaches terminals alone.
    """
    text = escaped(str(sentence))
    click.echo(click.style(text, fg=colour) if colour and "NO_COLOR" not in os.environ else text, err=error)


def say_wrapped(line: str, *, colour: str | None = None) -> None:
    """Print a line, on a terminal wrapped at words, with what goes on set in under its first word."""
    if not sys.stdout.isatty():
        say(line, colour=colour)
        return
    start = line[: len(line) - len(line.lstrip())]
    for part in wrap(line, shutil.get_terminal_size().columns, subsequent_indent=f"{start}  ", **WHOLE):
        say(part, colour=colour)


def say_lines(text: object, *, error: bool = False) -> None:
    """Print a text of several lines; what of it comes out of files is shown and not obeyed."""
    click.echo(escaped_lines(str(text)), err=error)


def say_json(value: object, *, line: bool = False) -> None:
    """Print plain values as JSON, on one line or several, in letters that no terminal obeys."""
    text = json.dumps(value, indent=None if line else 1, allow_nan=False)
    click.echo(text.replace("\x7f", "\\u007f"))


def complain(sentence: str) -> None:
    """Print what is wrong: one line on stderr."""
    say(f"o3dls: {' '.join(shortened(sentence).split())}", error=True, colour="red")


def shortened(sentence: str) -> str:
    """Cut a sentence to a length that people read; what is quoted in it may be of any length."""
    return sentence if len(sentence) <= MOST_LETTERS else sentence[: MOST_LETTERS - 1] + "…"


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
            kind = record.__dict__.get("kind", record.levelname.lower())  # a note, of what only informs
            said = f"{kind}: {said}"
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
