"""A disk that is full, a process that is killed: what was there stays, and nothing half is left."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from formats import write_as
from test_io_study import carto_folder
from tiny import ball_case

from o3dls.cli.main import answer
from o3dls.errors import InputError
from o3dls.io.atomic import check_free, staged_file, staged_files, write_file
from o3dls.io.case_writer import write_case
from o3dls.places import partial_name, remove_partial
from tests.finished import finished

FULL = OSError(errno.ENOSPC, "No space left on device")


def fill(monkeypatch: pytest.MonkeyPatch, how: str, name: str = "") -> None:
    """From now on only half of a file fits on the disk: told at once, on fsync, or never. name: of files that
    have it in theirs.
    """

    def half(path: Path, content: Any, *args: Any, **kwargs: Any) -> int:
        part = content if name not in path.name else content[: len(content) // 2]
        data = part.encode() if isinstance(part, str) else part
        with path.open("wb") as file:
            file.write(data)
        if how == "at once" and name in path.name:
            raise FULL
        return len(data)

    def late(_: int) -> None:
        raise FULL

    if how == "on fsync":
        monkeypatch.setattr(os, "fsync", late)
    else:
        monkeypatch.setattr(Path, "write_bytes", half)
        monkeypatch.setattr(Path, "write_text", half)


@pytest.mark.parametrize("how", ["at once", "on fsync", "never"])
@pytest.mark.parametrize("suffix", [".mat", ".ply", ".vtp", ".mesh"])
def test_convert_keeps_the_old_file_where_the_new_one_does_not_fit(
    suffix: str,
    how: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    source = write_as("stl", tmp_path)
    (tmp_path / "out").mkdir()
    target = tmp_path / "out" / f"old{suffix}"
    target.write_bytes(b"old")
    fill(monkeypatch, how)
    assert answer(["convert", str(source), str(target)]) == 2
    assert f"{target}: cannot be written" in capsys.readouterr().err
    assert target.read_bytes() == b"old"
    assert [path.name for path in target.parent.iterdir()] == [target.name]


@pytest.mark.parametrize("how", ["at once", "never"])
def test_export_writes_file_and_sidecar_or_neither(
    how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = finished(tmp_path / "run")
    out = tmp_path / "out" / "a.stl"
    assert answer(["export", str(run), "--format", "stl", "--out", str(out)]) == 0
    sidecar = out.with_name("a.stl.json")
    sidecar.write_bytes(b"of an earlier export")
    out.write_bytes(b"an earlier export")
    fill(monkeypatch, how, ".json")
    assert answer(["export", str(run), "--format", "stl", "--out", str(out)]) == 2
    assert f"{sidecar}: cannot be written" in capsys.readouterr().err
    assert out.read_bytes() == b"an earlier export"
    assert sidecar.read_bytes() == b"of an earlier export"
    assert sorted(path.name for path in out.parent.iterdir()) == ["a.stl", "a.stl.json"]


@pytest.mark.parametrize("how", ["at once", "on fsync", "never"])
@pytest.mark.parametrize("name", ["points", "map", "case"])
def test_import_leaves_no_half_of_a_case(
    name: str, how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    study = str(carto_folder(tmp_path / "study"))
    (tmp_path / "out").mkdir()
    fill(monkeypatch, how, name)
    assert answer(["import", study, str(tmp_path / "out/case"), "--map", "1-Map"]) == 2
    assert "cannot be written" in capsys.readouterr().err
    assert list((tmp_path / "out").iterdir()) == []
    monkeypatch.undo()
    assert answer(["import", study, str(tmp_path / "out/case"), "--map", "1-Map"]) == 0


def test_a_case_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fill(monkeypatch, "never", "init")
    with pytest.raises(InputError, match=r"init\.csv: cannot be written: the disk kept \d+ of \d+ bytes"):
        write_case(tmp_path / "case", ball_case(init=np.eye(4)))
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = []
    replaced, synced = os.replace, os.fsync
    monkeypatch.setattr(os, "replace", lambda *names: (done.append("renamed"), replaced(*names)))
    monkeypatch.setattr(os, "fsync", lambda file: (done.append("on disk"), synced(file)))
    write_file(tmp_path / "a.txt", "é\n")
    assert done == ["on disk", "renamed"]
    assert (tmp_path / "a.txt").read_bytes() == "é\n".encode()


def test_what_a_process_that_is_killed_while_it_asks_leaves_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder cannot be tried without making one, and a killed process does not take it away."""
    with monkeypatch.context() as patched:
        patched.setattr("o3dls.io.atomic.shutil.rmtree", lambda *_, **__: None)
        check_free(tmp_path / "run")
    assert len(list(tmp_path.iterdir())) == 1
    remove_partial(tmp_path / "other", os.getpid())
    remove_partial(tmp_path / "run", os.getpid() + 1)
    assert len(list(tmp_path.iterdir())) == 1
    remove_partial(tmp_path / "run", os.getpid())
    assert list(tmp_path.iterdir()) == []


def test_what_any_process_left_is_found_but_nothing_of_a_folder_with_a_like_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    long = "a name of more letters than a temporary one shows, patient "
    with monkeypatch.context() as patched:
        patched.setattr("o3dls.io.atomic.shutil.rmtree", lambda *_, **__: None)
        for name in ("run", "run.1", "run.2", long + "1", long + "2"):
            check_free(tmp_path / name)
    for gone, left in (("run.1", 4), (long + "1", 3), ("run", 2)):
        remove_partial(tmp_path / gone)
        assert len(list(tmp_path.iterdir())) == left


@pytest.mark.parametrize("write", [staged_file, staged_files])
def test_a_file_removes_what_a_killed_process_left_half_made_beside_it(write: Any, tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    half = partial_name(tmp_path / "a.vtp")
    dead = tmp_path / half.replace(f"-{os.getpid():x}@", f"-{ended.pid:x}@")
    for path in (dead, tmp_path / half):
        path.write_text("<")
    with write(tmp_path / "a.vtp") as staged:
        staged.write_text("whole")
    assert {path.name for path in tmp_path.iterdir()} == {"a.vtp", half}  # that of a process at work stays
