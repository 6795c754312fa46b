"""The manifest of a folder of ours: the names of the files that o3dls wrote there, so that nothing else is
ever removed with it.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..places import check_inside, temporary_name

MANIFEST = "manifest.txt"
IGNORED = (".DS_Store", "Thumbs.db", "desktop.ini")  # what file browsers leave in any folder
SURFACE = r"\.(ply|csv)"
# names of the files in folders from before there was a manifest; a case made by hand has the same ones
RUN = (
    r"run\.json|scores\.csv|points\.csv|held_out\.csv|report\.(html|pdf)|figures/[^/]+\.png"
    r"|estimates/[^/]+/(surface\.(ply|vtp|csv)|trace\.csv|weights\.csv)"
    r"|export/[^/]+\.(ply|stl|obj|off|vtk|vtp|mesh|mat|pts|elem|lon|dat|xml|nrrd|nii\.gz|tfm|txt)(\.json)?"
    r"|case/(case\.toml|(points|prior_landmarks|init|held_out|correspondence|outliers)\.csv)"
    rf"|case/(prior|truth|phases/\d+){SURFACE}"
)
PAPER = r"paper_results\.json|index\.(html|md)|figures/[^/]+\.png|shapes/.+\.npz"
WRITTEN = {"run": re.compile(RUN), "paper": re.compile(PAPER)}


def write_manifest(folder: Path) -> None:
    """Name every file of a folder as ours, one a line, as a string of JSON."""
    _append_names(folder, _list_files(folder))


@contextmanager
def noted(folder: str | Path) -> Iterator[None]:
    """Name the files that the block adds to a run folder as ours; nothing where it has no manifest."""
    folder = Path(folder)
    if not (folder / MANIFEST).is_file():
        yield
        return
    before = set(_list_files(folder))
    try:
        yield
    finally:
        _append_names(folder, [name for name in _list_files(folder) if name not in before])


def foreign(folder: Path, kind: str) -> list[str]:
    """Return the files in a folder of a kind (run, case, paper) that o3dls did not write, by their paths in
    it.
    """
    if not (folder / MANIFEST).is_file():
        return [n for n in _list_files(folder) if kind not in WRITTEN or not WRITTEN[kind].fullmatch(n)]
    listed = set((folder / MANIFEST).read_text(encoding="utf-8", errors="replace").split("\n"))
    return [name for name in _list_files(folder) if json.dumps(name) not in listed]


def missing(folder: Path) -> list[str]:
    """Return the files that o3dls wrote in a folder and that are not there any more, by their paths in it;
    the manifest itself where there is none. Raises ValueError where it is damaged.
    """
    if not (folder / MANIFEST).is_file():
        return [MANIFEST]
    listed = (folder / MANIFEST).read_text(encoding="utf-8", errors="replace").splitlines()
    return [name for name in map(json.loads, listed) if not os.path.lexists(folder / name)]


def _append_names(folder: Path, names: list[str]) -> None:
    """Add names to the manifest, which is replaced: it may be a link, or be a file of another folder too."""
    path = folder / MANIFEST
    check_inside(path, folder)
    known = path.read_bytes() if path.exists() else b""
    staged = temporary_name(path)
    try:
        staged.write_bytes(known + "".join(f"{json.dumps(name)}\n" for name in names).encode())
        os.replace(staged, path)
    finally:
        staged.unlink(missing_ok=True)


def _list_files(folder: Path) -> list[str]:
    """Return the paths of the files and links below a folder, without the manifest. Raises OSError where a
    folder cannot be listed.
    """
    found = []
    for place, folders, files in os.walk(folder, onerror=_raise_error):
        links = [name for name in folders if (Path(place) / name).is_symlink()]
        found += [(Path(place) / name).relative_to(folder).as_posix() for name in (*links, *files)]
    return sorted(name for name in found if name != MANIFEST and name.split("/")[-1] not in IGNORED)


def _raise_error(error: OSError) -> None:
    raise error
