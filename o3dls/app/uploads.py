"""A file that was brought, once it is whole: it gets its name, or is one that is there already."""

from __future__ import annotations

import filecmp
import os
from pathlib import Path
from threading import Lock

from ..errors import InputError
from ..io.text import LARGEST_FILE
from .shelf import FILES, Shelf, named
from .worker import Message, Tell

NAMING = Lock()  # two files of one name that come at one time get two names


def keep_file(staged: Path, shelf: Shelf, name: str) -> str:
    """Give a file that has come whole its name in the folder; its path. The same file is kept once."""
    there = shelf.folder / FILES / named(name)
    if there.is_file() and not there.is_symlink() and filecmp.cmp(there, staged, shallow=False):
        return there.relative_to(shelf.folder).as_posix()
    with staged.open("rb+") as file:
        os.fsync(file.fileno())
    with NAMING:
        path = shelf.new_file(name)
        os.replace(staged, path)
    return path.relative_to(shelf.folder).as_posix()


def unpack_slices(packed: Path, folder: Path, tell: Tell) -> Message:
    """Make a folder of the DICOM files in a zip, since an image is a folder of slices; its path.

    Raises InputError where there is none, or they are more than the bound of a file.
    """
    from ..io.atomic import staged_folder
    from ..io.images.dicom import knows
    from ..io.mapping.archive import Archive

    archive, left, count = Archive.open(packed), LARGEST_FILE, 0
    with staged_folder(folder) as staged:
        for name in archive.names:
            data = archive.read(name)
            left -= len(data)
            if left < 0:
                raise InputError(f"{packed}: unpacks to more than {LARGEST_FILE} bytes")
            if knows(data):
                count += 1
                (staged / f"{count:05}.dcm").write_bytes(data)
        if not count:
            raise InputError(f"{packed}: holds no slices of DICOM; an image is such a folder, or one file")
    return {"file": folder.as_posix()}
