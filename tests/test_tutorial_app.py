"""docs/tutorial_app.md is done as it stands, by mouse, and the page says what is quoted."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT

from tests.app.hand import Hand
from tests.app.served import served
from tests.browser import Visit
from tests.viewer import FIXTURES
from tools.app_pictures import STUDY, make_study, walk

_, _, launch, browser, _ = FIXTURES

PAGE = (ROOT / "docs/tutorial_app.md").read_text(encoding="utf-8")
PICTURES = re.findall(r"\((tutorial_app_\w+\.png)\)", PAGE)


def test_the_page_says_what_the_tutorial_quotes(browser: Any, tmp_path: Path) -> None:
    quoted = re.findall(r"^> (.+)$", PAGE, re.MULTILINE)
    assert len(quoted) == 7
    seen: list[str] = []
    with served(tmp_path / "work") as app:
        visit = Visit(browser, app.server.url, wait=False)
        hand = Hand(visit)
        pictures = []

        def take(picture: str, element: str) -> None:
            pictures.append(f"tutorial_app_{picture}.png")
            seen.append(visit.page.locator("main").inner_text())

        walk(hand, make_study(tmp_path), take)
        visit.page.close()
    assert pictures == PICTURES
    text = " ".join(seen + hand.heard)
    assert [one for one in quoted if one not in text] == []


def test_its_first_command_is_that_of_the_pictures() -> None:
    assert " ".join(["python", *STUDY[1:]]) in PAGE


@pytest.mark.parametrize("picture", PICTURES)
def test_pictures_are_small(picture: str) -> None:
    assert 20_000 < (ROOT / "docs" / picture).stat().st_size < 200_000
