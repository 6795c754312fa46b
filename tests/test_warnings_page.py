"""docs/warnings.md explains every warning and every exit code, and nothing that is no more."""

from __future__ import annotations

import re
import signal
from pathlib import Path

from conftest import ROOT
from test_readme import BLOCK, execute

from o3dls.cli import words
from o3dls.run_warning import CODES

PAGE = (ROOT / "docs" / "warnings.md").read_text(encoding="utf-8")
ENTRY = re.compile(r"^### (?P<code>[a-z-]+)\n\n(?P<text>(?:.+\n)+)", re.MULTILINE)
GIVEN = re.compile(r'RunWarning\(\s*"([a-z-]+)"')


def test_every_warning_that_the_source_gives_has_an_entry_and_no_entry_is_dead() -> None:
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / "o3dls").rglob("*.py")]
    given = {code for text in sources for code in GIVEN.findall(text)}
    entries = [found["code"] for found in ENTRY.finditer(PAGE)]
    assert len(given) > 20
    assert len(entries) == len(set(entries))
    # a stage of another package gives `other`
    assert set(entries) == given | {"other"}


def test_an_entry_begins_with_the_meaning_that_the_code_has_and_goes_on_with_what_to_do() -> None:
    for found in ENTRY.finditer(PAGE):
        text = " ".join(found["text"].split())
        meaning = CODES[found["code"]]
        assert text.startswith(f"{meaning[0].upper()}{meaning[1:]}. "), found["code"]
        assert len(text) > len(meaning) + 40, found["code"]


def test_the_exit_codes_are_those_of_the_command_line() -> None:
    told = [128 + number for number in (signal.SIGINT, signal.SIGTERM)]
    known = {words.DONE, words.NOT_VALID, words.WRONG_INPUT, words.INTERNAL, words.UNREAD, *told}
    assert {int(code) for code in re.findall(r"^\| (\d+) \|", PAGE, re.MULTILINE)} == known


def test_what_the_page_shows_runs(tmp_path: Path) -> None:
    blocks = list(BLOCK.finditer(PAGE))
    assert blocks
    for block in blocks:
        execute(block["language"], block["code"], tmp_path)
