"""Where files may be written: inside a folder of ours, through no link, under names that are names; and the
hidden names of what is half made, which tell whose it is.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import socket
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from itertools import chain, count
from pathlib import Path
from zlib import crc32

from .errors import InputError, escaped

SHOWN = 40  # letters of a name that its temporary name keeps
LONGEST_NAME = 255  # bytes, of most file systems
UNFIT = re.compile(r"[./\\\x00-\x1f\x7f]")
PARTIAL = re.compile(r"\..*\.partial-(?P<process>[0-9a-f]+)(@(?P<machine>[0-9a-f]{8}))?-.*", re.DOTALL)


def follow_links(path: str | Path) -> Path:
    """Return where links lead; unlike `Path.resolve` this does not fail on one that leads to itself."""
    return Path(os.path.realpath(path))


def seen_from(path: Path, folder: Path) -> str:
    """Return a path as seen from the folder; whole where there is no way from the one to the other."""
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:  # the two are on different drives
        return path.resolve().as_posix()


def check_inside(path: Path, folder: Path) -> None:
    """Raise InputError unless `path`, which stands below a folder, is there or would be: no name on the way
    down is a link, or leads up again. The folder itself may be a link, as its user named it.
    """
    place = folder
    for name in path.relative_to(folder).parts:
        check_name(name, path)
        place = place / name
        if place.is_symlink():
            raise InputError(
                f"{place}: is a link to {escaped(os.readlink(place))}, and o3dls writes only what stands in "
                f"{folder}; remove the link"
            )


@contextmanager
def sole_writer(folder: Path, what: str) -> Iterator[None]:
    """Keep others that would do the same from writing into a folder while the block runs; it is made where it
    is not there. The system ends this with the process, and nothing is left in the folder.

    Raises InputError where another one does `what` there. Systems that lock no folders let both go on.
    """
    folder.mkdir(parents=True, exist_ok=True)
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"{folder}: {what} writes there at this time; wait for its end, or name another folder"
            ) from None
        except OSError:  # some file systems of networks
            pass
        yield
    finally:
        os.close(number)


def check_name(name: str, where: object) -> None:
    """Raise InputError, which begins with `where`, for what is not the name of one file or folder."""
    if name in ("", ".", "..") or {"/", "\0", os.sep, os.altsep or os.sep} & set(name):
        raise InputError(f"{where}: '{escaped(name)}': must be the name of a folder, not a path")


def beside(path: Path, ending: str) -> Path:
    """Return the path of a file beside a folder, which has its name and an ending; the name is cut where the
    two would be too long for a system.
    """
    if len(os.fsencode(path.name + ending)) > LONGEST_NAME:
        return path.with_name(_short_name(path.name) + ending)
    return path.with_name(path.name + ending)


def plain_name(wanted: str) -> str:
    """Return what is wanted as the name of a file: dots and what cannot stand in one are _."""
    return UNFIT.sub("_", wanted) or "_"


def unique_names(wanted: Mapping[str, str]) -> dict[str, str]:
    """Return the plain name of each that is wanted; a number follows where two would be one file, also where
    the system does not tell capitals apart.
    """
    found: dict[str, str] = {}
    taken: set[str] = set()
    for key, name in wanted.items():
        plain = plain_name(name)
        tried = chain([plain], (f"{plain}_{k}" for k in count(2)))
        found[key] = next(one for one in tried if one.casefold() not in taken)
        taken.add(found[key].casefold())
    return found


def _short_name(name: str) -> str:
    return f"{name[:SHOWN]}~{crc32(os.fsencode(name)):08x}" if len(name) > SHOWN else name


def temporary_name(path: Path) -> Path:
    """Return a name that nobody else uses beside what `path` stands for; it is not too long for a system, and
    keeps the suffix, since writers choose their format by it. It says which process of which machine made it.
    """
    folder = follow_links(path).parent
    make_folder(folder)
    return folder / partial_name(path)


def make_folder(folder: Path) -> None:
    """Make a folder, and those that it lies in, where they are not there. Raises InputError where it cannot
    be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        file = next((one for one in (folder, *folder.parents) if one.is_file()), None)
        why = f"{file} is a file" if file else error.strerror
        raise InputError(f"{folder}: cannot be made: {why}; name another folder") from None


def partial_name(path: Path) -> str:
    """Return the name of a half-made file or folder alone."""
    return f"{_own_prefix(path, os.getpid())}{secrets.token_hex(4)}{path.suffix[:12]}"


def _own_prefix(path: Path, process: int) -> str:
    return f".{_short_name(path.name)}.partial-{process:x}@{_machine()}-"


@cache
def _machine() -> str:
    """Return a word for where the numbers of processes are those of this one: its machine and container."""
    try:
        space = os.stat("/proc/self/ns/pid").st_ino
    except OSError:
        space = 0
    return f"{crc32(f'{socket.gethostname()} {space}'.encode()):08x}"


def remove_partial(folder: Path, process: int | None = None) -> None:
    """Remove what a process that is no more left half made of a folder, beside it; without its number, what
    any left.
    """
    real = follow_links(folder)
    mark = f".{_short_name(real.name)}.partial-" if process is None else _own_prefix(real, process)
    for left in real.parent.iterdir() if real.parent.is_dir() else ():
        if left.name.startswith(mark):
            _remove(left)


def remove_abandoned(folder: Path) -> None:
    """Remove from a folder what processes of this machine that are no more left half made there."""
    for left in folder.iterdir() if folder.is_dir() else ():
        found = PARTIAL.fullmatch(left.name)
        if found and found["machine"] == _machine() and not _is_alive(int(found["process"], 16)):
            _remove(left)


def _remove(left: Path) -> None:
    if left.is_dir() and not left.is_symlink():
        shutil.rmtree(left, ignore_errors=True)
    else:
        left.unlink(missing_ok=True)


def _is_alive(process: int) -> bool:
    """Return whether a process is there; yes where the system cannot be asked."""
    if sys.platform == "win32":
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # somebody else's
        return True
    return True
