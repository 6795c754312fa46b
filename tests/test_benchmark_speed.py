"""benchmarks.speed --cli names parts of a run by module and function: they are there."""

from __future__ import annotations

from functools import reduce
from importlib import import_module

import pytest

from benchmarks.speed import RUN_PARTS


@pytest.mark.parametrize("part", RUN_PARTS)
def test_the_parts_of_a_run_are_functions_of_the_package(part: str) -> None:
    module, name = RUN_PARTS[part].split(":")
    assert callable(reduce(getattr, name.split("."), import_module(module)))
