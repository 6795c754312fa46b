"""The results folder: `paper_results.json` holds every number of the page, `shapes/` what its pictures
show.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..geometry.surface import Surface
from ..io.atomic import staged_file, write_file
from .experiment import SEEDS, Outcome, Row, Scope

SCHEMA = "o3dls-paper/1"
RESULTS = "paper_results.json"
SHAPES = "shapes"


@dataclass(frozen=True, eq=False)
class Results:
    """Results hold the rows of all experiments, sentences on what was left out, and the folder of the
    shapes.
    """

    rows: Sequence[Row]
    left_out: Mapping[str, str]
    quick: bool
    folder: Path

    def of(self, experiment: str, **fixed: Any) -> list[Row]:
        """Return rows of an experiment whose columns have the given values."""
        return [
            r
            for r in self.rows
            if r["experiment"] == experiment and all(r.get(k) == v for k, v in fixed.items())
        ]

    def shape(self, name: str) -> Surface:
        """Read a surface that an experiment kept."""
        with np.load(self.folder / SHAPES / f"{name}.npz") as file:
            fields = {key.removeprefix("field_"): file[key] for key in file.files if key.startswith("field_")}
            return Surface(file["vertices"], file["faces"], fields)

    def array(self, name: str) -> Array:
        """Read points or grey values that an experiment kept."""
        with np.load(self.folder / SHAPES / f"{name}.npz") as file:
            return np.asarray(file["values"])


def column(rows: Sequence[Row], key: str) -> Array:
    """Return values (n,) of a column; rows without it are left out."""
    return np.array([row[key] for row in rows if row.get(key) is not None], dtype=np.float64)


def write_results(
    folder: Path, outcomes: Mapping[str, Sequence[Outcome]], left_out: Mapping[str, str], scope: Scope
) -> None:
    """Write the numbers, in the order of the tasks, and the shapes."""
    rows = [row for found in outcomes.values() for outcome in found for row in outcome.rows]
    whole = {
        "schema": SCHEMA,
        "quick": scope.quick,
        "seeds": list(SEEDS),
        "left_out": dict(left_out),
        "rows": rows,
    }
    write_file(folder / RESULTS, json.dumps(whole, indent=1, allow_nan=False) + "\n")
    for experiment, found in outcomes.items():
        for name, shape in ((n, s) for outcome in found for n, s in outcome.shapes.items()):
            _write_shape(folder / SHAPES / experiment / f"{name}.npz", shape)


def read_results(folder: Path) -> Results:
    """Read the results that a folder holds. Raises InputError where there are none of this version."""
    path = folder / RESULTS
    if not path.is_file():
        raise InputError(f"{path}: no such file; `o3dls paper --out {shlex.quote(str(folder))}` makes it")
    whole = json.loads(path.read_text(encoding="utf-8"))
    if whole.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema = {whole.get('schema')!r}: must be {SCHEMA!r}")
    return Results(whole["rows"], whole["left_out"], whole["quick"], folder)


def _write_shape(path: Path, shape: Surface | Array) -> None:
    if isinstance(shape, Surface):
        arrays: dict[str, Any] = {
            f"field_{key}": np.asarray(values, dtype=np.float32) for key, values in shape.fields.items()
        }
        arrays["vertices"] = shape.vertices.astype(np.float32)
        arrays["faces"] = shape.faces.astype(np.int32)
    else:
        arrays = {"values": np.asarray(shape, dtype=np.float32)}
    with staged_file(path) as staged:
        np.savez_compressed(staged, **arrays)
