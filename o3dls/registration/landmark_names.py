"""Which names of landmarks mean one place: the table of synonyms, and the pairs that two lists of names make.

Only names that surely mean the same place are in the table; all others pair by their own letters. What an
abbreviation means depends on the names beside it: LUPV is the left upper vein beside LLPV, and the left lower
one (untere) beside LOPV, which is the upper one in German and, beside LBPV, the lower one in Dutch.
"""

from __future__ import annotations

import re
import unicodedata
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
    # German, Dutch
    **dict.fromkeys(("linke", "linker", "links"), "left"),
    **dict.fromkeys(("rechte", "rechter", "rechts"), "right"),
    **dict.fromkeys(("obere", "oberer", "oben", "boven", "bovenste"), "superior"),
    **dict.fromkeys(("untere", "unterer", "unten", "onder", "onderste"), "inferior"),
    **dict.fromkeys(("pulmonalvene", "lungenvene", "longvene"), "pulmonary vein"),
    # French, Italian, Spanish
    **dict.fromkeys(("gauche", "sinistra", "izquierda"), "left"),
    **dict.fromkeys(("droite", "destra", "derecha"), "right"),
    **dict.fromkeys(("superieure", "superiore"), "superior"),
    **dict.fromkeys(("inferieure", "inferiore"), "inferior"),
    **dict.fromkeys(("pulmonaire", "polmonare", "pulmonar"), "pulmonary"),
    **dict.fromkeys(("veine", "vena"), "vein"),
}
GERMAN = ("obere", "oberer", "oben", "untere", "unterer", "unten", "pulmonalvene", "lungenvene")
DUTCH = ("boven", "bovenste", "onder", "onderste", "longvene")
ENGLISH = ("upper", "lower")
SHORT = re.compile(r"([lr])([uoblsi])pv")  # names of veins whose second letter says the height
# place: further names of it, written with the words that WORDS gives
VEINS = {
    "LSPV": ("left superior pulmonary vein",),
    "LIPV": ("left inferior pulmonary vein",),
    "LCPV": ("left common pulmonary vein", "left common trunk"),
    "RSPV": ("right superior pulmonary vein",),
    "RMPV": ("right middle pulmonary vein",),
    "RIPV": ("right inferior pulmonary vein",),
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
    return sorted(part for word in _plain_words(name) for part in WORDS.get(word, word).split())


def _plain_words(name: str) -> list[str]:
    """Return the words of a name in small letters without accents."""
    plain = "".join(c for c in unicodedata.normalize("NFKD", name.casefold()) if not unicodedata.combining(c))
    return re.split(r"[\s_\-.,()]+", plain)


KNOWN = {tuple(_split_words(name)): place for place, more in PLACES.items() for name in (place, *more)}


def is_known(name: str) -> bool:
    """Return whether a name is in the table, that of the ostium of a place there, or short for a vein."""
    return _without_ostium(name) in KNOWN or _short(name) is not None


def _short(name: str) -> re.Match[str] | None:
    """Return the side and the letter of the height in a short name of a vein or its ostium."""
    words = [word for word in _plain_words(name) if WORDS.get(word) != "ostium"]
    return SHORT.fullmatch("".join(words))


def _without_ostium(name: str) -> tuple[str, ...]:
    return tuple(word for word in _split_words(name) if word != "ostium")


def _height_by_letter(names: Sequence[str]) -> dict[str, str]:
    """Return what the second letter of a short name says where the names beside it tell: S or I. The upper
    and the lower vein are upper and lower (U, L), obere and untere (O, U), or boven and onder (B, O).
    """
    words = {word for name in names for word in _plain_words(name)}
    letters = {found[2] for name in names if (found := _short(name))}
    spoken = [
        dict(zip(pair, "SI", strict=True))
        for pair, language in (("ul", ENGLISH), ("ou", GERMAN), ("bo", DUTCH))
        if letters >= set(pair) or words & set(language)
    ]
    return {"s": "S", "i": "I", "l": "I"} | (spoken[0] if len(spoken) == 1 else {})


def _meanings(names: Sequence[str]) -> list[str | None]:
    """Return what each of the names of one side means: a place of the table or its ostium, else its letters,
    whatever their case and spaces; None where the names beside it leave that in doubt.
    """
    heights = _height_by_letter(names)
    short = list(map(_short, names))
    named = {f"{one[1]}{heights[one[2]]}PV".upper() for one in short if one and one[2] in heights}
    named |= {KNOWN[words] for words in map(_without_ostium, names) if words in KNOWN}
    found: list[str | None] = []
    for name, one in zip(names, short, strict=True):
        place: str | None
        if one is None:
            place = KNOWN.get(_without_ostium(name), " ".join(name.casefold().replace("_", " ").split()))
        elif one[2] in heights:
            place = f"{one[1]}{heights[one[2]]}PV".upper()
        else:  # where the one vein of this side has another name, it is the other one
            free = [height for height in "SI" if f"{one[1]}{height}PV".upper() not in named]
            place = f"{one[1]}{free[0]}PV".upper() if len(free) == 1 else None
        known = place in PLACES and "ostium" in _split_words(name)
        found.append(f"{place} ostium" if known else place)
    return found


def _veins(meanings: Sequence[str | None]) -> list[str | None]:
    """Return the vein for the ostium of a vein. The ostium of another place is not that place."""
    of_vein = {f"{vein} ostium": vein for vein in VEINS}
    return [of_vein.get(meant or "", meant) for meant in meanings]


def partners(names: Sequence[str], others: Sequence[str]) -> dict[int, int]:
    """Map the index of each name that has a partner among the others to the partner's index.

    Equal names are partners unless the names beside them say that they mean two places, then those that mean
    the same, then a vein and its ostium; each only where one name of either side is left that could be. A
    name in doubt has no other partner.
    """
    found: dict[int, int] = {}
    meant = _meanings(names), _meanings(others)
    for mine, theirs in ((names, others), meant, (_veins(meant[0]), _veins(meant[1]))):
        left = {i: one for i, one in enumerate(mine) if i not in found and one is not None}
        right = {j: one for j, one in enumerate(theirs) if j not in found.values() and one is not None}
        often = Counter(left.values()), Counter(right.values())
        single = {one: j for j, one in right.items() if often[0][one] == often[1][one] == 1}
        pairs = {i: single[one] for i, one in left.items() if one in single}
        if mine is names:  # equal names are of two languages where they mean two places
            pairs = {i: j for i, j in pairs.items() if not _differ(meant[0][i], meant[1][j])}
        found |= pairs
    return dict(sorted(found.items()))


def _differ(one: str | None, other: str | None) -> bool:
    return None not in (one, other) and one != other


def alone(names: Sequence[str], others: Sequence[str]) -> list[str]:
    """Return the names without a partner among the others."""
    paired = partners(names, others)
    return [name for i, name in enumerate(names) if i not in paired]


def doubts(names: Sequence[str], others: Sequence[str]) -> str:
    """Return a sentence on names without a partner that may mean either of two places; empty where none
    does.
    """
    left = alone(names, others)
    meant = zip(names, _meanings(names), strict=True)
    found = [name for name, place in meant if place is None and name in left]
    if not found:
        return ""
    return (
        f"{', '.join(found)} may be upper or lower veins (U: upper, or untere in German; O: obere in German, "
        "or onder in Dutch), so they pair with no other name: write LSPV, LIPV, RSPV, RIPV"
    )
