"""What the pages of docs/ show is executed, each page in its order and in a folder of its own."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import ROOT
from test_readme import BLOCK, execute

PAGES = (
    *("start", "points", "landmarks", "pipeline_file", "frames_and_units", "label_volumes", "image"),
    *("tutorial_icp", "tutorial_python", "tutorial_cohort", "tutorial_organs"),
)


@pytest.mark.parametrize("name", PAGES)
def test_what_a_page_shows_runs(name: str, tmp_path: Path) -> None:
    page = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    blocks = list(BLOCK.finditer(page))
    assert len(blocks) == page.count("\n```") // 2
    for block in blocks:
        if not block["spared"]:
            execute(block["language"], block["code"], tmp_path)
