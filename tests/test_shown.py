"""The pictures of docs/report.md show what this version says of the demo."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT

import o3dls

SHOWN: dict[str, Any] = json.loads((ROOT / "docs" / "report_shown.json").read_text(encoding="utf-8"))
NUMBER = re.compile(r"\d+(?:\.\d+)?")
PARTS = {"overall": ('<p class="overall', "</p>"), "answers": ("<dd>", "</dd>"), "strip": ("<li", "</li>")}
ROUNDED = 0.06  # a last digit that another machine rounds otherwise; of large numbers a twentieth


def said(page: str) -> dict[str, list[str]]:
    """What the first screen of a page says, as tools/report_pictures.py writes it down."""
    head = page[page.index("<header>") : page.index("</header>")]
    return {
        name: [
            unescape(re.sub("<[^>]+>", "", one)) for one in re.findall(f"{begin}.*?{end}", head, re.DOTALL)
        ]
        for name, (begin, end) in PARTS.items()
    }


def differences(told: dict[str, Any], found: dict[str, Any]) -> list[tuple[str, str]]:
    """The texts that differ in a word, or in a number by more than rounding does."""
    pairs = [
        pair
        for name in PARTS
        for pair in zip(told[name], found[name], strict=len(told[name]) == len(found[name]))
    ]
    return [(a, b) for a, b in pairs if NUMBER.sub("#", a) != NUMBER.sub("#", b) or not close(a, b)]


def close(one: str, other: str) -> bool:
    first, second = ([float(x) for x in NUMBER.findall(text)] for text in (one, other))
    return first == pytest.approx(second, rel=0.05, abs=ROUNDED)


def test_a_number_and_a_word_that_are_not_of_the_version_are_noticed() -> None:
    assert SHOWN["version"] == o3dls.__version__
    assert all(SHOWN[name] for name in PARTS)
    assert differences(SHOWN, SHOWN) == []
    for old, new in (("OK", "CHECK"), ("0.", "3.")):
        changed = json.loads(json.dumps(SHOWN).replace(old, new))
        assert len(differences(SHOWN, changed)) > 1


def test_the_pictures_say_what_a_run_of_the_demo_says(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "o3dls", "demo", "--quiet", "--out", str(tmp_path / "demo")]
    subprocess.run(command, check=True, timeout=600)
    page = (tmp_path / "demo" / "report.html").read_text(encoding="utf-8")
    found = said(page)
    assert [len(found[name]) for name in PARTS] == [len(SHOWN[name]) for name in PARTS]
    assert differences(SHOWN, found) == [], "draw the pictures again: tools/report_pictures.py"
