"""The journal of a session: one line of JSON for each accepted action, on the disk before it is acknowledged.

It is only ever appended to. What a killed process or a full disk left of a last line is cut off, and said.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from errno import ENOSPC
from pathlib import Path
from time import time
from typing import Any, BinaryIO

from ..errors import InputError
from ..io.atomic import write_file
from .messages import Message, action

NAME = "journal.jsonl"
SCHEMA = 1


@dataclass
class Journal:
    """A journal is the open file that records a session. begun: when the session began, in seconds since
    1970; head: what the first line says of the case; actions: those of the file so far, in their order; cut:
    what was cut off the file's end, in words.
    """

    path: Path
    head: Message
    actions: list[Message] = field(default_factory=list)
    cut: str = ""
    file: BinaryIO | None = None

    def append(self, given: Message) -> Message:
        """Write a checked action, wait until it is on the disk, and return the line that was written.

        Raises InputError where it cannot be kept: then it does not count, and the file is as it was.
        """
        line = {"seq": len(self.actions) + 1, "time": round(time() - self.head["begun"], 3), **given}
        self._write_line(line)
        self.actions.append(line)
        return line

    def close(self) -> None:
        """Close the file; a closed journal takes no more."""
        if self.file is not None:
            self.file.close()
            self.file = None

    def _write_line(self, line: Message) -> None:
        if self.file is None:
            raise InputError(f"{self.path}: the session has ended: nothing is taken any more")
        before = self.file.tell()
        try:
            data = _encode_line(line)
            if self.file.write(data) != len(data):
                raise OSError(ENOSPC, os.strerror(ENOSPC))
            os.fsync(self.file.fileno())
        except OSError as error:
            self._cut_back(before)
            raise InputError(
                f"{self.path}: cannot be written: {error.strerror}: not taken; make room, then repeat it"
            ) from error

    def _cut_back(self, size: int) -> None:
        """Cut off what a failed write left; where that fails too the session can take nothing more."""
        try:
            assert self.file is not None
            self.file.truncate(size)
            self.file.seek(size)
        except OSError:
            self.close()


def begin_journal(folder: Path, head: Message, first: Iterable[Message]) -> Journal:
    """Begin a journal in a record folder: what `head` says of the case, and the actions that its files stand
    for; the file appears whole or not at all. Raises InputError where it cannot be written.
    """
    path = folder / NAME
    begun = {"seq": 0, "do": "begin", "schema": SCHEMA, "begun": time(), **head}
    actions = [{"seq": k, "time": 0.0, **action(one)} for k, one in enumerate(first, 1)]
    write_file(path, b"".join(map(_encode_line, (begun, *actions))))
    return Journal(path, begun, actions, file=_open_file(path))


def resume_journal(folder: Path) -> Journal:
    """Open the journal of a record folder, to go on from. Raises InputError where it is not whole, or another
    session has it open.
    """
    path = folder / NAME
    file = _open_file(path)
    try:
        found = read_journal(path)
        if found.cut:
            file.truncate(path.read_bytes().rfind(b"\n") + 1)
            file.seek(0, os.SEEK_END)
    except BaseException:
        file.close()
        raise
    return Journal(path, found.head, found.actions, found.cut, file)


def read_journal(path: Path) -> Journal:
    """Read a journal as it stands in its file, which is not changed. Raises InputError naming the line that
    does not fit; a last line without its end is not counted, and `cut` says so.
    """
    try:
        *lines, rest = path.read_bytes().split(b"\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    if not lines:
        raise InputError(f"{path}: holds no whole line: remove it, and begin again")
    head = _decode_line(lines[0], path, 1)
    if head.get("do") != "begin" or head.get("schema") != SCHEMA or not isinstance(head.get("begun"), float):
        raise InputError(f"{path}: line 1: is not the beginning of a journal of this version of o3dls")
    actions = list(_read_actions(lines[1:], path))
    cut = f"{path}: line {len(lines) + 1} was not written whole ({len(rest)} bytes) and is cut off"
    return Journal(path, head, actions, cut if rest else "")


def _read_actions(lines: list[bytes], path: Path) -> Iterator[Message]:
    for k, text in enumerate(lines, 1):
        line = _decode_line(text, path, k + 1)
        if line.get("seq") != k:
            raise InputError(
                f"{path}: line {k + 1}: has seq {line.get('seq')}, must be {k}: lines are missing"
            )
        try:
            checked = action({key: value for key, value in line.items() if key not in ("seq", "time")})
        except InputError as error:
            raise InputError(f"{path}: line {k + 1}: {error}") from None
        yield {"seq": k, "time": line.get("time"), **checked}


def _encode_line(line: Message) -> bytes:
    return json.dumps(line, ensure_ascii=False, allow_nan=False).encode() + b"\n"


def _decode_line(text: bytes, path: Path, at: int) -> dict[str, Any]:
    try:
        line = json.loads(text)
    except ValueError as error:
        raise InputError(f"{path}: line {at}: is not JSON: {error}; restore the file") from None
    if not isinstance(line, dict):
        raise InputError(f"{path}: line {at}: must be an object")
    return line


def _open_file(path: Path) -> BinaryIO:
    """Open the file without a buffer, so that nothing waits in memory; only one session may have it open."""
    try:
        file = path.open("ab", buffering=0)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    file.seek(0, os.SEEK_END)
    _lock_file(file, path)
    return file


def _lock_file(file: BinaryIO, path: Path) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise InputError(f"{path}: another session writes it: end that one first") from None
