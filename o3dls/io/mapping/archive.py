"""The files of a study, in a folder or in a zip (also a zip in a zip), by name."""

from __future__ import annotations

import io
import lzma
import unicodedata
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from ...errors import InputError
from ..text import read_bytes

LARGEST = 1 << 31  # bytes of one file
SEVEN_ZIP = b"7z\xbc\xaf\x27\x1c"
UNPACKING = (zlib.error, lzma.LZMAError, OSError, ValueError)  # of deflate, LZMA and bzip2
MOST_FILES = 1_000_000
# how many times its packed size a file may have, if it is larger than LARGE: text packs to about a tenth
MOST_PACKED, LARGE = 200, 1 << 22


@dataclass(frozen=True)
class Archive:
    """An archive gives the files of a study: their names relative to its top and, where they are zipped, what
    holds their bytes.
    """

    path: Path
    names: tuple[str, ...]
    zipped: Mapping[str, tuple[zipfile.ZipFile, zipfile.ZipInfo]] = field(default_factory=dict)

    @classmethod
    def open(cls, path: str | Path) -> Archive:
        """Open a folder, a zip, or one file as a study of its own. Raises InputError for what cannot be
        opened.
        """
        path = Path(path)
        if path.is_dir():
            return cls(
                path,
                tuple(sorted(str(p.relative_to(path).as_posix()) for p in path.rglob("*") if p.is_file())),
            )
        data = read_bytes(path)
        if data[:6] == SEVEN_ZIP:
            raise InputError(f"{path}: is a 7-Zip archive, whatever its name; unpack it and name the folder")
        if data[:4] != b"PK\x03\x04":
            return cls(path.parent, (path.name,))
        return cls._open_zip(path, data)

    @classmethod
    def _open_zip(cls, path: Path, data: bytes) -> Archive:
        try:
            file = zipfile.ZipFile(io.BytesIO(data))
        except (zipfile.BadZipFile, NotImplementedError, ValueError, EOFError, zlib.error) as error:
            raise InputError(f"{path}: is not a readable zip: {error}; it is truncated or damaged") from None
        found = {info.filename.replace("\\", "/"): (file, info) for info in file.infolist()[:MOST_FILES]}
        found = {
            name: where
            for name, where in found.items()
            if not name.endswith("/") and not name.startswith("__MACOSX/")
        }
        return cls(path, tuple(sorted(found)), found)

    def unpacked(self) -> Iterator[Archive]:
        """Yield the archive with the files of the one zip in it, if it is zipped and holds just one. Raises
        InputError where that is damaged.
        """
        inner = self.named(".zip")
        if self.zipped and len(inner) == 1:
            within = self._open_zip(self.path / inner[0], self.read(inner[0])).zipped
            found = {**self.zipped, **{f"{inner[0]}/{name}": where for name, where in within.items()}}
            yield Archive(self.path, tuple(sorted(found)), found)

    def with_neighbours(self) -> Archive:
        """Return the archive of all that lies in the folder, where one file of it was named."""
        return self if self.zipped or len(self.names) > 1 else Archive.open(self.path)

    def read(self, name: str) -> bytes:
        """Read the bytes of one file. Raises InputError where it is locked or damaged."""
        if not self.zipped:
            return read_bytes(self.path / name)
        file, info = self.zipped[name]
        if info.file_size > LARGEST:
            raise InputError(f"{self.path}: {name} unpacks to more than {LARGEST} bytes")
        if info.file_size > max(LARGE, MOST_PACKED * info.compress_size):
            raise InputError(
                f"{self.path}: {name} unpacks from {info.compress_size} to {info.file_size} bytes, as no "
                "file of a study does; if it is one, unpack the zip and name the folder"
            )
        try:
            return file.read(info)
        except NotImplementedError as error:  # before RuntimeError, of which it is a subclass
            raise InputError(
                f"{self.path}: {name}: {error}; unpack it with another program and name the folder"
            ) from None
        except RuntimeError as error:  # zipfile raises it where a password is missing
            raise InputError(f"{self.path}: {name}: {error}; unpack it with its password first") from None
        except (zipfile.BadZipFile, EOFError, *UNPACKING) as error:
            raise InputError(f"{self.path}: {name}: {error}; the zip is damaged") from None

    def where(self, name: str) -> Path:
        """Return the path by which errors name a file."""
        return self.path / name

    def find(self, folder: str, name: str) -> str | None:
        """Return the file of a name in a folder, upper and lower case and both forms of an accent alike; None
        where there is none.
        """
        wanted = _plain_name(str(PurePosixPath(folder) / name))
        return next((n for n in self.names if _plain_name(n) == wanted), None)

    def named(self, ending: str) -> list[str]:
        """Return the files whose names have an ending."""
        return [name for name in self.names if name.lower().endswith(ending.lower())]


def _plain_name(name: str) -> str:
    """Return a name in the form in which all file systems agree on it."""
    return unicodedata.normalize("NFC", name).lower()
