"""The sidecar of an exported file."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...io.atomic import write_file
from ...io.meshes.surface_file import NOTICE

if TYPE_CHECKING:
    from ..run import Run

log = logging.getLogger("o3dls")


def facts_of(run: Run, name: str, format: str, on: str, space: str, units: str) -> dict[str, Any]:
    """Return what a reader of the file must know and the file cannot say.

    No name of a case: it may be a patient's.
    """
    estimate = run.estimates[name]
    return {
        "notice": NOTICE,
        "estimate": name,
        "format": format,
        "on": on,
        "frame": space,
        "units": units,
        "T_map_prior": estimate.T_map_prior.tolist(),
        "T_map_prior_frame": run.case.frame,
        "T_map_prior_units": run.case.units,
        "prior_frame": run.case.prior_frame,
        "prior_file_units": run.case.prior_file_units or run.case.units,
        "status": estimate.status,
        "versions": dict(run.provenance.versions),
    }


def write_facts(path: Path, facts: dict[str, Any]) -> None:
    """Write facts to `<file>.json` beside a file."""
    sidecar = path.with_name(path.name + ".json")
    write_file(sidecar, json.dumps(facts, indent=1, allow_nan=False) + "\n")


def log_sentences(path: Path, sentences: Iterable[str], level: int = logging.INFO) -> None:
    """Log sentences on what a file does not keep, or what its user must know."""
    for sentence in sentences:
        log.log(level, "%s: %s", path.name, sentence)
