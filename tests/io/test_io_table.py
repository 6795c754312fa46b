"""Our CSV tables in other programs: what a spreadsheet would run as a formula is marked as text."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from o3dls.errors import InputError
from o3dls.io.table import read_table, write_table

SPREADSHEET = [
    "=1+1",
    "+cmd|' /C calc'!A0",
    "-x",
    "@SUM(A1)",
    "'=1",
    "''=1",
    "'",
    "'a",
    "-",
    "-007",
    "a=b",
    "#=1",
    "=a,b",
]


def test_texts_that_a_spreadsheet_would_run_are_marked_and_read_back_equal(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    values = np.array(SPREADSHEET, dtype=str)
    mixed = np.array([-1.5, 2, *SPREADSHEET[2:]], dtype=object)
    write_table(path, {"=head": values, "mixed": mixed, "x": np.linspace(-1.0, 1.0, len(values))})
    with path.open(newline="", encoding="utf-8") as file:  # as a spreadsheet reads it
        cells = [cell for row in csv.reader(file) for cell in row]
    assert not [cell for cell in cells if re.match(r"[=+@]|-(?!\d)|-0\d", cell)]
    assert {"-1.5", "2", "-1.0", "'=1+1", "'@SUM(A1)", "a=b"} < set(cells)
    back = read_table(path, ["x"])
    assert back.columns["=head"] == SPREADSHEET
    assert back.columns["mixed"] == ["-1.5", "2", *SPREADSHEET[2:]]
    assert back.numbers("x")[0] == -1.0


def test_texts_that_are_numbers_stay_as_they_are(tmp_path: Path) -> None:
    write_table(tmp_path / "table.csv", {"name": np.array(["-5", "+1e3", "-0.25"])})
    assert (tmp_path / "table.csv").read_text() == "name\n-5\n+1e3\n-0.25\n"


def test_a_semicolon_in_the_name_of_a_column_parts_nothing(tmp_path: Path) -> None:
    write_table(tmp_path / "table.csv", {"a;b": np.array(["1;2", "3"]), "x": np.arange(2.0)})
    back = read_table(tmp_path / "table.csv", ["x"])
    assert back.columns == {"a;b": ["1;2", "3"], "x": ["0.0", "1.0"]}


@pytest.mark.parametrize(
    ("cells", "kind"),
    [
        (["1.5", "", "-2e3"], "f"),
        (["nan", "1"], "f"),
        (["007", "008"], "U"),
        (["1", "-01"], "U"),
        (["9007199254740995", "1"], "U"),
        (["1_0", "2"], "U"),
        (["", ""], "U"),
    ],
)
def test_columns_read_at_one_go_are_as_cell_by_cell(cells: list[str], kind: str, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("name,a\n" + "".join(f"x,{cell}\n" for cell in cells))
    values = read_table(path, ()).values("a")
    assert values.dtype.kind == kind
    if kind == "f":
        np.testing.assert_array_equal(values, [float(cell or "nan") for cell in cells])


@pytest.mark.parametrize("cell", ["inf", "1_0", "1,5"])
def test_a_cell_that_is_no_number_here_is_refused_among_others_that_are(cell: str, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(f'a\n1\n"{cell}"\n')
    with pytest.raises(InputError, match="line 3"):
        read_table(path, ()).numbers("a", missing=True)
