"""Formats that hold both sides of a run, the map and the prior's image: written whole, with their sidecar."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

from ...io.atomic import staged_files
from .facts import facts_of, log_sentences, write_facts
from .motion_files import write_itk
from .placed import frame_of
from .scene import write_scene

if TYPE_CHECKING:
    from ...case import Case
    from ..run import Run


def unknown_sides(case: Case) -> bool:
    """Return whether neither the prior nor the map says its frame: one alone counts for both."""
    return frame_of(case, "prior") == frame_of(case, "map") == "unknown"


def write_between(
    run: Run,
    name: str,
    format: str,
    path: Path,
    *,
    spacing: float,
    image: Path | None = None,
    within: Path | None = None,
) -> None:
    """Write an estimate in a format that holds both sides, and its facts to `<file>.json` beside it; the log
    hears how exact it is, and warns of what has no inverse.
    """
    facts = facts_of(run, name, format, "both", "LPS", "mm")
    with staged_files(path, within) as staged:
        if format == "itk":
            written = write_itk(staged, run, name, spacing)
        else:
            written = write_scene(staged, run, name, spacing, image)
        write_facts(staged, facts | written.facts)
    log_sentences(path, written.sentences)
    log_sentences(path, written.failures, logging.WARNING)
