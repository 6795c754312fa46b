"""The folder that the app was given: which cases, runs and files are in it, and where new ones go."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

from ..errors import InputError, escaped
from ..places import check_inside, check_name, remove_abandoned

FILES, CASES, RUNS = "files", "cases", "runs"
DEEP = 3  # folders below the one that was given, in which cases and runs are looked for
MOST = 2000  # entries of a list: of a folder with more, such as a home folder, a part is shown
NAME = re.compile(r"[^\x00-\x1f\x7f/\\<>:\"|?*]{1,120}")
# endings of files that may be a prior, a map or places; the readers tell kinds by content
ENDINGS = (
    *(".ply", ".stl", ".obj", ".off", ".vtk", ".vtp", ".mesh", ".xml"),
    *(".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd", ".dcm"),
    *(".csv", ".tsv", ".txt", ".xlsx", ".zip", ".mat", ".json", ".fcsv", ".pcd"),
)


class Shelf:
    """The shelf is a folder by which pages name what is in it: every path is relative to it, and none leads
    out of it, through no link either.
    """

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; make it first, or name another")
        self.folder = folder.resolve()
        for name in (FILES, CASES, RUNS):  # of a server that was killed
            remove_abandoned(self.folder / name)

    def place(self, path: str) -> Path:
        """Return the path, relative to the folder, of what a page names. Raises InputError for one that leads
        out of it.
        """
        if not path or "\0" in path or Path(path).is_absolute():
            raise InputError(f"'{escaped(path)}': must be a path in the folder of the app")
        check_inside(self.folder / path, self.folder)
        return Path(path)

    def run(self, path: str) -> Path:
        """Return the path of a run. Raises InputError where there is none."""
        found = self.place(path)
        if not (self.folder / found / "run.json").is_file():
            raise InputError(f"{found}: is not a run in this folder")
        return found

    def case(self, path: str) -> Path:
        """Return the path of a case. Raises InputError where there is none."""
        found = self.place(path)
        if not _is_case(self.folder / found):
            raise InputError(f"{found}: is not a case in this folder")
        return found

    def listed(self) -> dict[str, list[str]]:
        """Return the paths of the cases, runs and files that there are, by name."""
        found: dict[str, list[str]] = {CASES: [], RUNS: [], FILES: []}
        for kind, path in self._walk():
            if sum(map(len, found.values())) >= MOST:
                break
            found[kind].append(path.relative_to(self.folder).as_posix())
        return {kind: sorted(paths) for kind, paths in found.items()}

    def new_file(self, name: str) -> Path:
        """Return where a file that is brought goes: under its own name, or with a number where that is taken,
        since a case may refer to the other.
        """
        return self._free(self.folder / FILES, named(name))

    def new_slices(self, packed: Path) -> Path:
        """Return the path, relative to the folder, of what a zip of slices is unpacked into."""
        return self._free(self.folder / FILES, named(packed.stem)).relative_to(self.folder)

    def new_folder(self, kind: str, name: str) -> Path:
        """Return the path, relative to the folder, of a case or run that is to be made."""
        return self._free(self.folder / kind, named(name)).relative_to(self.folder)

    def _free(self, folder: Path, name: str) -> Path:
        stem, dot, ending = name.partition(".")
        tried, k = folder / name, 1
        while os.path.lexists(tried):
            k += 1
            tried = folder / f"{stem}_{k}{dot}{ending}"
        check_inside(tried, self.folder)
        return tried

    def _walk(self) -> Iterator[tuple[str, Path]]:
        """Yield what the folder holds; of what lies in cases and runs nothing, and nothing through links."""
        waiting = [(self.folder, 0)]
        while waiting:
            folder, depth = waiting.pop(0)
            try:
                entries = sorted(os.scandir(folder), key=lambda one: one.name)
            except OSError:
                continue  # others keep it closed
            for entry in entries:
                path = Path(entry.path)
                if entry.name.startswith(".") or entry.is_symlink():
                    continue
                if not entry.is_dir(follow_symlinks=False):
                    if entry.name.lower().endswith(ENDINGS):
                        yield FILES, path
                elif (path / "run.json").is_file():
                    yield RUNS, path
                elif _is_case(path):
                    yield CASES, path
                elif depth < DEEP:
                    waiting.append((path, depth + 1))


def named(name: str) -> str:
    """Return a name that a page gives to a file or folder. Raises InputError where it cannot be one."""
    check_name(name, "name")
    if not NAME.fullmatch(name) or name.startswith((".", "-")) or name != name.strip():
        raise InputError(
            f"name: '{escaped(name[:150])}': must be at most 120 letters, digits and the like, and begin "
            "with neither a dot nor a hyphen"
        )
    return name


def _is_case(folder: Path) -> bool:
    return (folder / "case.toml").is_file() or (
        (folder / "points.csv").is_file() and any(folder.glob("prior.*"))
    )
