"""Operations of the system that fail on demand: the n-th of a kind, in what a test does below one folder."""

from __future__ import annotations

import builtins
import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ERRORS: dict[str, Callable[[], BaseException]] = {
    "open": lambda: OSError(errno.EMFILE, "Too many open files"),
    "write": lambda: OSError(errno.ENOSPC, "No space left on device"),
    "fsync": lambda: OSError(errno.EIO, "Input/output error"),
    "replace": lambda: OSError(errno.EACCES, "Permission denied"),
    "mkdir": lambda: OSError(errno.EDQUOT, "Disk quota exceeded"),
    "fork": lambda: BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable"),
    "allocation": MemoryError,
}
MOST = 2000  # operations of one kind: a command that needs more does not end


class Failing:
    """Counts the operations of one kind; the n-th fails."""

    def __init__(self, kind: str, number: int, folder: Path) -> None:
        self.kind, self.number, self.folder = kind, number, str(folder.resolve())
        self.count = 0
        self.over = False  # what is looked at afterwards is not counted

    @property
    def fired(self) -> bool:
        return self.count >= self.number

    def pass_by(self, kind: str, path: Any = None) -> None:
        """Count an operation; raise where it is the one that fails."""
        if self.over or kind != self.kind or (path is not None and not self.concerns(path)):
            return
        self.count += 1
        if self.count == self.number:
            raise ERRORS[kind]()

    def concerns(self, path: Any) -> bool:
        if isinstance(path, int):
            try:
                path = os.readlink(f"/proc/self/fd/{path}")
            except OSError:
                return False
        return os.path.abspath(os.fsdecode(path)).startswith(self.folder)


class File:
    """A file whose writing may fail."""

    def __init__(self, file: Any, shim: Failing) -> None:
        self._file, self._shim = file, shim

    def write(self, data: Any) -> int:
        try:
            self._shim.pass_by("write")
        except OSError:
            self._file.write(data[: len(data) // 2])  # a disk that fills up keeps the first part
            raise
        return int(self._file.write(data))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __enter__(self) -> File:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __iter__(self) -> Iterator[Any]:
        return iter(self._file)


@contextmanager
def failing(kind: str, number: int, folder: Path) -> Iterator[Failing]:
    """Let the n-th operation of a kind below a folder fail within this."""
    shim = Failing(kind, number, folder)
    opened = io.open

    def open_(file: Any, mode: str = "r", *args: Any, **kwargs: Any) -> Any:
        if not set(mode) & set("wax+"):
            return opened(file, mode, *args, **kwargs)
        if not isinstance(file, int):
            shim.pass_by("open", file)
        found = opened(file, mode, *args, **kwargs)
        return (
            File(found, shim)
            if kind == "write" and not isinstance(file, int) and shim.concerns(file)
            else found
        )

    def before(kind: str, function: Callable[..., Any], at: int | None = 0) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            shim.pass_by(kind, None if at is None else args[at])
            return function(*args, **kwargs)

        return call

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(io, "open", open_)
        patched.setattr(builtins, "open", open_)
        patched.setattr(os, "fsync", before("fsync", os.fsync))
        patched.setattr(os, "replace", before("replace", os.replace, 1))
        patched.setattr(os, "mkdir", before("mkdir", os.mkdir))
        patched.setattr(util, "spawnv_passfds", before("fork", util.spawnv_passfds, None))
        if kind == "allocation":
            for name in ("zeros", "empty", "concatenate", "column_stack"):
                patched.setattr(np, name, before("allocation", getattr(np, name), None))
        yield shim


def each_failure(kind: str, folder: Path, first: int = 1, step: int = 1) -> Iterator[Failing]:
    """Yield a shim again and again, for the first operation, the second, ..., until none fails any more."""
    for number in range(first, MOST, step):
        with failing(kind, number, folder) as shim:
            yield shim
        if not shim.fired:
            return
    raise AssertionError(f"more than {MOST} operations of the kind {kind}")
