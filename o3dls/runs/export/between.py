"""Formats that hold both sides of a run, the map and the prior's image: written whole, with their sidecar."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .facts import facts_of, write_facts
from .motion_files import Written, write_itk
from .placed import frame_of
from .scene import write_scene

if TYPE_CHECKING:
    from ...case import Case
    from ..run import Run


def unknown_sides(case: Case) -> bool:
    """Return whether neither the prior nor the map says its frame: one alone counts for both."""
    return frame_of(case, "prior") == frame_of(case, "map") == "unknown"


def write_between(
    run: Run, name: str, format: str, path: Path, *, spacing: float, image: Path | None = None
) -> Written:
    """Write an estimate in a format that holds both sides, and its facts to `<file>.json` beside it, and
    return what there is to say of how exact it is, and of what has no inverse.
    """
    if format == "itk":
        written = write_itk(path, run, name, spacing)
    else:
        written = write_scene(path, run, name, spacing, image)
    write_facts(path, facts_of(run, name, format, "both", "LPS", "mm") | written.facts)
    return written
