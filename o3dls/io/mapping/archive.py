"""The files of a study, in a folder or in a zip (also a zip in a zip), by name."""

from __future__ import annotations

import io
import lzma
import unicodedata
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from ...errors import InputError
from ..text import as_utf8, read_bytes

LARGEST = 1 << 31  # bytes of one file
SEVEN_ZIP = b"7z\xbc\xaf\x27\x1c"
UNPACKING = (zlib.error, lzma.LZMAError, OSError, ValueError)  # of deflate, LZMA and bzip2
MOST_FILES = 1_000_000
DEEPEST = 3  # zips in each other
UTF8_FLAG, ZIP_ENCODING = (
    0x800,
    "cp437",
)  # what says that a name is UTF-8, and what it is else by the standard
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
    opened: frozenset[str] = frozenset()  # zips whose files are among the names

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
        found = {_file_name(info).replace("\\", "/"): (file, info) for info in file.infolist()[:MOST_FILES]}
        found = {
            name: where
            for name, where in found.items()
            if not name.endswith("/") and not name.startswith("__MACOSX/")
        }
        return cls(path, tuple(sorted(found)), found)

    def unpacked(self) -> Iterator[Archive]:
        """Yield the archive with the files of the zips in it as well, and in those, if it holds any. Raises
        InputError where none of them can be read.
        """
        whole = self
        for _ in range(DEEPEST):
            inner = [name for name in whole.named(".zip") if f"{name}/" not in whole.opened]
            if not inner:
                return
            found, opened = dict(whole.zipped), {*whole.opened, *(f"{name}/" for name in inner)}
            faults = []
            for name in inner:
                try:
                    within = self._open_zip(self.path / name, whole.read(name)).zipped
                    found |= {f"{name}/{one}": where for one, where in within.items()}
                except InputError as error:
                    faults.append(error)
            if len(faults) == len(inner):
                raise faults[0]
            names = tuple(sorted({*whole.names, *found}))
            whole = Archive(self.path, names, found, frozenset(opened))
            yield whole

    def with_neighbours(self) -> Archive:
        """Return the archive of all that lies in the folder, where one file of it was named."""
        return self if self.zipped or len(self.names) > 1 else Archive.open(self.path)

    def read(self, name: str) -> bytes:
        """Read the bytes of one file. Raises InputError where it is locked or damaged."""
        if name not in self.zipped:
            return as_utf8(read_bytes(self.path / name))
        file, info = self.zipped[name]
        if info.file_size > LARGEST:
            raise InputError(f"{self.path}: {name} unpacks to more than {LARGEST} bytes")
        if info.file_size > max(LARGE, MOST_PACKED * info.compress_size):
            raise InputError(
                f"{self.path}: {name} unpacks from {info.compress_size} to {info.file_size} bytes, as no "
                "file of a study does; if it is one, unpack the zip and name the folder"
            )
        try:
            return as_utf8(file.read(info))
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
        """Return the file of a name in a folder, upper and lower case and both forms of an accent alike, in
        whatever encoding a zip has its name; None where there is none.
        """
        wanted = _plain_name(str(PurePosixPath(folder) / name))
        exact = (n for n in self.names if _plain_name(n) == wanted)
        return next(exact, None) or next((n for n in self.names if wanted in _other_readings(n)), None)

    def named(self, ending: str) -> list[str]:
        """Return the files whose names have an ending."""
        return [name for name in self.names if name.lower().endswith(ending.lower())]


def _plain_name(name: str) -> str:
    """Return a name in the form in which all file systems agree on it."""
    return unicodedata.normalize("NFC", name).lower()


def _file_name(info: zipfile.ZipInfo) -> str:
    """Return the name of a file in a zip, as UTF-8 where it is that without saying so, as macOS writes it."""
    name = info.filename
    if info.flag_bits & UTF8_FLAG or name.isascii():
        return name
    try:
        return name.encode(ZIP_ENCODING).decode("utf-8")
    except UnicodeError:
        return name


def _other_readings(name: str) -> set[str]:
    """Return how a name that zipfile read as cp437 reads in the other encodings that programs write."""
    if name.isascii():
        return set()
    with suppress(UnicodeEncodeError):
        data = name.encode(ZIP_ENCODING)
        return {_plain_name(data.decode(encoding, errors="replace")) for encoding in ("cp850", "cp1252")}
    return set()
