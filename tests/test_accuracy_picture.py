"""The picture of the error over the number of points shows the tables of its page."""

from __future__ import annotations

import runpy
from typing import Any

import pytest
from conftest import ROOT
from PIL import Image


@pytest.fixture(scope="module")
def tool() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "tools" / "accuracy_picture.py"))


@pytest.fixture(scope="module")
def tables(tool: dict[str, Any]) -> list[Any]:
    found: list[Any] = tool["numbers"](tool["PAGE"].read_text(encoding="utf-8"))
    return found


def test_a_table_is_read_with_every_method_and_number_of_points(tool: dict[str, Any], tables: Any) -> None:
    assert len(tables) == len(tool["TITLES"])
    for lines in tables:
        assert set(lines) == set(tool["LOOKS"])
        assert {tuple(n for n, *_ in line) for line in lines.values()} == {(100, 250, 1000, 4000, 20_000)}


def test_the_picture_shows_the_numbers_of_the_page(tool: dict[str, Any], tables: Any) -> None:
    """Where it does not: `python tools/accuracy_picture.py` draws it anew."""
    with Image.open(tool["PICTURE"]) as picture:
        assert picture.info["Description"] == tool["told"](tables)


def test_distances_stand_as_plain_numbers_in_letters_that_can_be_read(
    tool: dict[str, Any], tables: Any
) -> None:
    figure = tool["drawn"](tables)
    figure.canvas.draw()
    assert figure.get_figwidth() < 8  # inches: on a page 700 pixels wide a letter of 9 points has 11 pixels
    axis = figure.axes[0]
    shown = [label.get_text() for label in axis.get_yticklabels()]
    assert shown == ["0.2", "0.3", "0.5", "1", "2", "3", "5"]
    assert [label.get_text() for label in axis.get_xticklabels()] == [
        "100",
        "250",
        "1 000",
        "4 000",
        "20 000",
    ]
    assert min(label.get_fontsize() for label in axis.get_yticklabels()) >= 9
