"""What is written stays in its folder, whatever links, names and remains of killed processes stand there."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_io_study import carto_folder
from tiny import Nudge, ball_case

from o3dls.cli.main import answer
from o3dls.errors import InputError
from o3dls.io import manifest
from o3dls.io.atomic import write_file
from o3dls.io.case_writer import write_case
from o3dls.io.mapping.study_import import import_study
from o3dls.live.finish import finish
from o3dls.live.journal import begin_journal, resume_journal
from o3dls.live.session import Session
from o3dls.pipeline.batch import run_cohort
from o3dls.pipeline.pipeline import Pipeline
from o3dls.pipeline.study import planned, read_study
from o3dls.places import beside, check_name, plain_name, temporary_name, unique_names
from o3dls.report.writer import write_report
from o3dls.runs.export.finished import export_run
from o3dls.runs.log import log_of_failure
from tests.finished import finished

MINE = "mine, and outside of the folder"


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A file of somebody else's, to which links lead; whatever is written, it stays."""
    path = tmp_path / "mine"
    path.write_text(MINE)
    return path


@pytest.mark.parametrize(
    "link", ["report.html", "report.pdf", "figures", "figures/summary.png", "manifest.txt"]
)
def test_a_report_in_a_run_folder_follows_no_link(link: str, tmp_path: Path, mine: Path) -> None:
    run = finished(tmp_path / "run")
    outside = tmp_path / "outside"
    outside.mkdir()
    place = run / link
    place.parent.mkdir(exist_ok=True)
    place.unlink(missing_ok=True)
    place.symlink_to(outside if link == "figures" else mine)
    with pytest.raises(InputError, match=rf"{link}: is a link to .*remove the link"):
        write_report([run], pdf=True)
    assert mine.read_text() == MINE
    assert list(outside.iterdir()) == []


@pytest.mark.parametrize("link", ["export", "export/level_set.ply", "export/level_set.ply.json"])
def test_an_export_in_a_run_folder_follows_no_link(link: str, tmp_path: Path, mine: Path) -> None:
    run = finished(tmp_path / "run")
    outside = tmp_path / "outside"
    outside.mkdir()
    place = run / link
    place.parent.mkdir(exist_ok=True)
    place.symlink_to(outside if link == "export" else mine)
    with pytest.raises(InputError, match=r"is a link to .*remove the link"):
        export_run(run)
    assert mine.read_text() == MINE
    assert list(outside.iterdir()) == []


def test_a_page_that_its_user_names_is_written_where_its_link_leads(tmp_path: Path, mine: Path) -> None:
    (tmp_path / "own.html").symlink_to(mine)
    write_report([finished(tmp_path / "run")], tmp_path / "own.html")
    assert "<!doctype html>" in mine.read_text()


def test_a_folder_that_its_user_names_may_be_a_link(tmp_path: Path) -> None:
    run = finished(tmp_path / "far/run")
    (tmp_path / "near").symlink_to(run)
    write_report([tmp_path / "near"])
    assert (run / "report.html").is_file()


@pytest.mark.parametrize("link", ["cohort.csv", "cohort.html", "one", "few.failed.json"])
def test_a_batch_follows_no_link_in_its_folder(link: str, tmp_path: Path, mine: Path) -> None:
    for name in ("one", "few"):
        write_case(tmp_path / name, replace(ball_case(), name=name))
    out = tmp_path / "runs"
    out.mkdir()
    elsewhere = finished(tmp_path / "elsewhere")
    before = (elsewhere / "run.json").read_bytes()
    (out / link).symlink_to(elsewhere if link == "one" else mine)
    (tmp_path / "few/points.csv").write_text("x,y,z\n1,2\n")
    (tmp_path / "p.toml").write_text('folds = 0\n[[stage]]\nuse = "landmarks"\n')
    given = [str(tmp_path / name) for name in ("one", "few")]
    assert (
        answer(["batch", *given, "--pipeline", str(tmp_path / "p.toml"), "--out", str(out), "--force"]) == 2
    )
    assert mine.read_text() == MINE
    assert (elsewhere / "run.json").read_bytes() == before


@pytest.mark.parametrize("name", [".", "..", "a/b", "/a", "../..", "a/..", "./a"])
def test_a_row_of_a_study_names_a_folder_in_out(name: str, tmp_path: Path) -> None:
    write_case(tmp_path / "one", ball_case())
    (tmp_path / "study.csv").write_text(f"case,name\none,{name}\n")
    with pytest.raises(InputError, match=r"study\.csv: line 2.*: must be the name of a folder, not a path"):
        read_study([tmp_path / "study.csv"])


@pytest.mark.parametrize("name", ["", ".", "..", "a/b", "a\0b"])
def test_neither_does_a_planned_case_lead_up(name: str, tmp_path: Path) -> None:
    write_case(tmp_path / "one", ball_case())
    (one,) = planned([tmp_path / "one"], Pipeline([Nudge()], folds=0))
    with pytest.raises(InputError, match="must be the name of a folder"):
        run_cohort([replace(one, name=name)], tmp_path / "deep/runs")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one"]
    with pytest.raises(InputError):
        check_name(name, "here")


def test_the_log_of_a_failure_replaces_a_link(tmp_path: Path, mine: Path) -> None:
    (tmp_path / "run.failed.log").symlink_to(mine)
    with pytest.raises(InputError, match="no"), log_of_failure(tmp_path / "run"):
        raise InputError("no")
    assert mine.read_text() == MINE
    assert "InputError: no" in (tmp_path / "run.failed.log").read_text()


def test_a_manifest_that_is_a_file_of_another_folder_too_stays_as_it_is_there(tmp_path: Path) -> None:
    run = finished(tmp_path / "run")
    os.link(run / "manifest.txt", tmp_path / "backup.txt")
    before = (tmp_path / "backup.txt").read_bytes()
    write_report([run])
    assert (tmp_path / "backup.txt").read_bytes() == before
    assert not manifest.foreign(run, "run")


def test_a_session_follows_no_link_in_its_record_folder(tmp_path: Path, mine: Path) -> None:
    record = tmp_path / "record"
    record.mkdir()
    (record / "journal.jsonl").symlink_to(mine)
    with pytest.raises(InputError, match="is a link to"):
        begin_journal(record, {"case": "c", "prior": "p"}, [])
    with pytest.raises(InputError, match="is a link to"):
        resume_journal(record)
    assert mine.read_text() == MINE
    outside = tmp_path / "outside"
    write_case(outside, ball_case())
    before = sorted((path.name, path.read_bytes()) for path in outside.iterdir())
    (record / "case").symlink_to(outside)
    with pytest.raises(InputError, match="is a link to"):
        finish(record, Session(ball_case()), None)
    assert sorted((path.name, path.read_bytes()) for path in outside.iterdir()) == before


@given(st.lists(st.text(st.sampled_from("aA1._/ \0ß"), max_size=5), unique=True))
def test_names_made_unique_are_plain_and_never_one_file(wanted: list[str]) -> None:
    found = list(unique_names(dict(zip(wanted, wanted, strict=True))).values())
    assert len({name.casefold() for name in found}) == len(wanted)
    for name in found:
        check_name(name, "here")
        assert "." not in name


def test_a_name_that_is_alone_stays_as_it_is() -> None:
    wanted = {"one": "CT 1", "two": "LA.1", "three": "LA_1", "four": "la_1", "five": "LA_1_2"}
    found = unique_names(wanted)
    assert found == {"one": "CT 1", "two": "LA_1", "three": "LA_1_2", "four": "la_1_3", "five": "LA_1_2_2"}
    assert plain_name("LA.1") == "LA_1"


def test_shells_of_one_name_are_imported_as_two_files_and_it_is_said(tmp_path: Path) -> None:
    study = carto_folder(tmp_path / "study")
    source = next(study.rglob("CT.mesh"))
    for name in ("LA.1.mesh", "LA_1.mesh"):
        (source.parent / name).write_bytes(source.read_bytes())
    xml = next(study.rglob("*.xml"))
    row = "<Mesh FileName='{}'/>"
    text = xml.read_text(encoding="latin-1")
    assert "<Meshes>" in text
    rows = "".join(row.format(name) for name in ("LA.1.mesh", "LA_1.mesh"))
    xml.write_text(text.replace("<Meshes>", f"<Meshes>{rows}"), encoding="latin-1")
    found = import_study(study, "1-Map", tmp_path / "case")
    names = {path.name for path in (tmp_path / "case").glob("LA*_shell.ply")}
    assert names == {"LA_1_shell.ply", "LA_1_2_shell.ply"}
    assert [note for note in found.notes if note.startswith("LA_1.mesh: its files begin with LA_1_2")]


def dead() -> int:
    """The number of a process that is no more."""
    done = subprocess.Popen([sys.executable, "-c", ""])
    done.wait()
    return done.pid


@pytest.mark.parametrize(
    ("change", "gone"),
    [
        (lambda name: name.replace(f"-{os.getpid():x}@", f"-{dead():x}@"), True),
        (lambda name: name, False),
        (lambda name: name.replace(f"-{os.getpid():x}@", "-1@"), False),  # somebody else's, and at work
        (lambda name: name.replace("@", "@0").replace("@00", "@0"), False),
        (lambda name: name.split("@")[0].replace(f"-{os.getpid():x}", f"-{dead():x}") + "-token", False),
        (lambda name: f".{dead():x}.partial", False),
    ],
    ids=["dead", "own", "alive", "machine", "unsaid", "other"],
)
@pytest.mark.parametrize("folder", [True, False])
def test_what_dead_processes_left_is_removed_and_nothing_else(
    change: Callable[[str], str], gone: bool, folder: bool, tmp_path: Path
) -> None:
    left = tmp_path / change(temporary_name(tmp_path / "another run").name)
    if folder:
        (left / "half").mkdir(parents=True)
    else:
        left.write_text("half")
    finished(tmp_path / "run")
    assert left.exists() != gone


@pytest.mark.parametrize("length", [1, 100, 235, 243, 244, 250, 255])
@pytest.mark.parametrize("letter", ["a", "é"])
def test_a_run_may_have_any_name_that_a_system_knows(length: int, letter: str, tmp_path: Path) -> None:
    name = letter * (length // len(letter.encode()))
    if not name:
        return
    write_case(tmp_path / "case", ball_case())
    (tmp_path / "p.toml").write_text('folds = 0\n[[stage]]\nuse = "landmarks"\n')
    command = [
        "run",
        str(tmp_path / "p.toml"),
        "--case",
        str(tmp_path / "case"),
        "--out",
        str(tmp_path / name),
    ]
    assert answer(command) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["case", "p.toml", name])
    ended = beside(tmp_path / name, ".failed.log")
    with pytest.raises(InputError, match="no"), log_of_failure(tmp_path / name):
        raise InputError("no")
    assert ended.is_file()
    assert len(os.fsencode(ended.name)) <= 255


def test_a_file_is_written_through_no_link_to_a_link(tmp_path: Path, mine: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (tmp_path / "between").symlink_to(mine)
    (folder / "a").symlink_to(tmp_path / "between")
    (folder / "nowhere").symlink_to(tmp_path / "new")
    for name in ("a", "nowhere", "../above"):
        with pytest.raises(InputError):
            write_file(folder / name, "text", within=folder)
    assert mine.read_text() == MINE
    assert not (tmp_path / "new").exists()
    assert not (tmp_path / "above").exists()
