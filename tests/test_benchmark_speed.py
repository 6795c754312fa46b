"""benchmarks.speed --cli names parts of a run by file and function: they are there."""

from __future__ import annotations

import ast

import pytest
from conftest import ROOT

from benchmarks.speed_cli import PARTS


@pytest.mark.parametrize("part", [part for part in PARTS if part != "imports"])
def test_the_parts_of_a_run_are_functions_of_the_package(part: str) -> None:
    file, function = PARTS[part]
    (path,) = (path for path in (ROOT / "o3dls").rglob("*.py") if path.as_posix().endswith(f"/{file}"))
    found = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    assert function in {node.name for node in found if isinstance(node, ast.FunctionDef)}
