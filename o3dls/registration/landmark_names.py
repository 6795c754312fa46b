"""Which names of landmarks mean one place: the table of synonyms, and the pairs that two lists of names make.

Only names that surely mean the same place are in the table; all others pair by their own letters.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence

# words of a name, whatever their order and case
WORDS = {
    "l": "left",
    "r": "right",
    "sup": "superior",
    "upper": "superior",
    "inf": "inferior",
    "lower": "inferior",
    "pv": "pulmonary vein",
    "os": "ostium",
    "orifice": "ostium",
    "of": "",
    "the": "",
}
# place: further names of it, written with the words that WORDS gives
VEINS = {
    "LSPV": ("LUPV", "left superior pulmonary vein"),
    "LIPV": ("LLPV", "left inferior pulmonary vein"),
    "LCPV": ("left common pulmonary vein", "left common trunk"),
    "RSPV": ("RUPV", "right superior pulmonary vein"),
    "RMPV": ("right middle pulmonary vein",),
    "RIPV": ("RLPV", "right inferior pulmonary vein"),
    "RCPV": ("right common pulmonary vein", "right common trunk"),
}
PLACES: Mapping[str, Sequence[str]] = {
    **VEINS,
    "LAA": ("left atrial appendage", "LA appendage"),
    "RAA": ("right atrial appendage", "RA appendage"),
    "MA": ("MV", "mitral annulus", "mitral valve", "mitral valve annulus"),
    "TA": ("TV", "tricuspid annulus", "tricuspid valve", "tricuspid valve annulus"),
    "IVC": ("inferior vena cava",),
    "SVC": ("superior vena cava",),
    "CS": ("coronary sinus",),
}


def _split_words(name: str) -> list[str]:
    words = re.split(r"[\s_\-.,()]+", name.casefold())
    return sorted(part for word in words for part in WORDS.get(word, word).split())


KNOWN = {tuple(_split_words(name)): place for place, more in PLACES.items() for name in (place, *more)}


def is_known(name: str) -> bool:
    """Return whether a name is in the table, or that of the ostium of a place there."""
    return _without_ostium(name) in KNOWN


def _without_ostium(name: str) -> tuple[str, ...]:
    return tuple(word for word in _split_words(name) if word != "ostium")


def _place_meant(name: str) -> str:
    """Return what a name means: a place of the table or its ostium, else its letters, whatever their case and
    spaces.
    """
    known = KNOWN.get(_without_ostium(name))
    if known is None:
        return " ".join(name.casefold().replace("_", " ").split())
    return f"{known} ostium" if "ostium" in _split_words(name) else known


def _place_or_vein(name: str) -> str:
    """Return what `_place_meant` does, but the vein for the ostium of a vein. The ostium of another place is
    not that place.
    """
    known = KNOWN.get(_without_ostium(name))
    return known if known in VEINS else _place_meant(name)


def partners(names: Sequence[str], others: Sequence[str]) -> dict[int, int]:
    """Map the index of each name that has a partner among the others to the partner's index.

    Equal names are partners, then those that mean the same, then a vein and its ostium; each only where one
    name of either side is left that could be.
    """
    found: dict[int, int] = {}
    for meaning in (str, _place_meant, _place_or_vein):
        mine = {i: meaning(name) for i, name in enumerate(names) if i not in found}
        theirs = {j: meaning(name) for j, name in enumerate(others) if j not in found.values()}
        often = Counter(mine.values()), Counter(theirs.values())
        single = {meant: j for j, meant in theirs.items() if often[0][meant] == often[1][meant] == 1}
        found |= {i: single[meant] for i, meant in mine.items() if meant in single}
    return dict(sorted(found.items()))


def alone(names: Sequence[str], others: Sequence[str]) -> list[str]:
    """Return the names without a partner among the others."""
    paired = partners(names, others)
    return [name for i, name in enumerate(names) if i not in paired]
