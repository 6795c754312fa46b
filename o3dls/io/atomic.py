"""Files and folders that appear whole or not at all: made under a hidden name beside their place, then renamed."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import InputError

REPLACEABLE = ("run.json", "case.toml", "paper_results.json")  # only a folder that holds one of these, or nothing, is ever overwritten


def _sibling(path: Path) -> Path:
    """A name nobody else uses beside `path`; keeps the suffix, since writers choose their format by it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return path.with_name(f".{path.stem}.partial-{secrets.token_hex(4)}{path.suffix}")


@contextmanager
def staged_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary name that becomes `path` when the block ends, and is removed when the block fails."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name a file")
    staged = _sibling(path)
    try:
        yield staged
        os.replace(staged, path)
    finally:
        staged.unlink(missing_ok=True)


def check_free(out: str | Path, force: bool = False) -> None:
    """Raise InputError unless the folder `out` may be written: it is not there, is empty, or is our own and `force` is set."""
    out = Path(out)
    if out.is_file():
        raise InputError(f"{out}: is a file; name a folder")
    if not out.exists() or not any(out.iterdir()):
        return
    if not force:
        raise InputError(f"{out}: exists already; name another folder or use --force")
    if not any((out / name).exists() for name in REPLACEABLE):
        raise InputError(f"{out}: holds neither {' nor '.join(REPLACEABLE)}, so it is not ours to replace; name another folder")


@contextmanager
def staged_folder(out: str | Path, force: bool = False) -> Iterator[Path]:
    """Yield an empty folder that becomes `out` when the block ends, and is removed when the block fails.

    An interrupted process leaves at most a hidden `.name.partial-*` folder. Raises InputError where `out` exists (see check_free).
    """
    out = Path(out)
    check_free(out, force)
    staged = _sibling(out)
    staged.mkdir()
    try:
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
