"""What all commands speak: exit codes and kinds of arguments."""

from __future__ import annotations

from pathlib import Path

import click

DONE, NOT_VALID, WRONG_INPUT, INTERNAL = 0, 1, 2, 3
FILE = FOLDER = click.Path(path_type=Path)
