"""A rule that is switched off is off in every settings object, and on again afterwards."""

from __future__ import annotations

from importlib import import_module

import pytest

from benchmarks import ablation
from benchmarks.rules import ALL, RULES, switched
from o3dls.cli.settings import CLASSES
from o3dls.reconstruction import reconstructed
from o3dls.reconstruction.settings import ReconstructionSettings
from o3dls.settings import numbers

for package in CLASSES:
    import_module(f"o3dls.{package}.settings")


def held() -> dict[str, float]:
    """The numbers of a class that holds others, as made new and as a module keeps it."""
    made, kept = numbers(ReconstructionSettings()), numbers(reconstructed.DEFAULTS)
    return {f"made {one.name}": one.value for one in made} | {f"kept {one.name}": one.value for one in kept}


def test_numbers_are_others_everywhere_and_afterwards_as_before() -> None:
    before = held()
    with switched({"SurplusSettings.most": 0.75, "ReconstructionSettings.rounds_inside": 11}):
        changed = {name: value for name, value in held().items() if value != before[name]}
    assert changed == {"made surplus.most": 0.75, "kept surplus.most": 0.75} | {
        "made rounds_inside": 11,
        "kept rounds_inside": 11,
    }
    assert held() == before


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_switches_numbers_that_there_are(rule: str) -> None:
    with switched(RULES[rule]):
        pass


@pytest.mark.parametrize("name", ["SurplusSettings.least", "NoSettings.most"])
def test_a_number_that_there_is_not_is_refused(name: str) -> None:
    before = held()
    with (
        pytest.raises(KeyError, match=name.split(".")[0]),
        switched({"SurplusSettings.most": 0.5, name: 1.0}),
    ):
        pass
    assert held() == before


def test_the_table_has_what_a_rule_adds_where_it_is_off() -> None:
    record = {"group": "jar", "bands": 0.95, "lost": None, "warnings": [], "seconds": 2.0, "begin": 2}
    records = [
        record | {"case": case, "rule": rule, "error": error}
        for case, rule, error in [("a", ALL, 0.5), ("a", "bends", 0.6), ("b", ALL, 0.5), ("b", "bends", 0.5)]
    ]
    row = ablation.table(records).splitlines()[2].split()
    assert row == ["bends", "1/2", "+0.0500", "0.0500", "+0.100", "+0.000", "+0.00", "+0.00", "0"]
