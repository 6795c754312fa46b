"""Every door holds against its seeds, among which is all that once broke it, and some changes of them; the
long hours are `./dev fuzz`.
"""

from __future__ import annotations

import re
from functools import cache

import pytest
from conftest import ROOT
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.fuzz.__main__ import NAMES
from tests.fuzz.changes import changed
from tests.fuzz.doors import DOORS


@cache
def seeds(name: str) -> list[bytes]:
    return DOORS[name].seeds()


@pytest.mark.parametrize("name", NAMES)
def test_a_door_holds_against_its_seeds(name: str) -> None:
    for seed in seeds(name):
        DOORS[name](seed)
    DOORS[name].read(seeds(name)[0])  # the first is whole


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_a_door_holds_against_changes_of_its_seeds(name: str, data: st.DataObject) -> None:
    DOORS[name](data.draw(changed(seeds(name))))


def test_continuous_integration_fuzzes_every_door() -> None:
    assert list(DOORS) == list(NAMES)
    assert re.search(r"\./dev fuzz --seconds \d+", (ROOT / ".github/workflows/test.yml").read_text())
