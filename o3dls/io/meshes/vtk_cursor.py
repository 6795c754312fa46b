"""A place in a legacy VTK file: hands out lines, and numbers in ascii or big-endian binary."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...arrays import Array, Ints
from ...errors import InputError
from ..text import check_numbers, integers, is_count, is_missing, plain_missing

TYPES = {
    **dict.fromkeys(("bit", "unsigned_char"), "u1"),
    "char": "i1",
    "unsigned_short": "u2",
    "short": "i2",
    **dict.fromkeys(("unsigned_int", "vtktypeuint32"), "u4"),
    **dict.fromkeys(("int", "vtkIdType", "vtktypeint32"), "i4"),
    **dict.fromkeys(("unsigned_long", "vtktypeuint64"), "u8"),
    **dict.fromkeys(("long", "vtktypeint64"), "i8"),
    "float": "f4",
    "double": "f8",
}


class Cursor:
    """A cursor reads a VTK file on from the place `at`. Every error names the file and the line or byte where
    the cursor stands.
    """

    def __init__(self, path: Path, data: bytes) -> None:
        self.path = path
        self.data = data
        self.at = 0
        self.binary = False

    @property
    def place(self) -> str:
        line = self.data.count(b"\n", 0, max(self.at - 1, 0)) + 1
        return f"{self.path}: byte {self.at}" if self.binary else f"{self.path}: line {line}"

    def error(self, text: str) -> InputError:
        return InputError(f"{self.place}: {text}")

    def line(self) -> str:
        """Return the next line, without its end; empty at the end of the file."""
        end = self.data.find(b"\n", self.at)
        end = len(self.data) if end < 0 else end
        line = self.data[self.at : end]
        self.at = end + 1
        return line.decode("utf-8", errors="replace").strip()

    def words(self) -> list[str]:
        """Return words of the next line that is not blank; none at the end of the file."""
        while self.at < len(self.data):
            if words := self.line().split():
                return words
        return []

    def choice(self, *allowed: str) -> str:
        """Read the next line, which must be one of those allowed."""
        found = " ".join(self.words()).upper()
        if found not in allowed:
            raise self.error(f"'{found[:60]}' must be {' or '.join(allowed)}")
        return found

    def expect(self, keyword: str) -> list[str]:
        words = self.words()
        if words[:1] != [keyword]:
            raise self.error(f"'{' '.join(words)[:60]}' must be {keyword}")
        return words

    def count(self, word: str) -> int:
        """Return a number of things, which the rest of the file must be able to hold."""
        if not is_count(word) or int(word) > len(self.data):
            raise self.error(f"'{word[:20]}' is not a count that a file of {len(self.data)} bytes can hold")
        return int(word)

    def numbers(self, n: int, kind: str) -> Array:
        """Return the next n numbers of a VTK type, as float64."""
        if kind not in TYPES:
            raise self.error(f"'{kind[:20]}' is not a VTK type; there are {', '.join(TYPES)}")
        return self._binary_numbers(n, kind) if self.binary else self._ascii_numbers(n)

    def integers(self, n: int, kind: str) -> Ints:
        """Return the next n numbers, which must be whole."""
        place = self.place
        return integers(self.numbers(n, kind), f"{place} and below")

    def _binary_numbers(self, n: int, kind: str) -> Array:
        dtype = np.dtype(">" + TYPES[kind])
        size = (n + 7) // 8 if kind == "bit" else n * dtype.itemsize
        block = self.data[self.at : self.at + size]
        if len(block) < size:
            raise self.error(
                f"{size} bytes of data are declared, {len(block)} are left: the file is truncated"
            )
        self.at += size
        values = np.frombuffer(block, dtype)
        return (np.unpackbits(values)[:n] if kind == "bit" else values).astype(np.float64)

    def _ascii_numbers(self, n: int) -> Array:
        words = list[bytes]()
        start = self.at
        while len(words) < n:
            end = self.data.find(b"\n", self.at)
            end = len(self.data) if end < 0 else end
            line = self.data[self.at : end].split()
            if self.at >= len(self.data) or (line and line[0][:1].isalpha() and not _is_value(line[0])):
                raise self.error(f"{n} numbers are declared, {len(words)} are there")
            words += line
            self.at = end + 1
        if len(words) > n:
            raise self.error(f"{n} numbers are declared, {len(words)} are there")
        try:
            if b"_" in self.data[start : self.at]:
                self._check_lines(start)  # numpy would take 1_0 for 10
            return np.array(words, dtype=np.float64) if words else np.zeros(0)
        except ValueError:
            self._check_lines(start)
            text = b" ".join(words).decode("ascii")
            return np.array(plain_missing(text).split(), dtype=np.float64)

    def _check_lines(self, start: int) -> None:
        """Raise InputError naming the first line, of those read from `start` on, with a word that is no
        number.
        """
        for line in self.data[start : self.at].split(b"\n"):
            self.at = start = start + len(line) + 1
            words = [word.decode("ascii", errors="replace") for word in line.split()]
            check_numbers(words, len(words), self.place, "value")

    def skip_block(self) -> None:
        """Skip the lines up to the blank one that ends a METADATA block."""
        while self.at < len(self.data) and self.line():
            pass

    def skip_strings(self, n: int) -> None:
        """Skip n strings: lines in ascii; in binary the two top bits of the first byte say how wide the
        length is.
        """
        for _ in range(n):
            if not self.binary:
                self.line()
                continue
            if self.at >= len(self.data):
                raise self.error("a string is missing: the file is truncated")
            width = 8 >> (self.data[self.at] >> 6)
            head = int.from_bytes(self.data[self.at : self.at + width], "big") & ((1 << (8 * width - 2)) - 1)
            self.at += width + head


def _is_value(word: bytes) -> bool:
    """Return whether a word that begins with a letter may stand where a number is expected."""
    return word.lower() == b"inf" or is_missing(word.decode("ascii", errors="replace"))
