"""The command `o3dls` with all its commands, and what becomes of their errors."""

from __future__ import annotations

import os

import click

from .. import __version__
from ..errors import O3dlsError, SolverError
from . import batch as cli_batch
from . import files as cli_files
from . import live as cli_live
from . import numbers as cli_numbers
from . import runs as cli_runs
from . import settings as cli_settings
from .environment import check_environment, check_memory
from .interrupts import heeded
from .words import DONE, INTERNAL, INTERRUPTED, MOST_LETTERS, UNREAD, WRONG_INPUT, complain, say_lines

COMPLETE = "_O3DLS_COMPLETE"  # click reads from this variable what a shell wants completed
COMPLETIONS = "must be bash_source, zsh_source or fish_source"


def run_command(arguments: list[str]) -> int:
    """Run a command and return its exit code. Errors become one line on stderr, only what is our own mistake
    shows a traceback. Raises Interrupted.
    """
    try:
        with heeded():
            return cli.main(arguments or ["--help"], prog_name="o3dls", standalone_mode=False) or DONE
    except click.ClickException as error:
        return _report_failure(error.format_message(), WRONG_INPUT)
    except click.exceptions.Abort:
        return _report_failure("interrupted", INTERRUPTED)
    except SystemExit as end:  # click exits so after a completion, or when stdout is closed
        if end.code and COMPLETE in os.environ:
            return _report_failure(f"{COMPLETE} = '{os.environ[COMPLETE]}': {COMPLETIONS}", WRONG_INPUT)
        return UNREAD if end.code else DONE
    except SolverError as error:
        return _report_failure(str(error), INTERNAL)
    except (O3dlsError, OSError) as error:
        return _report_failure(str(error), WRONG_INPUT)
    except MemoryError:
        return _report_failure(
            "there is too little memory; close other programs, or take less data", WRONG_INPUT
        )
    except Exception as error:
        import traceback

        say_lines(traceback.format_exc().rstrip(), error=True)
        return _report_failure(f"internal error, please report it: {type(error).__name__}: {error}", INTERNAL)


def _report_failure(sentence: str, code: int) -> int:
    complain(sentence)
    return code


# what people come for, and the commands that do it
TASKS = {
    "From a case to a run": ("demo", "app", "init", "import", "check", "run", "batch"),
    "Look at runs": ("report", "view", "slices", "wall", "next", "compare", "cohort"),
    "Numbers of a surface": ("measure", "segments", "change", "activation"),
    "While a map is being taken": ("live", "send"),
    "Files for other programs": ("convert", "export", "carry"),
    "About the program": ("stages", "settings", "names", "schema", "doctor", "paper"),
}


class ByTask(click.Group):
    """A group whose help lists the commands by task, each with its whole first sentence."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for task, names in TASKS.items():
            known = [(name, self.get_command(ctx, name)) for name in names]
            with formatter.section(task):
                formatter.write_dl([(name, _read_first_sentence(one)) for name, one in known if one])


def _read_first_sentence(command: click.Command) -> str:
    return command.get_short_help_str(limit=MOST_LETTERS)


@click.group(cls=ByTask, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.version_option(__version__, prog_name="o3dls")
def cli() -> None:
    """Fuse an atrium's prior surface with electroanatomic points. Research software, not for clinical use."""
    check_memory()
    check_environment()


for module in (cli_runs, cli_batch, cli_live, cli_settings, cli_files, cli_numbers):
    for command in vars(module).values():
        if isinstance(command, click.Command):
            cli.add_command(command)
