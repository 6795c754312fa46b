"""Where the report of a run is, as seen from the page of a cohort."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import quote

from .entries import Entry


def link_report(run: Entry, out: Path) -> str | None:
    """Return the address of a run's report as seen from the page `out`; None where it has none."""
    report = run.folder / "report.html"
    if not report.is_file():
        return None
    path = Path(os.path.relpath(report.resolve(), out.resolve().parent)).as_posix()
    return quote(os.fsencode(path))  # a folder may be named `javascript:`
