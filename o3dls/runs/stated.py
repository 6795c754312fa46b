"""The frame and the units of a file to convert: what it states, and what is given beside it."""

from __future__ import annotations

from pathlib import Path

from ..case import MILLIMETRES
from ..errors import InputError


def scaled_units(stated: str) -> str:
    """Return units of lengths once they are scaled: mm, or what cannot be scaled to it."""
    return stated if stated in ("px", "unknown") else "mm"


def settle_units(source: Path, stated: str, given: str | None) -> str:
    """Return the units that the file states, or those that are given where it states none.

    Raises InputError too where the file states none that is known, and nothing is given.
    """
    if stated in (*MILLIMETRES, "unknown"):
        return settle_stated(source, "units", stated, given)
    if given is None:
        raise InputError(
            f"{source}: states units '{stated}': must be one of {', '.join(MILLIMETRES)}; say which with "
            "--units"
        )
    return given


def settle_stated(source: Path, what: str, stated: str, given: str | None) -> str:
    """Return what the file states, else what is given. Raises InputError where the two differ."""
    if given and stated not in ("unknown", given):
        raise InputError(
            f"{source}: states {what} {stated}, and {given} was given; omit --{what} if the file is right"
        )
    return given or stated


def needs_turn(source: Path, space: str, to: str) -> bool:
    """Return whether coordinates must be turned. Raises InputError where the frame is not known."""
    if space not in ("LPS", "RAS"):
        raise InputError(
            f"{source}: its frame is not known, so it cannot be brought to {to}; state it with --frame"
        )
    return space != to
