"""Measured points and ablation sites as OpenEP keeps them: `electric`, with empty signals, and `rfindex`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...arrays import Array
from ...case import Points
from ..meshes.carto.mesh import MISSING

WHOLE, FINE = 1000.0, 100_000.0  # Hz: a sample takes 1 ms, or 0.01 ms
SITE_VALUES = {
    "time": "time",
    "avgForce": "force",
    "maxTemp": "max_temperature_c",
    "maxPower": "max_power_w",
    "fti": "fti_gs",
}
SIGNALS = (
    "there are no electrograms: egm is 0 and then the bipolar voltage, so that its amplitude is the voltage"
)


def electric_of(points: Points | None) -> dict[str, Any]:
    """Return the struct `electric` of the eam points, with all members that OpenEP's readers ask for; empty
    without any.
    """
    eam = points.of("eam") if points is not None else None
    n = 0 if eam is None else len(eam)
    none, cells = np.zeros((0, 0)), np.zeros((0, 1), dtype=object)
    found = {
        "tags": np.full((n, 1), "", dtype=object),
        "names": np.array([[f"P{k}"] for k in range(1, n + 1)], dtype=object).reshape(n, 1),
        "electrodeNames_bip": cells,
        "electrodeNames_uni": cells,
        **dict.fromkeys(
            ("egmX", "egm", "egmUni", "egmUniX", "egmRef", "ecg", "egmSurfX", "barDirection"), none
        ),
        "impedances": {"time": none, "value": none},
    }
    return found if eam is None or n == 0 else found | _members_of_points(eam)


def _members_of_points(eam: Points) -> dict[str, Any]:
    bipolar = _column_of_numbers(eam, "bipolar")
    return {
        "egmX": eam.xyz,
        # openep-py takes the voltage from the signal; a signal of NaN is no measurement to it
        "egm": np.hstack([np.where(np.isfinite(bipolar), 0.0, np.nan), bipolar]),
        "include": np.ones((len(eam), 1)),
        "voltages": {"bipolar": bipolar, "unipolar": _column_of_numbers(eam, "unipolar")},
        **_annotate_times(_column_of_numbers(eam, "lat")),
    }


def _annotate_times(lat: Array) -> dict[str, Any]:
    """Return times (n, 1) in ms as whole samples, which openep-py makes of them in any case; those that are
    not known lie before the window of interest, which holds all others and the reference.
    """
    known = np.isfinite(lat)
    rate = WHOLE if (lat[known] == np.round(lat[known])).all() else FINE
    samples = np.round(np.where(known, lat, 0.0) * rate / 1000.0)
    first, last = samples.min(initial=0.0), samples.max(initial=0.0)
    reference = 1.0 - first  # samples are counted from 1
    return {
        "sampleFrequency": rate,
        "annotations": {
            "woi": np.tile([first, last], (len(lat), 1)),
            "referenceAnnot": np.full_like(lat, reference),
            "mapAnnot": np.where(known, samples + reference, MISSING),
        },
    }


def rfindex_of(points: Points | None) -> dict[str, Any]:
    """Return the struct `rfindex` of the ablation points as a member of `userdata`; nothing without any."""
    sites = points.of("ablation") if points is not None else None
    if sites is None or len(sites) == 0:
        return {}
    values = {theirs: _column_of_numbers(sites, ours) for theirs, ours in SITE_VALUES.items()}
    return {"rfindex": {"tag": {"X": sites.xyz, **values}}}


def _column_of_numbers(points: Points, name: str) -> Array:
    """Return numbers (n, 1), NaN where there are none."""
    values = points.columns.get(name)
    numbers = values is not None and values.dtype.kind in "fiu"
    return np.asarray(values if numbers else np.full(len(points), np.nan), dtype=np.float64).reshape(-1, 1)
