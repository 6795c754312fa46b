"""What travels in a live session, as plain dicts that JSON holds: actions towards the engine, checked here;
events from the engine, made here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

from ..errors import CONTROL, InputError, did_you_mean
from ..geometry.similarity import is_pose
from ..io.points import NAMES, NUMBERS
from ..quantities import QUANTITIES

Message = dict[str, Any]
TYPES = ("eam", "inside", "ablation", "outlier")  # of a point; an outlier is kept in the journal alone
RESERVED = ("x", "y", "z", "type", "id")  # columns that a value may not be named
FARTHEST = 1e5  # units of the case: a coordinate beyond is no place in a patient


def action(given: object) -> Message:
    """Check an action and return it with its keys in order and its numbers as floats, as the journal writes
    it.

    Raises InputError where it is none: what is wrong, where, and what would be right.
    """
    if not isinstance(given, Mapping) or not isinstance(given.get("do"), str):
        raise InputError('an action must be an object with a key "do"')
    kind = given["do"]
    if kind not in _ACTIONS:
        raise InputError(f"no action '{kind}'" + did_you_mean(kind, list(_ACTIONS)))
    required, optional = _ACTIONS[kind]
    for key in given:
        if key not in {"do", *required, *optional}:
            raise InputError(f"{kind}: no key '{key}'" + did_you_mean(str(key), [*required, *optional]))
    if missing := [key for key in required if key not in given]:
        raise InputError(f"{kind}: '{missing[0]}' is missing")
    found = {"do": kind} | {
        key: _CHECKS[key](f"{kind}: {key}", given[key]) for key in (*required, *optional) if key in given
    }
    if kind == "landmark" and ("xyz" in found) == ("next" in found):
        raise InputError('landmark: must have either "xyz" or "next": true')
    if kind == "take":
        return {"type": "eam", "values": {}} | found
    return found


def event(kind: str, **content: Any) -> Message:
    """Make an event, whose number `seq` is given where it is sent: scene, surface, point, weights, state,
    error or end.
    """
    return {"event": kind, **content}


def error(text: str) -> Message:
    """Make the event that says what was refused, and why."""
    return event("error", text=text)


def number(value: float | None) -> float | None:
    """Return a number as JSON may hold it: None where it is not finite."""
    return None if value is None or not math.isfinite(value) else float(value)


def _is_finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _check_place(where: str, value: object) -> list[float]:
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 3:
        raise InputError(f"{where} = {value!r}: must be three numbers")
    for one in value:
        if not _is_finite(one) or abs(one) > FARTHEST:
            raise InputError(f"{where} = {list(value)}: must be three finite numbers within {FARTHEST:g}")
    return [float(v) for v in value]


def _check_type(where: str, value: object) -> str:
    if value not in TYPES:
        raise InputError(f"{where} = {value!r}: no type of a point" + did_you_mean(str(value), list(TYPES)))
    return str(value)


def _check_values(where: str, value: object) -> dict[str, float | str]:
    if not isinstance(value, Mapping):
        raise InputError(f"{where}: must be an object of names and values")
    found: dict[str, float | str] = {}
    for given, one in value.items():
        name = NAMES.get(str(given).lower(), given)  # the same aliases as for columns of a points file
        if not isinstance(name, str) or not name.strip() or CONTROL.search(name) or name in RESERVED:
            raise InputError(f"{where}: {given!r} names no value: must be a word, none of {RESERVED}")
        found[name] = _check_value(f"{where}: {name} = {one!r}", name, one)
    return found


def _check_value(where: str, name: str, value: object) -> float | str:
    """Check a number or a text, as columns of points may hold it."""
    if isinstance(value, str) and name not in NUMBERS:
        if CONTROL.search(value):
            raise InputError(f"{where}: holds a line break or a control character")
        return value
    if not _is_finite(value) or name == "name":
        kind = "a text" if name == "name" else "a finite number"
        raise InputError(f"{where}: must be {kind}{'' if name in (*NUMBERS, 'name') else ' or a text'}")
    number = float(cast(float, value))
    if name == "sigma" and number <= 0.0:
        raise InputError(f"{where}: is a noise level and must be above 0")
    if name in QUANTITIES and not QUANTITIES[name].can_be(number):
        raise InputError(f"{where}: must be {QUANTITIES[name]}; leave it out where there is none")
    return number


def _check_number(where: str, value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise InputError(f"{where} = {value!r}: must be the number of a point: 1, 2, ...")
    return value


def _check_name(where: str, value: object) -> str:
    if not isinstance(value, str) or not value.strip() or CONTROL.search(value):
        raise InputError(f"{where} = {value!r}: must be a name")
    return value.strip()


def _check_next(where: str, value: object) -> bool:
    if value is not True:
        raise InputError(f"{where} = {value!r}: must be true, or not there")
    return True


def _check_matrix(where: str, value: object) -> list[list[float]]:
    rows = list(value) if isinstance(value, Sequence) and not isinstance(value, str) else []
    if len(rows) != 4 or not all(
        isinstance(row, Sequence) and len(row) == 4 and all(map(_is_finite, row)) for row in rows
    ):
        raise InputError(f"{where}: must be four rows of four finite numbers")
    import numpy as np

    if not is_pose(np.array(rows, dtype=np.float64), 3):
        raise InputError(f"{where}: is no pose: it must be a rotation, a shift and one scale")
    return [[float(v) for v in row] for row in rows]


# what an action must have, and may have
_ACTIONS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "take": (("xyz",), ("type", "values")),
    "undo": ((), ("point",)),
    "retype": (("point", "type"), ()),
    "label": (("point", "values"), ()),
    "prior_landmark": (("name", "xyz"), ()),
    "landmark": (("name",), ("xyz", "next")),
    "pose": (("matrix",), ()),
    "fit": ((), ()),
    "end": ((), ()),
}
_CHECKS: Mapping[str, Callable[[str, object], Any]] = {
    "xyz": _check_place,
    "type": _check_type,
    "values": _check_values,
    "point": _check_number,
    "name": _check_name,
    "next": _check_next,
    "matrix": _check_matrix,
}
