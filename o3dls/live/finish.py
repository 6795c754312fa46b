"""The end of a session: its case as a folder, and the run of the default pipeline on it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..io.case_reader import read_case
from ..io.case_writer import write_case
from ..runs.run import Run
from .session import Session

CASE, RUN = "case", "run"  # folders in the record folder


class _Teller(logging.Handler):
    """Hands on what the log says, until the next word replaces it."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        super().__init__(logging.INFO)
        self.tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        self.tell(record.getMessage())


@contextmanager
def telling(tell: Callable[[str], None]) -> Iterator[None]:
    """Tell what the run does while the block runs: it takes as long as a run does."""
    log, teller = logging.getLogger("o3dls"), _Teller(tell)
    tell("begun")
    log.addHandler(teller)
    try:
        yield
    finally:
        log.removeHandler(teller)


@dataclass(frozen=True, eq=False)
class Finished:
    """This is what a session leaves: its folders, the run, and how far the last surface that was shown lies
    (mean, in the case's unit) from the run's own motion of the prior and from its final surface; None where
    none was shown.
    """

    case: Path
    out: Path
    run: Run
    from_motion: float | None
    from_final: float | None


def finish(record: Path, session: Session, last: Array | None) -> Finished:
    """Write the case of a session and run the default pipeline on it, as `o3dls run` does. last: vertices
    (n, 3) of the surface that was shown last.

    Raises InputError where the case cannot be run: its folder is there all the same.
    """
    from ..pipeline.batch import run_into
    from ..pipeline.file import default_pipeline

    folder, out = record / CASE, record / RUN
    write_case(folder, session.case(), force=True)
    case = read_case(folder)
    run = run_into(default_pipeline().allowed_by(case), case, out, force=True)
    return Finished(folder, out, run, *_measure_gaps(last, run))


def _measure_gaps(last: Array | None, run: Run) -> tuple[float | None, float | None]:
    from ..evaluation.distances import distances

    if last is None or "deform" not in run.estimates:
        return None, None
    moved = run.estimates["deform"].surface.vertices
    final = run.estimates[run.final].surface
    return float(np.linalg.norm(moved - last, axis=1).mean()), float(distances(last, final).mean())
