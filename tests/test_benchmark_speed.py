"""benchmarks.speed: --cli names parts of a run that are there, --readers tells what damaged files do."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import reduce
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from benchmarks import speed
from benchmarks.speed import DAMAGED, ENDED, HUNG, READ, READERS, REFUSED, RUN_PARTS, WRONG

FORKS = pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")  # the child reads, and ends


@pytest.mark.parametrize("part", RUN_PARTS)
def test_the_parts_of_a_run_are_functions_of_the_package(part: str) -> None:
    module, name = RUN_PARTS[part].split(":")
    assert callable(reduce(getattr, name.split("."), import_module(module)))


def loop() -> int:
    while True:
        pass


def whole() -> tuple[np.ndarray, np.ndarray]:
    return np.eye(4, 3), np.array([[0, 1, 2], [0, 1, 3]])


def with_changes(vertex: float = 0.0, corner: int = 3, faces: int = 2) -> tuple[np.ndarray, np.ndarray]:
    vertices, corners = whole()
    vertices[0, 0] += vertex
    corners[1, 2] = corner
    return vertices, corners[:faces]


def raising(error: Exception) -> Callable[[], tuple[np.ndarray, np.ndarray]]:
    def read() -> tuple[np.ndarray, np.ndarray]:
        raise error

    return read


@FORKS
@pytest.mark.parametrize(
    ("reads", "became"),
    [
        (os.abort, ENDED),
        (raising(KeyError("no error of a reader")), ENDED),
        (loop, HUNG),
        (whole, READ),
        (lambda: with_changes(vertex=0.5), READ),  # no reader can know it
        (lambda: with_changes(vertex=np.nan), WRONG),
        (lambda: with_changes(corner=4), WRONG),
        (lambda: with_changes(corner=-1), WRONG),
        (lambda: with_changes(faces=1), WRONG),
        (lambda: with_changes(faces=0), REFUSED),
        (raising(ValueError("refused")), REFUSED),
    ],
)
def test_what_a_file_does_to_its_reader_is_told_from_outside(
    reads: Callable[[], tuple[np.ndarray, np.ndarray]], became: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(speed, "read_mesh", lambda reader, path: reads())
    monkeypatch.setattr(speed, "READER_SECONDS", 1)
    assert speed._judge_apart("o3dls", Path("some.ply"), (4, 2)) == became


@FORKS
def test_our_reader_refuses_damaged_files_or_reads_them_as_they_were(tmp_path: Path) -> None:
    pytest.importorskip("vtk")
    files = speed.whole_files(tmp_path)
    assert {path.suffix for path in files.values()} == set(READERS["o3dls"])
    for said, path in files.items():
        found = speed.judge_files("o3dls", path, 9, 7_311)
        assert sum(found) == 9
        assert found[REFUSED] >= 3, said  # those that are cut off, but for the last end of a line
        assert found[:REFUSED] == [0, 0, 0], said


def test_files_are_damaged_the_same_way_each_time() -> None:
    data = b"0123456789 of a file" * 20
    copies = [speed.damage(data, k, 5) for k in range(30)]
    assert copies == [speed.damage(data, k, 5) for k in range(30)]
    assert data not in copies
    assert {len(one) < len(data) for one in copies[::3]} == {True}
    assert {len(one) for one in copies[1::3] + copies[2::3]} == {len(data)}
    changed = [sum(a != b for a, b in zip(one, data, strict=True)) for one in copies[1::3]]
    assert 1 <= min(changed) < max(changed) <= 4


def test_the_table_of_the_documentation_is_of_all_formats_and_readers() -> None:
    text = (ROOT / "docs/files.md").read_text(encoding="utf-8")
    table = text.partition("<!-- python -m benchmarks.speed --readers -->")[2].partition("<!-- end -->")[0]
    head, _, *rows = [line.strip("| ").split(" | ") for line in table.strip().splitlines()]
    assert head == ["300 files", "reader", *DAMAGED]
    count = {reader: sum(row[1] == reader for row in rows) for reader in READERS}
    assert count == {"o3dls": 9, "Open3D": 5, "VTK": 9}  # files of each in binary and text, but OBJ
    assert {sum(map(int, row[2:])) for row in rows} == {300}
    ended, hung, wrong = np.array([row[2:5] for row in rows if row[1] == "o3dls"], dtype=int).sum(axis=0)
    assert (ended, hung) == (0, 0)
    assert wrong == 6, "docs/files.md says what became of six"
