"""Arrays and columns out of what people hold in memory: tensors, tables, structured arrays, wrapped vectors.

An object is known by what it offers, so that no library is imported that is not in use already.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..case import MILLIMETRES
from ..errors import InputError
from ..io.tables.headings import read_axes
from ..io.text import is_missing


def plain_array(thing: Any) -> NDArray[Any]:
    """Return an array of numpy; of a tensor, wherever it is (torch, Open3D, CuPy, JAX), its values.

    Raises TypeError or ValueError where it is none.
    """
    if isinstance(thing, np.ndarray):
        return thing
    for step in ("detach", "cpu"):  # out of the graph of gradients, and off the graphics card
        if callable(getattr(thing, step, None)):
            thing = getattr(thing, step)()
    step = "get" if type(thing).__module__.startswith("cupy") else "numpy"
    return np.asarray(getattr(thing, step)() if callable(getattr(thing, step, None)) else thing)


def columns_of(thing: Any, where: str) -> dict[str, NDArray[Any]] | None:
    """Return the columns by name of a mapping, a table (pandas, polars and others that have `columns`), or a
    structured array; None where the object has none. Headings such as `x (mm)` are read as those of files.

    Raises InputError for units other than mm in a heading.
    """
    if isinstance(thing, np.ndarray):
        if thing.dtype.names is None:
            return None
        found = {name: thing[name] for name in thing.dtype.names}
    elif isinstance(thing, Mapping):
        found = dict(thing)
    elif hasattr(thing, "columns") and hasattr(thing, "__getitem__"):
        found = {name: plain_column(thing[name]) for name in thing.columns}
    else:
        return None
    names, units = read_axes(Path(where), "columns", list(map(str, found)))
    if units not in (None, "mm"):
        raise InputError(
            f"{where}: columns are in {units}: multiply them by {MILLIMETRES[units]:g} and name them x, y, "
            f"z; or only name them so, and say units='{units}' where the prior is in {units} too"
        )
    return dict(zip(names, found.values(), strict=True))


def plain_column(column: Any) -> NDArray[Any]:
    """Return a column of a table, with NaN for what its library has for no number."""
    values = plain_array(column)
    if values.dtype.kind != "O":
        return values
    none = [value is None or is_missing(str(value)) for value in values]
    numbers = all(
        isinstance(one, int | float | np.number) or gap for one, gap in zip(values, none, strict=True)
    )
    empty: Any = np.nan if numbers else ""
    return np.array([empty if gap else one for one, gap in zip(values, none, strict=True)])
