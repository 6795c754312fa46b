"""Bytes and numbers out of files, with errors that name file and line."""

from __future__ import annotations

import csv
import hashlib
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Ints
from ..errors import InputError
from .kinds import kind_of

LARGEST_WHOLE = 1 << 53
LARGEST_FILE = 1 << 31  # bytes: it is held in memory, and more than once
_hashes: ContextVar[dict[Path, str] | None] = ContextVar("hashes", default=None)
MARKS = {  # those of UTF-32 first, one of which begins as one of UTF-16
    b"\xff\xfe\0\0": "utf-32",
    b"\0\0\xfe\xff": "utf-32",
    b"\xff\xfe": "utf-16",
    b"\xfe\xff": "utf-16",
}
# what C libraries print for NaN (Microsoft's 1.#QNAN is 1.#R once rounded), and R, pandas, SQL, Excel, people
NAN = r"nan[qs]?(?:\([\w-]*\))?|1\.#\w*|n/?a|<na>|#n/a|#nv|null|nil|none|missing|invalid"
MISSING = re.compile(rf"[-+]?(?:{NAN})", re.IGNORECASE)
MISSING_WORDS = re.compile(rf"(?<!\S)(?!nan(?!\S))[-+]?(?:{NAN})(?!\S)", re.IGNORECASE)


def read_bytes(path: str | Path, most: int = LARGEST_FILE) -> bytes:
    """Read the content of a file. Raises InputError where it is missing, a folder, a pipe, empty, larger than
    `most` bytes or not readable.
    """
    path = Path(path)
    _check_regular(path)
    try:
        if (size := path.stat().st_size) > most:
            raise InputError(f"{path}: has {size} bytes: must be at most {most}")
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    if not data:
        raise InputError(f"{path}: is empty")
    if (hashes := _hashes.get()) is not None:
        digest = hashlib.sha256(data).hexdigest()
        if hashes.setdefault(path.absolute(), digest) != digest:
            raise InputError(f"{path}: was changed while it was read; try again once it is whole")
    return data


def _check_regular(path: Path) -> None:
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name a file")
    if not path.is_file():  # it can be read only once, or never ends
        raise InputError(f"{path}: is a pipe or a device, no regular file; save it as a file first")


def read_head(path: Path, most: int) -> bytes:
    """Read the first bytes of a file that need not fit into memory, at most so many. Raises InputError as
    `read_bytes`.
    """
    _check_regular(path)
    try:
        with path.open("rb") as file:
            data = file.read(most)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    if not data:
        raise InputError(f"{path}: is empty")
    return data


@contextmanager
def hashed_reads() -> Iterator[dict[Path, str]]:
    """Yield a dict that gets the SHA-256 of each file that the block reads by `read_bytes`: of what was read,
    whatever becomes of the file. Raises InputError where it is read twice and is another one.
    """
    found: dict[Path, str] = {}
    token = _hashes.set(found)
    try:
        yield found
    finally:
        _hashes.reset(token)


def as_utf8(data: bytes) -> bytes:
    """Return the bytes of a text that begins with the mark of UTF-16 or UTF-32 (Excel's "Unicode text") as
    UTF-8; all others unchanged.
    """
    encoding = next((name for mark, name in MARKS.items() if data.startswith(mark)), None)
    if encoding is None:
        return data
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        return data
    if "\0" in text:
        return data
    return re.sub(r"\A(<\?xml[^>]*?)\s+encoding=([\"'])[^\"']*\2", r"\1", text).encode()


def decode(data: bytes, path: str | Path) -> str:
    """Decode text from UTF-8, from UTF-16 with its mark, else cp1252 (clinical systems write all of them).
    Raises InputError for binary content.
    """
    data = as_utf8(data)
    if b"\0" in data[:4096]:
        raise InputError(f"{path}: is {kind_of(data) or 'binary where text was expected'}")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def cells_of(line: str, delimiter: str, where: str) -> list[str]:
    """Return the cells of one line of CSV. Raises InputError, which begins with `where`."""
    try:
        return next(csv.reader([line], delimiter=delimiter))
    except csv.Error as error:  # such as a cell of more than 131072 letters
        raise InputError(f"{where}: is not a line of cells: {error}") from None


def number_rows(lines: Sequence[str], columns: int, path: str | Path, at: Sequence[int], what: str) -> Array:
    """Return exactly `columns` numbers from every line, (n, columns); `at` holds their line numbers. Raises
    InputError that names one.
    """
    if not lines:
        return np.zeros((0, columns))
    rows = rectangle(lines)
    if rows is None:
        rows = rectangle([plain_missing(line) for line in lines])
    if rows is not None and rows.shape[1] == columns:
        return rows
    for number, line in zip(at, lines, strict=True):
        check_numbers(line.split(), columns, f"{path}: line {number}", what)
    raise InputError(f"{path}: line {at[0]}: {what} cannot be read as rows of {columns} numbers")


def rectangle(lines: Sequence[str]) -> Array | None:
    """Return the numbers of lines that all hold equally many, (n, columns); None where they do not, or a word
    is no number.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # numpy warns where all lines are blank
            rows = np.loadtxt(lines, dtype=np.float64, comments=None, ndmin=2)
    except (ValueError, UserWarning):
        return None
    return rows if len(rows) == len(lines) else None


def is_missing(word: str) -> bool:
    """Return whether a word of a file says that there is no number."""
    return MISSING.fullmatch(word) is not None


def plain_missing(text: str) -> str:
    """Return text of numbers with `nan` for every word that says that there is none."""
    return MISSING_WORDS.sub("nan", text)


def number(word: str) -> float:
    """Return the number that a word of a file stands for. Raises ValueError, also for `1_0`, which Python
    itself takes for 10.
    """
    if "_" in word:
        raise ValueError(word)
    return float(word)


def check_numbers(cells: Sequence[str], columns: int, where: str, what: str) -> None:
    """Raise InputError unless there are `columns` cells and each is a number."""
    for cell in cells:
        if re.fullmatch(r"[-+]?\d+,\d+", cell):
            raise InputError(f"{where}: {what} '{cell}' has a decimal comma; write a decimal point")
        try:
            number(plain_missing(cell))
        except ValueError:
            raise InputError(f"{where}: {what} '{cell[:40]}' is not a number") from None
    if len(cells) != columns:
        raise InputError(f"{where}: {what} has {len(cells)} numbers: must be {columns}")


def flat_numbers(text: str, count: int, where: str) -> Array:
    """Return the `count` numbers of a block of text, however it is broken into lines. Raises InputError
    naming `where`.
    """
    words = text.split()
    if len(words) != count:
        raise InputError(f"{where}: has {len(words)} numbers: must be {count}")
    if "_" in text:
        check_numbers(words, count, where, "value")  # numpy would take 1_0 for 10
    try:
        return np.array(words, dtype=np.float64)
    except ValueError:
        check_numbers(words, count, where, "value")
        return np.array(plain_missing(text).split(), dtype=np.float64)


def join_rows(form: str, rows: NDArray[Any]) -> str:
    """Return one line per row, each written by the %-format `form`: the whole table in one operation, which
    is what makes it quick.

    Columns that hold one value only, such as the empty slots of a map, are written into the format first.
    """
    if rows.ndim == 2 and len(rows) > 1:
        pieces = re.findall(r"[^%]*%[^dfg]*[dfg][^%]*", form)
        constant = (rows == rows[0]).all(axis=0)
        form = "".join(
            piece % value if same else piece
            for piece, value, same in zip(pieces, rows[0].tolist(), constant, strict=True)
        )
        rows = rows[:, ~constant]
    return (form * len(rows)) % tuple(rows.ravel().tolist())


def is_count(word: str) -> bool:
    """Return whether a word is a plain whole number of at most twelve digits."""
    return word.isascii() and word.isdecimal() and len(word) <= 12


def listed(numbers: Sequence[int]) -> str:
    """Return numbers in order as a range, or one by one where some between them are missing."""
    whole = numbers[-1] - numbers[0] == len(numbers) - 1
    return f"{numbers[0]} to {numbers[-1]}" if whole else ", ".join(map(str, numbers))


def integers(values: Array, where: str) -> Ints:
    """Return the same numbers as int64. Raises InputError where one is not a whole number."""
    bad = ~(np.abs(values) < LARGEST_WHOLE) | (values != np.floor(values))  # written so that NaN is bad, too
    if bad.any():
        raise InputError(f"{where}: {values[bad][0]:g} must be a whole number")
    return values.astype(np.int64)


def typed(values: Array, kind: str) -> NDArray[Any]:
    """Return numbers in the type `kind` of numpy that a file declares: int64 where that is of whole numbers
    and they are, by which labels are told from measurements.
    """
    whole = kind[0] in "iu" and (np.abs(values) < LARGEST_WHOLE).all() and (values == np.floor(values)).all()
    return values.astype(np.int64) if whole else values
