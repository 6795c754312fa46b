"""What pyproject.toml and constraints.txt say must match the tree and what is installed."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from conftest import ROOT
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
CONSTRAINTS = [
    line for line in (ROOT / "constraints.txt").read_text().splitlines() if not line.startswith("#")
]


def installed_here() -> dict[str, str]:
    """Versions by name of everything that o3dls with all its extras needs here, as far as it is installed."""
    found = installed("o3dls", frozenset(PROJECT["project"]["optional-dependencies"]), {})
    assert len(found) > 50, "the walk over the requirements found next to nothing"
    return found


def installed(name: str, extras: frozenset[str], seen: dict[str, str]) -> dict[str, str]:
    """Versions by name of a distribution and of everything it needs here, as far as it is installed."""
    for text in distribution(name).requires or []:
        need = Requirement(text)
        key = canonicalize_name(need.name)
        if key in seen or not any(
            need.marker is None or need.marker.evaluate({"extra": extra}) for extra in extras | {""}
        ):
            continue
        try:
            seen[key] = distribution(key).version
        except PackageNotFoundError:  # an extra that was not asked for
            continue
        installed(key, frozenset(need.extras), seen)
    return seen


def test_every_package_is_listed() -> None:
    folders = {
        path.parent.relative_to(ROOT).as_posix().replace("/", ".")
        for path in (ROOT / "o3dls").rglob("__init__.py")
    }
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == folders | {"o3dls.pipelines", "data_synth"}


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy to build from, because the build leaves folders behind."""
    copy = tmp_path_factory.mktemp("source") / "o3dls"
    for name in ("o3dls", "pipelines", "data_synth"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    return copy


def build(what: str, folder: Path) -> Path:
    """The wheel or sdist of a folder, by its build backend alone: no network, no environment of its own;
    setuptools is there, since dash needs it.
    """
    command = f"from setuptools.build_meta import build_{what} as build; print(build('out'))"
    done = subprocess.run(
        [sys.executable, "-c", command], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder / "out" / done.stdout.splitlines()[-1]


def packed(wheel: Path) -> set[str]:
    """What a wheel installs."""
    return {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}


def test_the_wheel_holds_every_file_of_the_package_and_nothing_else(source: Path) -> None:
    folders = (source / "o3dls", source / "data_synth")
    tree = {
        path.relative_to(source).as_posix()
        for folder in folders
        for path in folder.rglob("*")
        if path.is_file()
    }
    pipelines = {f"o3dls/pipelines/{path.name}" for path in (ROOT / "pipelines").glob("*.*")}
    found = packed(build("wheel", source))
    assert found == tree | pipelines
    assert "o3dls/py.typed" in found  # its types hold for those who import it


def test_the_sdist_builds_the_same_wheel(source: Path, tmp_path: Path) -> None:
    with tarfile.open(build("sdist", source)) as archive:
        names = {Path(*Path(name).parts[1:]).as_posix() for name in archive.getnames()}
        safe = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}  # not in the 3.11.2 of Debian 12
        archive.extractall(tmp_path, **safe)
    assert {"pyproject.toml", "README.md", "LICENSE", "PKG-INFO", "o3dls/py.typed"} <= names
    assert packed(build("wheel", next(tmp_path.iterdir()))) == packed(build("wheel", source))


def test_what_is_uploaded_passes_the_check_of_twine(source: Path) -> None:
    pytest.importorskip("twine", reason="twine is not installed")
    made = [str(build(what, source)) for what in ("wheel", "sdist")]
    command = [sys.executable, "-m", "twine", "check", "--strict", *made]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert done.stdout.count("PASSED") == 2


def test_every_installed_package_is_the_locked_one() -> None:
    pins = {
        canonicalize_name(r.name): r
        for r in map(Requirement, CONSTRAINTS)
        if r.marker is None or r.marker.evaluate()
    }
    here = installed_here()
    loose = {
        name: version
        for name, version in here.items()
        if name not in pins or version not in pins[name].specifier
    }
    assert not loose, (
        f"not as in constraints.txt (./dev test installs it; python tools/lock.py writes it): {loose}"
    )


def test_every_locked_package_takes_the_first_release_of_this_python() -> None:
    """Debian 12 has 3.11.2; a package that asks for 3.11.5 cannot be installed there."""
    first = f"{sys.version_info[0]}.{sys.version_info[1]}.0"
    about = {name: distribution(name).metadata for name in installed_here()}
    asked = {name: said["Requires-Python"] for name, said in about.items() if "Requires-Python" in said}
    assert not {name: python for name, python in asked.items() if first not in SpecifierSet(python)}


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13", "3.14"])
def test_every_python_has_one_exact_version(python: str) -> None:
    rows = [Requirement(line) for line in CONSTRAINTS]
    here = [r for r in rows if r.marker is None or r.marker.evaluate({"python_version": python})]
    assert len({r.name for r in here}) == len(here)
    assert all(re.fullmatch(r"==[\w.]+", str(r.specifier)) and r.url is None for r in rows)
