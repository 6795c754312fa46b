"""The doctor finds what is missing and names the mend; every fault here is a real one, brought about on
purpose.
"""

from __future__ import annotations

import ast
import re
import sys
import time
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from conftest import ROOT

from o3dls.cli import doctor, environment
from o3dls.cli.commands import cli, run_command
from o3dls.cli.doctor import Check
from o3dls.cli.words import WRONG_INPUT
from o3dls.runs.run import Run


def attributes(path: Path) -> set[str]:
    """Every name that a source file reads behind a dot."""
    return {node.attr for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Attribute)}


def test_it_knows_every_filter_that_is_called() -> None:
    import pymeshlab

    users = [
        path
        for path in (ROOT / "o3dls").rglob("*.py")
        if "pymeshlab.MeshSet" in path.read_text(encoding="utf-8")
    ]
    assert set.union(*map(attributes, users)) & set(pymeshlab.filter_list()) == set(doctor.FILTERS)


def test_this_machine_is_well() -> None:
    assert [str(check) for check in doctor.diagnose() if check.needed and not check.ok] == []


def test_a_fault_is_told_with_its_mend() -> None:
    first, second = str(Check("filters", "missing: x", "sudo apt-get install y")).splitlines()
    assert first == "FAULT   filters: missing: x"
    assert second.strip() == "to fix this, run: sudo apt-get install y"


def test_a_missing_library_names_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str) -> None:
        raise OSError("libusb-1.0.so.0: cannot open shared object file:\n No such file or directory")

    monkeypatch.setattr(doctor, "import_module", refuse)
    check = doctor.check_module("open3d")
    assert check.remedy == "sudo apt-get install libusb-1.0-0"
    assert (
        check.found
        == "cannot be imported: libusb-1.0.so.0: cannot open shared object file: No such file or directory"
    )


def test_a_missing_module_is_installed_by_pip() -> None:
    check = doctor.check_module("no_such_module_of_ours")
    assert "No module named" in check.found
    assert check.remedy.startswith("python -m pip install")


def test_two_distributions_in_one_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_find_version", lambda name: "0.20.0")
    assert "uninstall -y open3d open3d-cpu" in doctor._check_open3d().remedy


def test_missing_filters_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymeshlab", SimpleNamespace(filter_list=lambda: doctor.FILTERS[1:]))
    check = doctor._check_filters()
    assert check.found == f"missing: {doctor.FILTERS[0]}"
    assert "libopengl0" in check.remedy


def test_a_plugin_that_cannot_be_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    from o3dls.plugins import plugin as stage

    broken = EntryPoint("broken", "o3dls.no_such_file:Stage", "o3dls.stages")
    monkeypatch.setattr(stage, "registered", lambda group: {"broken": broken})
    assert "no_such_file" in doctor._check_plugins().found


def test_nothing_installed_has_no_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    from o3dls.plugins import plugin as stage

    monkeypatch.setattr(stage, "registered", lambda group: {})
    assert not doctor._check_plugins().ok


def test_a_kernel_cache_that_cannot_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    from numba.core import caching

    # as where neither the package's folder nor the home may be written
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    check = doctor._check_kernel_cache()
    assert "no locator available" in check.found
    assert check.remedy.startswith("export NUMBA_CACHE_DIR=")


@pytest.mark.parametrize(
    ("script", "found"),
    [
        ("import time; time.sleep(60)", "no picture within 0.5 s"),
        ("import sys; sys.exit('libEGL.so.1: cannot open')", "ended with code 1: libEGL.so.1: cannot open"),
        ("import os; os.abort()", "ended with code -6: no message"),
    ],
)
def test_a_renderer_that_hangs_fails_or_crashes_is_not_needed(
    script: str, found: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "RENDER", script)
    monkeypatch.setattr(doctor, "RENDER_SECONDS", 0.5)
    check = doctor._check_renderer()
    assert (check.found, check.ok, check.needed) == (found, False, False)
    assert check.remedy.startswith("sudo apt-get install libegl1")


def test_it_compiles_every_loop_of_a_run_and_its_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a process whose folder for compiled code is empty it would take half a minute: here the runs that
    compile are looked at.
    """
    done = list[tuple[int, int, bool]]()
    write = Run.write

    def written(run: Run, folder: Path) -> Path:
        out = write(run, folder)
        done.append((run.case.dimension, run.provenance.pipeline["folds"], (out / "report.html").is_file()))
        return out

    monkeypatch.setattr(Run, "write", written)
    ended = CliRunner().invoke(cli, ["doctor", "--compile", "-q"])
    assert ended.exit_code == 0, ended.output
    assert re.fullmatch(r"compiled in \d+ s\n", ended.stdout)
    assert done == [(3, 0, True), (2, 0, True)]


def test_the_real_renderer_answers_in_time() -> None:
    """Either outcome is good, as long as the doctor comes back."""
    assert doctor._check_renderer().found


@pytest.mark.parametrize(
    "command", [["demo"], ["run", "--case", "c", "--out", "r"], ["batch", "c", "--out", "r"]]
)
@pytest.mark.parametrize(
    ("library", "module", "package"),
    [("libEGL.so.1", "open3d", "libegl1"), ("libGL.so.1", "pymeshlab", "libgl1"), ("", "trimesh", "")],
)
def test_a_run_says_in_the_first_second_what_cannot_be_imported(
    command: list[str],
    library: str,
    module: str,
    package: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    """As after a plain `pip install` on a machine without a screen: nothing is read or written."""
    monkeypatch.chdir(tmp_path)

    def refuse(name: str) -> None:
        if name == module:
            raise ImportError(f"{library or name}: cannot open shared object file: No such file")

    monkeypatch.setattr(doctor, "import_module", refuse)
    monkeypatch.setattr(environment, "_is_there", lambda name: name != library)
    monkeypatch.setattr(
        environment, "find_spec", lambda name: None if not library and name == module else name
    )
    begin = time.process_time()
    assert run_command(command) == WRONG_INPUT
    assert time.process_time() - begin < 1.0
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_imported_is_said_as_the_doctor_says_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(name: str) -> None:
        raise OSError("libEGL.so.1: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(doctor, "import_module", refuse)
    monkeypatch.setattr(environment, "_is_there", lambda name: name != "libEGL.so.1")
    run_command(["demo"])
    said = capsys.readouterr().err
    assert "FAULT open3d: cannot be imported: libEGL.so.1: " in said
    assert "to fix this, run: sudo apt-get install libegl1" in said
    assert said.count("\n") == 1


def test_what_nothing_needs_of_the_system_is_not_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment, "_is_there", lambda name: False)
    environment.check_libraries()
