"""Options that several commands share: what is printed, and how."""

from __future__ import annotations

import logging
from typing import Any

import click

as_json = click.option("--json", "as_json", is_flag=True, help="print the result as JSON")


def progress(command: Any) -> Any:
    """Options of a command that takes its time: how much it says of its progress."""
    quiet = click.option(
        "-q",
        "--quiet",
        is_flag=True,
        expose_value=False,
        callback=lambda _, __, wanted: wanted and _least(logging.WARNING),
        help="of the progress only warnings",
    )
    verbose = click.option(
        "-v",
        "--verbose",
        is_flag=True,
        expose_value=False,
        callback=lambda _, __, wanted: wanted and _least(logging.DEBUG),
        help="also the parameters of each stage, and each fit of the cross-validation",
    )
    return quiet(verbose(command))


def _least(level: int) -> None:
    """Print the log's lines from a level on; the log itself may be listened to for more."""
    log = logging.getLogger("o3dls")
    log.setLevel(min(log.level, level))
    for handler in logging.getLogger().handlers:
        handler.setLevel(level)
