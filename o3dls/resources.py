"""Files that come with the package: pipelines and the built-in case of `o3dls demo`."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from .errors import InputError, did_you_mean


def pipeline_files() -> dict[str, Path]:
    """Packaged pipeline files by name (`default` for `default.toml`)."""
    folder = Path(str(files("o3dls.pipelines")))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def pipeline_file(name: str) -> Path:
    """The packaged pipeline file of that name. Raises InputError with the closest known name."""
    found = pipeline_files()
    if name not in found:
        raise InputError(f"no packaged pipeline '{name}'" + did_you_mean(name, list(found)))
    return found[name]


def demo_case() -> Path:
    """Folder of the built-in case: a synthetic atrium with truth."""
    return Path(str(files("o3dls"))) / "demo_case"
