"""Files and folders that appear whole or not at all: made under a hidden name beside their place, then renamed."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import InputError

REPLACEABLE = ("run.json", "case.toml", "paper_results.json")  # only a folder that holds one of these, or nothing, is ever overwritten
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # disk, quota, limit of size: the system names no file


def _real(path: str | Path) -> Path:
    """Where links lead; unlike `Path.resolve` it does not fail on a link that leads to itself."""
    return Path(os.path.realpath(path))


def _sibling(path: Path) -> Path:
    """A name nobody else uses beside what `path` stands for; keeps the suffix, since writers choose their format by it."""
    folder = _real(path).parent
    folder.mkdir(parents=True, exist_ok=True)
    return folder / f".{path.stem}.partial-{secrets.token_hex(4)}{path.suffix}"


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Say what could not be written where there is no room for it."""
    try:
        yield
    except OSError as error:
        if error.errno not in FULL:
            raise
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


@contextmanager
def staged_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary name that becomes `path` when the block ends, and is removed when the block fails.

    Where `path` is a link, the file it leads to is written. Raises InputError for what is there and is no file.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is a {'folder' if path.is_dir() else 'pipe or a device'}; name a file")
    staged = _sibling(path)
    try:
        with _named(path):
            yield staged
        os.replace(staged, _real(path))
    finally:
        staged.unlink(missing_ok=True)


def check_free(out: str | Path, force: bool = False) -> None:
    """Raise InputError unless the folder `out` may be written: it is not there, is empty, or is our own and `force` is set."""
    out = Path(out)
    if not out.exists():
        return
    if not out.is_dir():
        raise InputError(f"{out}: is a file; name a folder")
    if Path.cwd().is_relative_to(_real(out)):
        raise InputError(f"{out}: is the working folder, or holds it, and would be replaced; name another folder")
    if not any(out.iterdir()):
        return
    if not force:
        raise InputError(f"{out}: exists already; name another folder or use --force")
    if not any((out / name).exists() for name in REPLACEABLE):
        raise InputError(f"{out}: holds neither {' nor '.join(REPLACEABLE)}, so it is not ours to replace; name another folder")


@contextmanager
def staged_folder(out: str | Path, force: bool = False) -> Iterator[Path]:
    """Yield an empty folder that becomes `out` (or what the link `out` leads to) when the block ends, and is removed when it fails.

    An interrupted process leaves at most a hidden `.name.partial-*` folder. Raises InputError where `out` exists (see check_free).
    """
    check_free(out, force)
    out = _real(out)
    staged = _sibling(out)
    staged.mkdir()
    try:
        with _named(out):
            yield staged
        check_free(out, force)  # somebody may have been faster
        if out.exists():
            old = _sibling(out)
            os.replace(out, old)
            os.replace(staged, out)
            shutil.rmtree(old)
        else:
            os.replace(staged, out)
    finally:
        shutil.rmtree(staged, ignore_errors=True)
