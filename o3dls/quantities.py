"""What can be measured at a point: quantities, the values that they can have, and the numbers by which the
systems say that there is none.

Every entry asks this table: files, studies, objects in memory, points of a session.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Ints
from .columns import meaning_of
from .errors import InputError

# numbers for `no value` in CARTO and in programs that handle its exports, where they are impossible as values
WORDS_FOR_NONE = (
    -10_000.0,
    10_000.0,
    -9_999.0,
    9_999.0,
    -8_000.0,
    -99_999.0,
    99_999.0,
    -999.0,
    999.0,
    -32_768.0,
)
LARGEST = 1e30  # the largest single and double floats, and infinity, stand for `no value` as well
NAMED = 5  # rows with a wrong value that a sentence names


VOLTAGES = {"bipolar": (0.5, 1.5), "unipolar": (5.0, 8.0)}  # mV: scar below, healthy wall above


@dataclass(frozen=True)
class Quantity:
    """A quantity has a unit, and the least and the largest value that it can have."""

    unit: str
    least: float
    most: float

    def impossible(self, values: Array) -> NDArray[np.bool_]:
        """Return where values (n,) are there and cannot have been measured."""
        return np.asarray((values < self.least) | (values > self.most))

    def can_be(self, value: float) -> bool:
        """Return whether one value can have been measured."""
        return self.least <= value <= self.most and abs(value) < LARGEST

    def __str__(self) -> str:
        return f"within [{self.least:g}, {self.most:g}] {self.unit}".rstrip()


# wider than all values that were seen: a value outside is no measurement
QUANTITIES: Mapping[str, Quantity] = {
    "bipolar": Quantity("mV", 0.0, 100.0),  # from peak to peak
    "unipolar": Quantity("mV", -200.0, 200.0),  # some systems give the peak below 0
    "lat": Quantity("ms", -5_000.0, 5_000.0),
    "impedance": Quantity("ohm", 0.0, 5_000.0),
    "force": Quantity("g", -100.0, 900.0),  # sensors drift below 0
    "sigma": Quantity("", 0.0, np.inf),  # a length, in any unit
    "duration_s": Quantity("s", 0.0, 9_000.0),
    "max_temperature_c": Quantity("°C", -100.0, 500.0),
    "max_power_w": Quantity("W", 0.0, 900.0),
    "power_w": Quantity("W", 0.0, 900.0),
    "energy_j": Quantity("J", 0.0, 1e6),
    "base_impedance_ohm": Quantity("ohm", 0.0, 5_000.0),
    "impedance_drop_ohm": Quantity("ohm", -5_000.0, 5_000.0),
    "fti_gs": Quantity("g s", -900.0, 9_000.0),
    "lsi": Quantity("", 0.0, 900.0),
}


def quantity_of(name: str) -> Quantity | None:
    """Return the quantity that a column or field is of, as programs name it: in any case, with its unit
    behind; None where that unit is another one.
    """
    meant = meaning_of(name)
    if meant is not None:
        return QUANTITIES.get(meant.name) if meant.factor == 1.0 else None
    return QUANTITIES.get(name.strip().lower())


def stands_for_none(quantity: Quantity, values: Array) -> NDArray[np.bool_]:
    """Return where values (n,) of a quantity are words for none."""
    words = np.isin(values, WORDS_FOR_NONE) & quantity.impossible(values)
    return np.asarray(words | (np.abs(values) >= LARGEST))


def known_values(columns: Mapping[str, NDArray[Any]]) -> tuple[dict[str, NDArray[Any]], tuple[str, ...]]:
    """Return the columns by name with NaN for words for none in those that are quantities, and a sentence on
    each that held any.
    """
    known, said = dict(columns), []
    for name, column in columns.items():
        if (quantity := quantity_of(name)) is None or not _is_numbers(column):
            continue
        values = np.asarray(column, dtype=np.float64)
        none = stands_for_none(quantity, values)
        known[name] = np.where(none, np.nan, values)
        if none.any():
            said.append(_describe_missing(name, values[none], len(values)))
    return known, tuple(said)


def scaled_known(values: Array, factor: float) -> Array:
    """Return values (n,) in another unit, NaN for the words for none among them, of which those below 0 are
    words in any unit.
    """
    words = (np.isin(values, WORDS_FOR_NONE) & (values < 0.0)) | (np.abs(values) >= LARGEST)
    return np.where(words, np.nan, values * factor)


def _is_numbers(column: NDArray[Any]) -> bool:
    return column.ndim == 1 and column.dtype.kind in "fiu"


def _describe_missing(name: str, words: Array, n: int) -> str:
    listed = ", ".join(f"{word:g}" for word in np.unique(words)[:NAMED])
    return f"{len(words)} of {n} values of '{name}' are {listed}, which stands for none: they are left empty"


def impossible_rows(name: str, values: NDArray[Any]) -> Ints:
    """Return rows of a column whose values cannot have been measured, once words for none are NaN."""
    quantity = quantity_of(name)
    if quantity is None or not _is_numbers(values):
        return np.zeros(0, dtype=np.int64)
    return np.flatnonzero(quantity.impossible(np.asarray(values, dtype=np.float64)))


def check_possible(name: str, values: NDArray[Any], where: str, place: Callable[[int], str]) -> None:
    """Raise InputError where a column holds what cannot have been measured; `place` names a row, as the file
    or the object `where` counts it.
    """
    if len(rows := impossible_rows(name, values)):
        others = f", and so is {places(rows[1:], place)}" if len(rows) > 1 else ""
        raise InputError(
            f"{where}: {place(int(rows[0]))}, column '{name}': {values[rows[0]]:g} cannot have been "
            f"measured: must be {quantity_of(name)}{others}; leave it empty where there is none"
        )


def without_impossible(
    columns: Mapping[str, NDArray[Any]], place: Callable[[int], str]
) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Return the columns with NaN for what cannot have been measured, where nobody can mend the file, and a
    sentence that names the rows of each.
    """
    kept, said = dict(columns), []
    for name, values in columns.items():
        if len(rows := impossible_rows(name, values)):
            kept[name] = np.asarray(values, dtype=np.float64).copy()
            kept[name][rows] = np.nan
            said.append(
                f"{len(rows)} of {len(values)} values of '{name}' cannot have been measured, and are left "
                f"empty: {places(rows, place)}; must be {quantity_of(name)}"
            )
    return kept, said


def places(rows: Ints, place: Callable[[int], str]) -> str:
    """Return the first of some rows by name, and how many there are more."""
    more = f" and {len(rows) - NAMED} more" if len(rows) > NAMED else ""
    return ", ".join(place(int(row)) for row in rows[:NAMED]) + more
