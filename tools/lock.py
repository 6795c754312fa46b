"""Write constraints.txt: the versions that pip resolves for every supported Python, extras included, without
addresses.

python tools/lock.py            # needs a python3.11, 3.12 ... on the PATH or from pyenv; a missing one is
resolved through the newest
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
HEAD = """\
# Exact versions of everything o3dls and its extras install, for pip's -c option.
# Written by tools/lock.py; no download addresses.
# open3d is open3d-cpu where that is not made (pyproject.toml); both have the same version.
"""


def interpreter(version: str) -> str | None:
    """Path of that Python, from the PATH or from pyenv."""
    known = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python{version}"))
    return str(known[-1]) if known else shutil.which(f"python{version}")


def resolve(version: str) -> dict[str, str]:
    """Versions by package name that pip would install for o3dls with all extras on that Python."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        here = interpreter(version)
        where = ["--python", here] if here else []
        target = [] if here else ["--python-version", version, "--target", folder]
        options = [
            "--quiet",
            "--dry-run",
            "--ignore-installed",
            "--only-binary=:all:",
            "--report",
            str(report),
        ]
        subprocess.run(
            [sys.executable, "-m", "pip", *where, "install", *options, *target, *wanted()], check=True
        )
        items = json.loads(report.read_text())["install"]
    return {item["metadata"]["name"].lower().replace("_", "-"): item["metadata"]["version"] for item in items}


def wanted() -> list[str]:
    """The requirements of pyproject.toml, extras included."""
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return project["dependencies"] + [
        need for extra in project["optional-dependencies"].values() for need in extra
    ]


def lines(found: dict[str, dict[str, str]]) -> list[str]:
    """One line per package where all Pythons agree, else one per Python with its marker; found is {python:
    {package: version}}.
    """
    out = []
    for name in sorted({name for versions in found.values() for name in versions}):
        pins = {python: versions[name] for python, versions in found.items() if name in versions}
        if len(set(pins.values())) == 1:
            out.append(f"{name}=={next(iter(pins.values()))}")
        else:
            out += [f"{name}=={pin}; python_version == '{python}'" for python, pin in pins.items()]
        if name == "open3d-cpu":
            out.append(out[-1].replace("open3d-cpu", "open3d"))
    return out


if __name__ == "__main__":
    text = "\n".join(lines({python: resolve(python) for python in PYTHONS}))
    (ROOT / "constraints.txt").write_text(f"{HEAD}{text}\n")
