"""The files of a study, in a folder or in a zip (also a zip in a zip), by name."""

from __future__ import annotations

import io
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ..errors import InputError
from .text import read_bytes

LARGEST = 1 << 31  # bytes of one file
SEVEN_ZIP = b"7z\xbc\xaf\x27\x1c"
MOST_FILES = 1_000_000


@dataclass(frozen=True)
class Archive:
    """Names relative to the study's top, and where their bytes are."""

    path: Path
    names: tuple[str, ...]
    zipped: zipfile.ZipFile | None = None

    @classmethod
    def open(cls, path: str | Path) -> Archive:
        """A folder, a zip, or one file as a study of its own. Raises InputError for what cannot be opened."""
        path = Path(path)
        if path.is_dir():
            return cls(path, tuple(sorted(str(p.relative_to(path).as_posix()) for p in path.rglob("*") if p.is_file())))
        data = read_bytes(path)
        if data[:6] == SEVEN_ZIP:
            raise InputError(f"{path}: is a 7-Zip archive, whatever its name; unpack it and name the folder")
        if data[:4] != b"PK\x03\x04":
            return cls(path.parent, (path.name,))
        return cls._zipped(path, data)

    @classmethod
    def _zipped(cls, path: Path, data: bytes) -> Archive:
        try:
            zipped = zipfile.ZipFile(io.BytesIO(data))
            names = tuple(sorted(name for name in zipped.namelist() if not name.endswith("/")))
        except (zipfile.BadZipFile, NotImplementedError, ValueError, EOFError, zlib.error) as error:
            raise InputError(f"{path}: is no readable zip: {error}; it is truncated or damaged") from None
        inner = [name for name in names if name.lower().endswith(".zip")]
        archive = cls(path, names[:MOST_FILES], zipped)
        if len(inner) == 1 and not any(name.lower().endswith((".xml", ".csv", ".mat")) for name in names):
            return cls._zipped(path / inner[0], archive.read(inner[0]))
        return archive

    def read(self, name: str) -> bytes:
        """The bytes of one file. Raises InputError where it is missing, locked or damaged."""
        if self.zipped is None:
            return read_bytes(self.path / name)
        try:
            if self.zipped.getinfo(name).file_size > LARGEST:
                raise InputError(f"{self.path}: {name} unpacks to more than {LARGEST} bytes")
            return self.zipped.read(name)
        except KeyError:
            raise InputError(f"{self.path}: holds no {name}") from None
        except RuntimeError as error:  # what zipfile raises for a password
            raise InputError(f"{self.path}: {name}: {error}; unpack it with its password first") from None
        except (zipfile.BadZipFile, NotImplementedError, EOFError, zlib.error, ValueError) as error:
            raise InputError(f"{self.path}: {name}: {error}; the zip is damaged") from None

    def where(self, name: str) -> Path:
        """What errors call the file."""
        return self.path / name

    def find(self, folder: str, name: str) -> str | None:
        """The file of that name in that folder, upper and lower case alike (systems differ); None where there is none."""
        wanted = str(PurePosixPath(folder) / name).lower()
        return next((n for n in self.names if n.lower() == wanted), None)

    def named(self, ending: str) -> list[str]:
        """Files whose name ends so."""
        return [name for name in self.names if name.lower().endswith(ending.lower())]
