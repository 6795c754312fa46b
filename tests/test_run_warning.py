"""Warnings are told apart by code and stage; every code means something and is used."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from conftest import ROOT

from o3dls.run_warning import CODES, RunWarning, each_once, of_stage


def test_a_warning_reads_as_its_sentence_and_knows_its_code() -> None:
    warning = RunWarning("many-outliers", "60% of the points are outliers")
    assert str(warning) == "60% of the points are outliers"
    assert warning.record() == {"code": "many-outliers", "stage": "", "sentence": warning.sentence}
    with pytest.raises(ValueError, match="no warning code 'many-outlier'"):
        RunWarning("many-outlier", "...")


def test_a_stage_is_filled_in_once() -> None:
    new, old = RunWarning("other", "new"), RunWarning("other", "old", "icp")
    assert [one.stage for one in of_stage([new, old], "deform")] == ["deform", "icp"]


def test_equal_sentences_of_two_stages_are_two_warnings() -> None:
    first, second = (RunWarning("many-outliers", "60%", stage) for stage in ("a", "b"))
    assert each_once([first, second, first]) == (first, second)


def test_every_code_is_kebab_case_explained_and_used() -> None:
    sources = "\n".join(path.read_text(encoding="utf-8") for path in Path(ROOT / "o3dls").rglob("*.py"))
    for code, meaning in CODES.items():
        assert re.fullmatch(r"[a-z]+(-[a-z]+)*", code)
        assert meaning
        assert code == "other" or f'RunWarning("{code}"' in re.sub(r"\(\s+", "(", sources), code
