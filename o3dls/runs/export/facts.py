"""The sidecar of an exported file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...io.meshes.surface_file import NOTICE

if TYPE_CHECKING:
    from ..run import Run


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
