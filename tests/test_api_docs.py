"""Public functions say what they take, give and refuse, as numpydoc lays it out, and their examples run."""

from __future__ import annotations

import doctest
import inspect
import re
import shutil
from importlib import import_module
from pathlib import Path

import pytest

import o3dls
from o3dls.resources import demo_case
from tests.io.test_io_study import carto_folder

FUNCTIONS = [name for name in o3dls.PUBLIC if inspect.isfunction(getattr(o3dls, name))]
NEED_A_RUN = ("carry", "read_run", "suggest")
PIPELINE = """\
[[stage]]
use = "landmarks"

[[stage]]
use = "icp"
"""


def blocks(name: str) -> dict[str, str]:
    """The blocks of a function's docstring by heading; what stands before them under the empty one."""
    parts = re.split(r"^(\w+)\n-{3,}\n", inspect.getdoc(getattr(o3dls, name)) or "", flags=re.MULTILINE)
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_parameter_has_its_lines_and_no_other(name: str) -> None:
    told = re.findall(r"^(\*{0,2}\w+)(?: : .+)?\n +\S", blocks(name)["Parameters"], re.MULTILINE)
    parameters = inspect.signature(getattr(o3dls, name)).parameters.values()
    assert told == [f"**{one.name}" if one.kind is one.VAR_KEYWORD else one.name for one in parameters]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_default_is_told_where_there_is_one(name: str) -> None:
    told = dict(re.findall(r"^(\w+) : (.+)", blocks(name)["Parameters"], re.MULTILINE))
    for one in inspect.signature(getattr(o3dls, name)).parameters.values():
        if one.kind is not one.VAR_KEYWORD:
            assert ("default" in told[one.name]) == (one.default is not one.empty), one.name


@pytest.mark.parametrize("name", FUNCTIONS)
def test_what_comes_back_and_what_is_refused_have_blocks(name: str) -> None:
    gives = inspect.signature(getattr(o3dls, name)).return_annotation not in (None, "None")
    wanted = ["", "Parameters", *["Returns"] * gives, "Raises", "Examples"]
    assert list(blocks(name)) == wanted
    assert blocks(name)["Raises"].startswith(("InputError\n", "PipelineError\n"))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the examples read: a case, a pipeline file and an export of CARTO."""
    folder = tmp_path_factory.mktemp("examples")
    shutil.copytree(demo_case(), folder / "case")
    (folder / "pipeline.toml").write_text(PIPELINE, encoding="utf-8")
    carto_folder(folder / "study")
    return folder


@pytest.fixture(scope="module")
def run(files: Path) -> None:
    stages = [o3dls.Landmarks(), o3dls.ICP(), o3dls.Deform()]
    o3dls.Pipeline(stages, folds=0).run(o3dls.read_case(files / "case")).write(files / "run")


def examples_of(name: str) -> None:
    found = getattr(o3dls, name)
    tests = doctest.DocTestFinder(recurse=False).find(found, name, import_module(found.__module__), {})
    assert tests[0].examples
    told: list[str] = []
    runner = doctest.DocTestRunner(verbose=False)
    for test in tests:
        runner.run(test, out=told.append)
    assert not told, "".join(told)


@pytest.mark.parametrize("name", [name for name in FUNCTIONS if name not in NEED_A_RUN])
def test_the_example_runs(name: str, files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(files)
    examples_of(name)


@pytest.mark.usefixtures("run")
@pytest.mark.parametrize("name", NEED_A_RUN)
def test_the_example_on_a_run_runs(name: str, files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(files)
    examples_of(name)
