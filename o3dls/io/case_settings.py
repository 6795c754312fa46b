"""A case folder's settings and files: case.toml read strictly, files found by role, each with its hash."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..case import MILLIMETRES, PRIOR_OF, SPACES
from ..errors import InputError, did_you_mean
from .documents import read_toml
from .table import Table, read_table
from .text import read_bytes

# files of voxels alone, which a header beside them describes
VOXELS = (".img", ".img.gz", ".raw", ".raw.gz", ".zraw")
FILES = ("prior", "points", "prior_landmarks", "init", "truth", "held_out", "correspondence", "outliers")
TEXTS = (
    "name",
    "units",
    "prior_file_units",
    "frame",
    "prior_of",
    "notes",
    "part",
    "form",
    "sidecar",
    "columns",
    "image",
)
KEYS = dict.fromkeys((*TEXTS, *FILES), str) | {
    "dimension": int,
    "label": int,
    "layer": int,
    "cap": bool,
    "fill_slices": bool,
    "box": list,
}

ALLOWED: Mapping[str, tuple[str | int, ...]] = {
    "units": tuple(MILLIMETRES),
    "prior_file_units": tuple(MILLIMETRES),
    "frame": SPACES,
    "prior_of": PRIOR_OF,
    "dimension": (2, 3),
    "form": ("sform", "qform"),
    "sidecar": ("ignore", "take"),
}

NUMBER = r"-?[\d.]+(?:e[+-]?\d+)?"
# options that a sentence names behind two dashes, as a line of case.toml has them
LINES: tuple[tuple[str, str], ...] = (
    (r"(form|sidecar) (sform|qform|ignore|take)\b", r'\1 = "\2"'),
    (r"fill-slices\b", "fill_slices = true"),
    ("box " + " ".join([f"({NUMBER})"] * 6), r"box = [\1, \2, \3, \4, \5, \6]"),
    (r"columns (\w+=HEADING)", r'columns = "\1"'),
    (r"(label|part|layer|form|sidecar|box)\b", r"\1"),
)


@dataclass
class Folder:
    """A case folder is read through this class, which holds its settings and notes every file that is
    read.
    """

    path: Path
    settings: dict[str, Any]
    files: dict[str, Path]

    @property
    def dimension(self) -> int:
        return int(self.settings.get("dimension", 3))

    @property
    def units(self) -> str:
        """Units of the case once it is read: mm, or px as they are."""
        return "px" if self.settings.get("units") == "px" else "mm"

    def scale(self, stated: str | None = None) -> float:
        """Return the factor to mm: what a file itself states comes before what the case says. Raises
        InputError where only one of them is in px.
        """
        if stated in MILLIMETRES and "px" in (stated, self.units) and stated != self.units:
            raise InputError(
                f"{self.path}: a file states units {stated}, and the case is in {self.units}; pixels are "
                "not a length: "
                "correct the file, or the units in case.toml or --units"
            )
        return MILLIMETRES[stated if stated in MILLIMETRES else self.settings.get("units", "mm")]

    def find(self, role: str) -> Path | None:
        """Return the file of a role: named in case.toml, else the one file of that stem. Raises InputError
        where it is missing or double.
        """
        if role in self.settings:
            path: Path = self.path / self.settings[role]
            if not path.is_file():
                raise InputError(f"{self.path / 'case.toml'}: {role} = '{self.settings[role]}': no such file")
        else:
            there = sorted(p for p in self.path.glob(f"{role}.*") if p.is_file())
            voxels = [p for p in there if p.name.lower().endswith(VOXELS)]
            found = [p for p in there if p not in voxels] or voxels
            if role == "prior":  # a JSON file beside it is its sidecar
                found = [p for p in found if p.suffix.lower() != ".json"] or found
            for data in voxels:
                self.note(data)
            if len(found) > 1:
                raise InputError(
                    f"{self.path}: both {found[0].name} and {found[1].name}; say in case.toml which is "
                    f"the {role}"
                )
            if not found:
                return None
            path = found[0]
        self.note(path)
        return path

    def note(self, path: Path) -> None:
        inside = path.is_relative_to(self.path)
        self.files[path.relative_to(self.path).as_posix() if inside else path.name] = path

    def hashes(self, read: Mapping[Path, str]) -> dict[str, str]:
        """Return the hash of every file that is a part of the case, as it was `read`; of a file that was not
        read as bytes, as it is now.
        """
        return {
            name: read.get(path.absolute()) or hashlib.sha256(read_bytes(path)).hexdigest()
            for name, path in self.files.items()
        }

    def table(self, role: str, required: str | tuple[str, ...]) -> Table | None:
        path = self.find(role)
        return None if path is None else read_table(path, required)


def open_folder(path: Path, overrides: Mapping[str, str]) -> Folder:
    """Return the settings of a folder. Raises InputError for a missing folder or a wrong case.toml."""
    if not path.is_dir():
        raise InputError(f"{path}: no such case folder")
    folder = Folder(path, {}, {})
    if (toml := folder.find("case")) is not None:
        folder.settings = read_toml(toml)
        for key, value in folder.settings.items():
            _check_setting(f"{toml}: {key}", key, value)
    for key, value in overrides.items():
        _check_setting(f"--{key}", key, value)
    for key, given in overrides.items():
        stated = folder.settings.get(key, "unknown")
        if "unknown" not in (stated, given) and stated != given:
            raise InputError(
                f"{toml}: states {key} {stated}, and --{key} says {given}; omit --{key}, or correct the file"
            )
    folder.settings |= overrides
    return folder


@contextmanager
def lines_said() -> Iterator[None]:
    """Raise the errors of what is done within with lines of case.toml for options, which a command that reads
    a case folder does not have.
    """
    try:
        yield
    except InputError as error:
        sentence = str(error)
        for option, line in LINES:
            sentence = re.sub(f"--{option}", line, sentence)
        if sentence != str(error):
            sentence += ", in case.toml"
        elif found := re.search(rf"say --(units|frame) ({'|'.join((*MILLIMETRES, *SPACES))})\b", sentence):
            sentence += f', or {found[1]} = "{found[2]}" and so on in case.toml'
        error.args = (sentence,)
        raise


def new_folder(path: Path, settings: dict[str, Any]) -> Folder:
    """Return a case folder that is still to be made, with settings as options give them. Raises InputError
    for a wrong one.
    """
    for key, value in settings.items():
        _check_setting(f"--{key}", key, value)
    return Folder(path, settings, {})


def _is_box(value: Any) -> bool:
    return len(value) == 6 and all(type(v) in (int, float) for v in value)


def _check_setting(where: str, key: str, value: Any) -> None:
    if key not in KEYS:
        raise InputError(f"{where}: no such key" + did_you_mean(key, list(KEYS)))
    if type(value) is not KEYS[key]:
        raise InputError(f"{where} = {value!r}: must be of type {KEYS[key].__name__}")
    if key == "box" and not _is_box(value):
        raise InputError(f"{where} = {value!r}: must be six numbers, least x, y, z, then most")
    allowed = ALLOWED.get(key)
    if allowed and value not in allowed:
        raise InputError(f"{where} = {value!r}: must be one of {', '.join(map(str, allowed))}")


def toml_lines(settings: Mapping[str, str | int | float | bool]) -> str:
    """Return settings as lines of case.toml; JSON's strings, numbers and booleans are TOML's too, but for a
    bare DEL.
    """
    text = "".join(f"{key} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in settings.items())
    # names of files may hold bytes that are not UTF-8
    return text.replace("\x7f", "\\u007f").encode("utf-8", "replace").decode("utf-8")
