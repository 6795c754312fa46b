"""CARTO 3 points: `<map>_car.txt` (measured points) and VisiTag's Sites.txt (ablation points)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...case import Points
from ...errors import InputError
from ..text import decode, integers, number_rows

COLUMNS = {"unipolar": 10, "bipolar": 11, "lat": 12, "impedance": 13}
FEWEST_COLUMNS = 14
SITES = {
    "AverageForce": "force",
    "DurationTime": "duration_s",
    "MaxTemperature": "max_temperature_c",
    "MaxPower": "max_power_w",
    "BaseImpedance": "base_impedance_ohm",
    "ImpedanceDrop": "impedance_drop_ohm",
    "FTI": "fti_gs",
}


def read_car(path: Path, data: bytes) -> tuple[Points, NDArray[np.int64]]:
    """Read catheter positions (not projected) with voltages in mV, lat in ms, and the ids of the points.

    A map without points gives none. Raises InputError.
    """
    lines = decode(data, path).splitlines()
    if not lines or not lines[0].startswith("VERSION_"):
        raise InputError(f"{path}: line 1 must begin with VERSION_4_0, VERSION_5_0 or VERSION_6_0")
    rows = [(k, line.rstrip("\t").split("\t")) for k, line in enumerate(lines[1:], 2) if line.strip()]
    for number, cells in rows:
        if cells[0] != "P" or len(cells) < FEWEST_COLUMNS:
            raise InputError(
                f"{path}: line {number}: must begin with P and have at least {FEWEST_COLUMNS} columns, "
                f"there are {len(cells)}"
            )
    picked = [" ".join((c[2], *c[4:7], *(c[k] for k in COLUMNS.values()))) for _, c in rows]
    table = number_rows(picked, 4 + len(COLUMNS), path, [number for number, _ in rows], "point")
    xyz = table[:, 1:4]
    if not np.isfinite(xyz).all():
        bad = int(np.flatnonzero(~np.isfinite(xyz).all(axis=1))[0])
        raise InputError(f"{path}: line {rows[bad][0]}: position {xyz[bad]} is not finite")
    columns = {name: table[:, 4 + k] for k, name in enumerate(COLUMNS)}
    return Points(xyz, np.full(len(rows), "eam"), columns), integers(table[:, 0], f"{path}: point id")


def read_sites(path: Path, data: bytes) -> Points:
    """Read ablation sites of VisiTag with what was measured at each; columns are found by name.

    Raises InputError.
    """
    lines = [(k, line) for k, line in enumerate(decode(data, path).splitlines(), 1) if line.strip()]
    header = lines[0][1].split() if lines else []
    for name in ("X", "Y", "Z"):
        if name not in header:
            raise InputError(f"{path}: line 1: no column '{name}'; there are: {' '.join(header)[:200]}")
    table = number_rows([line for _, line in lines[1:]], len(header), path, [k for k, _ in lines[1:]], "site")
    xyz = table[:, [header.index(axis) for axis in "XYZ"]]
    if not np.isfinite(xyz).all():
        raise InputError(f"{path}: a site has a position that is not finite")
    columns: dict[str, NDArray[Any]] = {
        ours: table[:, header.index(theirs)] for theirs, ours in SITES.items() if theirs in header
    }
    return Points(xyz, np.full(len(table), "ablation"), columns)
