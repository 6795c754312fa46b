"""The command line: arguments in, one result on stdout, progress and one line of error on stderr, an exit
code that means something.
"""

from __future__ import annotations

import io
import logging
import os
import signal
import sys
from typing import Any

import click

from .. import __version__
from ..errors import O3dlsError, SolverError
from . import files as cli_files
from . import runs as cli_runs
from . import settings as cli_settings
from .words import DONE, INTERNAL, INTERRUPTED, UNREAD, WRONG_INPUT

# before numpy: our systems are small, and threads made them ten times slower
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


class Lines(logging.Formatter):
    """Progress as plain lines; what is wrong says so first."""

    def format(self, record: logging.LogRecord) -> str:
        return (
            record.getMessage()
            if record.levelno <= logging.INFO
            else f"{record.levelname.lower()}: {record.getMessage()}"
        )


def main() -> None:
    """Run a command and end the process with its exit code."""
    handler = logging.StreamHandler()
    handler.setFormatter(Lines())
    logging.basicConfig(handlers=[handler], level=logging.WARNING)
    logging.getLogger("o3dls").setLevel(logging.INFO)
    signal.signal(signal.SIGTERM, _interrupted)
    if isinstance(sys.stdout, io.TextIOWrapper):
        # names of folders may hold bytes that are no text; they go out as they came in
        sys.stdout.reconfigure(errors="surrogateescape")
    sys.exit(answer(sys.argv[1:]))


def answer(arguments: list[str]) -> int:
    """The exit code of a command; errors become one line on stderr, only what is our own mistake shows a
    traceback.
    """
    try:
        return cli.main(arguments or ["--help"], prog_name="o3dls", standalone_mode=False) or DONE
    except click.ClickException as error:
        return _failed(error.format_message(), WRONG_INPUT)
    except click.exceptions.Abort:
        return _failed("interrupted", INTERRUPTED)
    except SystemExit:  # so click answers a closed stdout
        return UNREAD
    except SolverError as error:
        return _failed(str(error), INTERNAL)
    except (O3dlsError, OSError) as error:
        return _failed(str(error), WRONG_INPUT)
    except Exception as error:
        import traceback

        traceback.print_exc()
        return _failed(f"internal error, please report it: {type(error).__name__}: {error}", INTERNAL)


def _interrupted(*_: Any) -> None:
    """Being told to end is taken as Ctrl-C is: what is half made is removed, and said."""
    raise KeyboardInterrupt


def _failed(sentence: str, code: int) -> int:
    click.echo(f"o3dls: {' '.join(sentence.split())}", err=True)
    return code


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.version_option(__version__, prog_name="o3dls")
def cli() -> None:
    """Fuse an atrium's prior surface with electroanatomic points. Research software, not for clinical use."""


for module in (cli_runs, cli_settings, cli_files):
    for command in vars(module).values():
        if isinstance(command, click.Command):
            cli.add_command(command)
