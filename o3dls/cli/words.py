"""What all commands speak: exit codes and kinds of arguments."""

from __future__ import annotations

from pathlib import Path

import click

DONE, NOT_VALID, WRONG_INPUT, INTERNAL = 0, 1, 2, 3
INTERRUPTED, UNREAD = 130, 141  # as shells say it: by Ctrl-C, and for a stdout that nobody reads any more
FILE = FOLDER = click.Path(path_type=Path)
