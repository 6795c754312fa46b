"""Files and folders that appear whole or not at all: made under a hidden name beside their place, then
renamed.
"""

from __future__ import annotations

import errno
import logging
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..errors import InputError, escaped
from ..places import check_inside, follow_links, partial_name, remove_abandoned, temporary_name
from .manifest import foreign

# the file by which each kind of our folders is known
MARKS = {
    "run": "run.json",
    "case": "case.toml",
    "paper": "paper_results.json",
}
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # disk, quota, limit: the system names no file
# as long as paths in our folders, such as estimates/NAME/surface.ply: systems limit the whole path
LONGEST = Path("x" * 80) / ("x" * 120)
log = logging.getLogger("o3dls")


@contextmanager
def _report_unwritten(path: Path, staged: Path) -> Iterator[None]:
    """Say what could not be written where there is no room for it, or its staged name cannot be made."""
    try:
        yield
    except OSError as error:
        if error.errno not in FULL and str(staged) not in str(error.filename):
            raise
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


@contextmanager
def staged_file(path: str | Path, within: str | Path | None = None) -> Iterator[Path]:
    """Yield a temporary name that becomes `path` when the block ends, and is removed when the block fails.

    Where `path` is a link, the file it leads to is written, unless it stands `within` a folder, which may be
    from elsewhere: there no link is followed. Raises InputError for what is there and is no file.
    """
    path = Path(path)
    if within is not None:
        check_inside(path, Path(within))
    _check_file(path)
    staged = temporary_name(path)
    remove_abandoned(staged.parent)
    try:
        with _report_unwritten(path, staged):
            yield staged
            _flush_to_disk(staged)
        os.replace(staged, follow_links(path))
    finally:
        staged.unlink(missing_ok=True)


def _check_link(path: Path) -> None:
    real = follow_links(path)
    if any(
        place.is_symlink() for place in (real, *real.parents)
    ):  # realpath follows every link but those of a circle
        raise InputError(f"{path}: is a link that leads to itself, or lies in one; name another")


def _check_file(path: Path) -> None:
    _check_link(path)
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is a {'folder' if path.is_dir() else 'pipe or a device'}; name a file")


@contextmanager
def staged_files(path: str | Path, within: str | Path | None = None) -> Iterator[Path]:
    """Yield the name of `path` in a hidden folder beside it: the files that the block writes there, which
    belong together, come to stand beside `path` when it ends, and none of them when it fails. within: as for
    `staged_file`.
    """
    path = Path(path)
    if within is not None:
        check_inside(path, Path(within))
    _check_file(path)
    staged = temporary_name(path)
    remove_abandoned(staged.parent)
    with _report_unwritten(path, staged):
        staged.mkdir()
    try:
        yield staged / path.name
        for file in staged.iterdir():
            if within is not None:
                check_inside(path.parent / file.name, Path(within))
        _replace_all({file: follow_links(path.parent / file.name) for file in sorted(staged.iterdir())})
    except InputError as error:  # it names the temporary folder, which is removed
        raise InputError(str(error).replace(str(staged), str(path.parent))) from error
    finally:
        shutil.rmtree(staged, ignore_errors=True)


def _replace_all(targets: Mapping[Path, Path]) -> None:
    """Move files to their targets; where one cannot be moved, what was there before is there again."""
    before: dict[Path, Path | None] = {}
    try:
        for file, target in targets.items():
            kept = file.with_name(f".{file.name}.before")
            if os.path.lexists(target):
                os.replace(target, kept)
                before[target] = kept
            else:
                before[target] = None
            os.replace(file, target)
    except BaseException:
        for target, old in before.items():
            if old is None:
                target.unlink(missing_ok=True)
            else:
                os.replace(old, target)
        raise


def write_file(path: str | Path, content: str | bytes, within: str | Path | None = None) -> None:
    """Write a file, whole or not at all; text as UTF-8. within: as for `staged_file`.

    Raises InputError where the disk has no room, or keeps something else than what was written.
    """
    # names of folders may hold bytes that are not UTF-8
    data = content.encode("utf-8", "replace") if isinstance(content, str) else content
    with staged_file(path, within) as staged:
        staged.write_bytes(data)
        if (kept := staged.read_bytes()) != data:
            raise InputError(f"{path}: cannot be written: the disk kept {len(kept)} of {len(data)} bytes")


def _flush_to_disk(path: Path) -> None:
    """Wait until a file is on the disk: some systems say only then that there is no room for it."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def check_free(
    out: str | Path, force: bool = False, kind: str | None = None, reads: Sequence[Path] = ()
) -> None:
    """Raise InputError unless the folder `out` may be written: it is not there, is empty, or is our own of
    that kind and `force` is set. A folder is our own where it holds nothing that o3dls did not write.

    kind: run, case or paper, any where it is None; reads: files and folders that the work reads, which must
    not be replaced by it.
    """
    out = Path(out)
    if _path_exists(out) and not out.is_dir():
        raise InputError(f"{out}: is a file; name a folder")
    if out.exists() and Path.cwd().is_relative_to(follow_links(out)):
        raise InputError(
            f"{out}: is the working folder, or holds it, and would be replaced; name another folder"
        )
    if out.exists() and any(out.iterdir()):
        _check_replaceable(out, kind, reads)  # first: nobody is told to use --force where it is refused
        if not force:
            raise InputError(f"{out}: exists already; name another folder or use --force")
    _check_writable(out)


def _path_exists(path: Path) -> bool:
    """Return whether a path is there. Raises InputError for one that cannot be, as with too long a name."""
    if "\0" in str(path):
        raise InputError(f"{path}: cannot be a path: it contains a zero byte; name another")
    try:
        return path.exists()
    except OSError as error:
        raise InputError(f"{path}: cannot be made: {error.strerror}; name another") from None


def _check_replaceable(out: Path, kind: str | None, reads: Sequence[Path]) -> None:
    there = _folder_kind(out)
    if there is None or there != (kind or there):
        raise InputError(
            f"{out}: is not a {kind or ' or '.join(MARKS)}, so o3dls does not replace it; name another folder"
        )
    for source in reads:
        if follow_links(source).is_relative_to(follow_links(out)):
            raise InputError(
                f"{out}: is or holds {source}, which is read, and would be replaced; name another folder"
            )
    if found := foreign(out, there):
        more = f" and {len(found) - 1} more" if found[1:] else ""
        raise InputError(
            f"{out}: holds {escaped(found[0])}{more}, which o3dls did not write and would remove; move it "
            "away, or name another folder"
        )


def _folder_kind(folder: Path) -> str | None:
    """Return the kind of a folder of ours; None for any other, or where it bears two marks."""
    found = [kind for kind, mark in MARKS.items() if (folder / mark).exists()]
    return found[0] if len(found) == 1 else None


def _check_writable(out: Path) -> None:
    """Raise InputError where the folder `out` cannot be made, with names in it as long as ours: only trying
    tells, and better before the work than after it.
    """
    real = follow_links(out)
    _check_link(out)
    there = next(folder for folder in real.parents if folder.exists())
    try:
        # named as what becomes of it, so that what a killed process leaves is found
        trial = there / partial_name(real)
        try:
            (trial / real.relative_to(there) / LONGEST).mkdir(parents=True)
        finally:
            shutil.rmtree(trial, ignore_errors=True)
    except OSError as error:
        raise InputError(f"{out}: cannot be made: {there}: {error.strerror}; name another folder") from None


@contextmanager
def staged_folder(out: str | Path, force: bool = False) -> Iterator[Path]:
    """Yield an empty folder that becomes `out` (or what the link `out` leads to) when the block ends, and is
    removed when it fails.

    An interrupted process leaves at most a hidden `.name.partial-*` folder. Raises InputError where `out`
    exists (see check_free), or is of another kind than what was made.
    """
    check_free(out, force)
    out = follow_links(out)
    remove_abandoned(out.parent)
    staged = temporary_name(out)
    staged.mkdir()
    try:
        with _report_unwritten(out, staged):
            yield staged
        check_free(out, force, _folder_kind(staged))  # another process may have made it meanwhile
        if out.exists():
            old = temporary_name(out)
            os.replace(out, old)
            try:
                os.replace(staged, out)
            except OSError:
                os.replace(old, out)
                raise
            _remove_replaced(old)
        else:
            os.replace(staged, out)
    finally:
        shutil.rmtree(staged, ignore_errors=True)


def _remove_replaced(old: Path) -> None:
    """Remove what was replaced, or say that it is still there: the new one is in its place."""
    try:
        shutil.rmtree(old)
    except OSError as error:
        log.warning("%s: holds what was replaced, and cannot be removed: %s", old, error.strerror)
