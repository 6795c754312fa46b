"""Documents of nested tables, in TOML and JSON, bounded in size and depth, so that none keeps a reader busy
without end.
"""

from __future__ import annotations

import json
import re
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..errors import InputError
from .text import decode, read_bytes

LARGEST_TOML = 1 << 16  # bytes; what people write by hand has a few thousand
LARGEST_JSON = 1 << 26  # bytes; a record holds no points
DEEPEST = 20  # tables and lists in each other; ours have at most six
MOST_KEYS = 100  # parts of one dotted key: the parser's time grows with their square
HALF = re.compile(
    r"\\u[dD][89a-fA-F]"
)  # of a letter of two: JSON may write it, and no text can hold it alone
WHOLE = range(-(1 << 63), 1 << 63)  # the whole numbers that TOML promises to keep


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read the tables of a TOML file. Raises InputError where it is none, or is too large or too deep."""
    path = Path(path)
    return parse_toml(decode(read_bytes(path, LARGEST_TOML), path), str(path))


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Parse the tables of a TOML text. Raises InputError, which begins with `where`."""
    # a dotted key holds no comma, and no list of numbers is without one
    if any(part.count(".") > MOST_KEYS for part in re.split(r"[=,\n]", text)):
        raise InputError(f"{where}: has a dotted key of more than {MOST_KEYS} parts; write it as a table")
    try:
        tables = tomllib.loads(text)
        bounded(tables, where)
        return tables
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{where}: {error}") from None
    except RecursionError:
        raise InputError(_too_deep(where)) from None
    except ValueError:  # Python reads no whole number of more than 4300 digits
        raise InputError(f"{where}: {_too_long()}") from None


def read_json(path: str | Path) -> Any:
    """Read the value of a JSON file. Raises InputError where it is none, or is too large or too deep."""
    path = Path(path)
    return parse_json(decode(read_bytes(path, LARGEST_JSON), path), str(path))


def parse_json(text: str, where: str) -> Any:
    """Parse the value of a JSON text. Raises InputError, which begins with `where`."""
    try:
        value = json.loads(text, parse_constant=_refuse_constant)
        bounded(value, where)
        if HALF.search(text):
            json.dumps(value, ensure_ascii=False).encode()
        return value
    except UnicodeEncodeError:
        raise InputError(
            f"{where}: has half of a letter (a lone surrogate), which no text can hold"
        ) from None
    except json.JSONDecodeError as error:
        raise InputError(f"{where}: is not JSON: {error}") from None
    except RecursionError:
        raise InputError(_too_deep(where)) from None
    except ValueError as error:
        words = error.args[0] if type(error) is _NoNumber else _too_long()
        raise InputError(f"{where}: {words}") from None


class _NoNumber(ValueError):
    """A JSON text holds NaN or an infinity, which Python writes and JSON does not know."""


def _refuse_constant(word: str) -> None:
    raise _NoNumber(f"is not JSON: {word} is not a number there")


def bounded(value: Any, where: str) -> None:
    """Raise InputError where a value is nested too deep or holds too large a whole number."""
    level, deep = [value], 0
    while level:
        if deep > DEEPEST:
            raise InputError(_too_deep(where))
        if any(type(one) is int and one not in WHOLE for one in level):
            raise InputError(f"{where}: {_too_long()}")
        lists = [one.values() if isinstance(one, dict) else one for one in level if type(one) in (dict, list)]
        level, deep = [one for inner in lists for one in inner], deep + 1


def _too_deep(where: str) -> str:
    return f"{where}: has tables or lists in each other more than {DEEPEST} deep"


def _too_long() -> str:
    return "has a whole number beyond 64 bits: must be within -9223372036854775808 and 9223372036854775807"


def parse_value(text: str) -> Any:
    """Parse a value as TOML writes it, or a number or True and False as Python does; a bare word is a
    text.
    """
    readers = (
        lambda: parse_toml(f"value = {text}", text)["value"],
        lambda: {"True": True, "False": False}[text],
        lambda: float(text),
    )
    for read in readers:
        with suppress(InputError, ValueError, KeyError):
            return read()
    return text
