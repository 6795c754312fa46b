"""Which headings of tables, and names of arrays, mean which column of a case, and by which factor a unit in a
heading differs from that of the column.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Ints
from .errors import InputError

AXIS_FORMS: tuple[str, ...] = ("pos {}", "{} pos", "pos{}", "position {}", "{} position", "point {}")
AXIS_FORMS += ("coord {}", "{} coord", "coordinate {}", "{} coordinate")
VOLTAGE_FORMS = ("{} voltage", "{}voltage", "voltage {}", "{} amplitude", "v {}", "{} v")
# column of a case: other names of it, in small letters, with one space for what parts their words
ALIASES: Mapping[str, Sequence[str]] = {
    **{axis: [form.format(axis) for form in AXIS_FORMS] for axis in "xyz"},
    "type": ["kind", "point type"],
    "name": ["label"],
    "bipolar": ["bi", "bip", *(form.format("bipolar") for form in VOLTAGE_FORMS), "bipolare spannung"],
    "unipolar": ["uni", "unip", *(form.format("unipolar") for form in VOLTAGE_FORMS), "unipolare spannung"],
    "lat": ["local activation time", "activation time"],
    "impedance": ["imp"],
    "force": ["contact force", "cf", "kontaktkraft"],
    "sigma": [],
}
MEANT = {alias: name for name, aliases in ALIASES.items() for alias in (name, *aliases)}
VOLTS = {"mv": 1.0, "uv": 1e-3, "v": 1e3}
# unit of a heading: its factor to the unit of the column
UNITS: Mapping[str, Mapping[str, float]] = {
    **{axis: {"mm": 1.0} for axis in "xyz"},
    "bipolar": VOLTS,
    "unipolar": VOLTS,
    "lat": {"ms": 1.0, "s": 1e3, "us": 1e-3},
    "impedance": dict.fromkeys(("ohm", "ohms", "ω"), 1.0),
    "force": dict.fromkeys(("g", "gr", "gf", "gram", "grams"), 1.0),
}
ALL_UNITS = "|".join({unit for units in UNITS.values() for unit in units})
# a unit in brackets may be any word, one behind a gap must be known
UNIT = re.compile(rf"[\s_]*[\[(]\s*([^\])]*?)\s*[\])]$|[\s_]+({ALL_UNITS})$")
DOUBTFUL = {
    "voltage": "bipolar or unipolar",
    "voltages": "bipolar or unipolar",
    "amplitude": "bipolar or unipolar",
}
DOUBTFUL |= {"spannung": "bipolar or unipolar"}
TIME = "time"  # column: when a point was taken
GROUP = "group"  # column: points with the same value were taken at one moment by one catheter
ELECTRODES = 64  # of a catheter: a group of more points is of something else, such as of a chamber


class Meaning(NamedTuple):
    """This is the column of a case that a heading means, with the factor to its unit, and the unit where one
    is stated.
    """

    name: str
    factor: float
    unit: str


def meaning_of(heading: str) -> Meaning | None:
    """Return what a heading means, in any case and with its unit behind; None for all others, and for a unit
    that is not one of that column.
    """
    plain = re.sub("[µμ]", "u", heading.strip().casefold())
    if plain in MEANT:
        return Meaning(MEANT[plain], 1.0, "")
    found = UNIT.search(plain)
    unit = (found[1] or found[2] or "") if found else ""
    name = MEANT.get(" ".join(re.split(r"[\s_\-.:/]+", plain[: found.start()] if found else plain)).strip())
    if name is None or (unit and unit not in UNITS.get(name, {})):
        return None
    return Meaning(name, UNITS[name][unit] if unit else 1.0, unit)


class _Spellings(Mapping[str, str]):
    """The names of columns by all headings that mean them as they are: none of their units differs."""

    def __getitem__(self, heading: str) -> str:
        meant = meaning_of(heading)
        if meant is None or meant.factor != 1.0:
            raise KeyError(heading)
        return meant.name

    def __iter__(self) -> Iterator[str]:
        return iter(MEANT)

    def __len__(self) -> int:
        return len(MEANT)


NAMES: Mapping[str, str] = _Spellings()


class Chosen(dict[str, str]):
    """The names of columns by their headings in small letters: those that are said, else what they mean."""

    def get(self, heading: str, default: Any = None) -> Any:
        """Return the name of a column; one that was said of another heading is no longer free."""
        if heading in self:
            return self[heading]
        name = NAMES.get(heading, default)
        return name if name not in self.values() else f"{default}_" if name == heading else default


def read_choice(columns: str, where: str) -> dict[str, str]:
    """Return the name by heading of `name=heading, ...`. Raises InputError for a name that is none."""
    pairs = [part.partition("=") for part in columns.split(",") if part.strip()]
    for name, sign, heading in pairs:
        if name.strip() not in ALIASES or not sign or not heading.strip():
            raise InputError(
                f"{where}: columns = '{name}{sign}{heading}': must be NAME=HEADING, with a name of "
                f"{', '.join(ALIASES)}"
            )
    return {heading.strip().lower(): name.strip() for name, _, heading in pairs}


def column_table(columns: Mapping[str, str]) -> list[str]:
    """Return the lines of a table that says what became of each column, by its heading."""
    rows = [("column of the points", "became"), *columns.items()] if columns else []
    width = max((len(heading) for heading, _ in rows), default=0)
    return [f"{heading:<{width}}  {what}" for heading, what in rows]


def described(heading: str, name: str, kind: str) -> str:
    """Return what became of a column: the heading of it, its name in the case, and whether it holds text."""
    if name in ALIASES:
        scaled = meaning_of(heading)
        by = f", times {scaled.factor:g}" if scaled and scaled.factor != 1.0 else ""
        return f"taken as {name}{by}"
    if _says(name, TIME) and kind not in "US":
        return f"taken as the order of the points; if it is a lat, say --columns lat={heading}"
    if _says(name, GROUP):
        return f"says which points were taken at one moment; not used if more than {ELECTRODES} share a value"
    doubt = DOUBTFUL.get(name.strip().casefold())
    asked = f"; if it is {doubt}, say --columns NAME={heading}" if doubt else ""
    return f"kept as {'text' if kind in 'US' else 'numbers'}, and not used{asked}"


def times_of(columns: Mapping[str, NDArray[Any]], kinds: NDArray[np.str_]) -> Array | None:
    """Return when each point (n,) was taken, by the column `time`: landmarks without one come first, other
    points last. None where a mapping point has none, or one is below 0, as activation times are.
    """
    values = next((values for name, values in columns.items() if _says(name, TIME)), None)
    if values is None or values.dtype.kind not in "fiu":
        return None
    times = np.asarray(values, dtype=np.float64)
    if not (times[kinds == "eam"] >= 0.0).all():
        return None
    return np.where(np.isnan(times), np.where(kinds == "landmark", -np.inf, np.inf), times)


def moments_of(columns: Mapping[str, NDArray[Any]], kinds: NDArray[np.str_]) -> Ints | None:
    """Return a number (n,) that the mapping points of one moment share, by the column `group`; any other
    point, and one without a value, has its own. None without such a column, and where a group has more points
    than a catheter has electrodes.
    """
    values = next((values for name, values in columns.items() if _says(name, GROUP)), None)
    if values is None:
        return None
    known = kinds == "eam"
    known &= values != "" if values.dtype.kind in "US" else np.isfinite(values.astype(np.float64))
    moments = np.arange(len(kinds)) + len(kinds)  # more than there are groups
    _, moments[known], sizes = np.unique(values[known], return_inverse=True, return_counts=True)
    return None if sizes.max(initial=0) > ELECTRODES else moments


def _says(name: str, column: str) -> bool:
    return name.strip().casefold() == column


def order_of(columns: Mapping[str, NDArray[Any]], kinds: NDArray[np.str_]) -> Array:
    """Return the place of each point (n,) in the order of taking: as they come, without times."""
    times = times_of(columns, kinds)
    rows = np.arange(len(kinds)) if times is None else np.argsort(times, kind="stable")
    return np.argsort(rows).astype(np.float64)
