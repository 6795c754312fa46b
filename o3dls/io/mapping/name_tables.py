"""The tables of what columns, quantities, tags and names of places mean, as `o3dls names` prints them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from ...columns import ALIASES, UNITS
from ...quantities import QUANTITIES, WORDS_FOR_NONE
from ...registration.landmark_names import PLACES
from .tags import KINDS

SPECIAL = {
    "LSPV": "LUPV beside LLPV, LOPV beside LUPV, LBPV beside LOPV",
    "LIPV": "LLPV, LUPV beside LOPV, LOPV beside LBPV",
    "RSPV": "RUPV beside RLPV, ROPV beside RUPV, RBPV beside ROPV",
    "RIPV": "RLPV, RUPV beside ROPV, ROPV beside RBPV",
}
SPELT = {"mv": "mV", "uv": "µV", "v": "V", "us": "µs", "ω": "Ω"}
BECOMES = {
    "ablation": "an ablation point",
    "in the blood": "a point of type inside where it lies deep inside the shell, else left out",
    "in the blood or on the wall": "a point of type inside where it lies deep inside the shell, else eam",
}


def columns() -> list[str]:
    """Return the headings that mean each column of a case, and the units that they may state."""
    rows = []
    for name, aliases in ALIASES.items():
        units = [unit if factor == 1.0 else f"{unit} (times {factor:g})" for unit, factor in _units(name)]
        rows.append((f"`{name}`", ", ".join(aliases), ", ".join(units)))
    return _table(("column", "also", "units"), rows)


def _units(name: str) -> list[tuple[str, float]]:
    return [(SPELT.get(unit, unit), by) for unit, by in UNITS.get(name, {}).items()]


def quantities() -> list[str]:
    """Return the values that each quantity can have, and the numbers that stand for none there."""
    rows = []
    for name, quantity in QUANTITIES.items():
        words = [f"{word:g}" for word in WORDS_FOR_NONE if not quantity.least <= word <= quantity.most]
        within = f"{quantity.least:g} to {quantity.most:g} {quantity.unit}".rstrip()
        rows.append((name, within, ", ".join(words)))
    return _table(("quantity", "within", "stand for none"), rows)


def tags() -> list[str]:
    """Return what the tags of points in CARTO and OpenEP become."""
    return _table(("tags", "become"), [(", ".join(names), BECOMES[kind]) for kind, names in KINDS.items()])


def places() -> list[str]:
    """Return the names that mean each place."""
    rows = [
        (place, "; ".join([*more, *([SPECIAL[place]] if place in SPECIAL else [])]))
        for place, more in PLACES.items()
    ]
    return _table(("place", "also"), rows)


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> list[str]:
    lines = [head, tuple("---" for _ in head), *rows]
    return [f"| {' | '.join(line)} |".replace("| ---", "|---").replace("--- |", "---|") for line in lines]


TABLES: Mapping[str, Callable[[], list[str]]] = {
    "columns": columns,
    "quantities": quantities,
    "tags": tags,
    "places": places,
}
