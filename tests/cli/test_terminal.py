"""What reaches the terminal: text out of files is shown and not obeyed, whatever its encoding."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from tiny import Nudge, ball_case

from o3dls.cli.commands import TASKS, cli
from o3dls.cli.main import answer
from o3dls.cli.summary import Summary
from o3dls.errors import SolverError
from o3dls.io.case_writer import write_case
from o3dls.pipeline.pipeline import Pipeline
from o3dls.report.grading.check import Check
from o3dls.runs.log import log_of_failure
from tests.io.test_io_study import carto_folder

TITLE = "\x1b]0;owned\x07\x1b[31mred\x9b2J\u202eback"
SHOWN = r"\x1b]0;owned\x07\x1b[31mred\x9b2J\u202eback"
OBEYED = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e]")
ICP = 'folds = 0\n[[stage]]\nuse = "icp"\n'


def run(
    *arguments: str | Path, cwd: Path, encoding: str = "utf-8", code: int = 0
) -> subprocess.CompletedProcess[bytes]:
    done = subprocess.run(
        [sys.executable, "-m", "o3dls", *map(str, arguments)],
        capture_output=True,
        cwd=cwd,
        env=os.environ | {"PYTHONIOENCODING": encoding},
        timeout=300,
    )
    assert done.returncode == code, done.stderr
    return done


@pytest.fixture
def nasty(tmp_path: Path) -> Path:
    """A case whose name and a column of whose points would move the cursor."""
    case = ball_case()
    columns = {**case.points.columns, TITLE: case.points.columns["name"]}
    write_case(
        tmp_path / "ball",
        replace(case, name=f"{TITLE}\nsecond", points=replace(case.points, columns=columns)),
    )
    (tmp_path / "pipe.toml").write_text(ICP)
    return tmp_path


def test_a_run_shows_names_and_does_not_obey_them(nasty: Path) -> None:
    done = run("run", "pipe.toml", "--case", "ball", "--out", "run", cwd=nasty)
    assert not OBEYED.search(done.stdout.decode() + done.stderr.decode())
    assert done.stdout.decode().startswith(SHOWN + r"\nsecond: mean distances")
    done = run("compare", "run", cwd=nasty)
    assert SHOWN + r"\nsecond start" in done.stdout.decode()
    assert not OBEYED.search(done.stdout.decode())


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_mistake_shows_what_it_names(
    command: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "pipe.toml").write_text('[[stage]]\nuse = "a\\u001b[31m\\u009b2J"\n')
    assert answer([command, str(tmp_path / "pipe.toml")]) == 2
    err = capfd.readouterr().err
    assert not OBEYED.search(err)
    assert r"no stage 'a\x1b[31m\x9b2J'" in err


def test_a_usage_error_and_a_long_one(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert answer(["check", f"{TITLE}.toml"]) == 2
    assert f"{SHOWN}.toml: no such file" in capfd.readouterr().err
    assert answer([TITLE]) == 2
    assert not OBEYED.search(capfd.readouterr().err)
    (tmp_path / "long.toml").write_text(f'[[stage]]\nuse = "{"a" * 50_000}"\n')
    assert answer(["check", str(tmp_path / "long.toml")]) == 2
    assert len(capfd.readouterr().err) < 5000


def test_what_an_import_took_and_left(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    study = carto_folder(tmp_path / "study")
    with zipfile.ZipFile(tmp_path / "study.zip", "w") as file:
        for path in study.rglob("*"):
            file.write(path, path.relative_to(study))
        file.writestr(f"{TITLE}\n.mesh", "no mesh")
    answer(["import", str(tmp_path / "study.zip"), str(tmp_path / "case"), "--map", "1-Map"])
    shown = capfd.readouterr()
    assert not OBEYED.search(shown.out + shown.err)


def test_the_log_of_a_failed_run(tmp_path: Path) -> None:
    with pytest.raises(SolverError), log_of_failure(tmp_path / "run"):
        raise SolverError(TITLE)
    assert (tmp_path / "run.failed.log").read_text() == f"SolverError: {SHOWN}\n"


def test_an_internal_error_shows_its_text_too(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError(TITLE)

    monkeypatch.setattr("o3dls.pipeline.file.all_mistakes", broken)
    assert answer(["check", str(tmp_path)]) == 3
    err = capfd.readouterr().err
    assert not OBEYED.search(err)
    assert err.startswith("Traceback")
    assert err.endswith(f"o3dls: internal error, please report it: ZeroDivisionError: {SHOWN}\n")


@pytest.mark.parametrize("encoding", ["cp1252", "cp1252:strict"])
def test_a_terminal_that_does_not_know_every_letter(encoding: str, tmp_path: Path) -> None:
    name = "左心房 → é \u202f"
    folder = (
        Pipeline([Nudge()], folds=0)
        .run(replace(ball_case(), name=name))
        .write(tmp_path / os.fsdecode(b"r\xfcn"))
    )
    done = run("compare", folder, "--out", tmp_path / "左.html", cwd=tmp_path, encoding=encoding)
    assert rb"\u5de6\u5fc3\u623f \u2192" in done.stdout
    assert b"r\xfcn" in done.stdout  # bytes that are no text go out as they came in
    assert rb"\u5de6.html" in done.stdout


def test_a_process_of_little_memory_is_refused_before_it_hangs(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (400 << 20, 400 << 20))

    done = subprocess.run(
        [sys.executable, "-m", "o3dls", "demo", "--out", tmp_path / "demo"],
        capture_output=True,
        text=True,
        preexec_fn=limit,
        timeout=30,
    )
    assert done.returncode == 2
    assert done.stderr == (
        "o3dls: the memory of this process is limited to 400 MiB: at least 1536 are needed; raise the limit "
        "(ulimit -v)\n"
    )


def test_memory_that_is_not_there_is_no_mistake_of_ours(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def hungry(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("o3dls.pipeline.file.all_mistakes", hungry)
    assert answer(["check", str(tmp_path)]) == 2
    assert capfd.readouterr().err.startswith("o3dls: there is too little memory")


def test_the_help_groups_all_commands_and_cuts_no_sentence() -> None:
    grouped = [name for names in TASKS.values() for name in names]
    assert sorted(grouped) == sorted(cli.commands)
    said = CliRunner().invoke(cli, ["--help"], terminal_width=80).output
    assert max(map(len, said.splitlines())) <= 80
    words = " ".join(said.split())
    for task, names in TASKS.items():
        assert f"{task}:" in said
        for name in names:
            sentence = cli.commands[name].get_short_help_str(limit=4000)
            assert f"{name} {' '.join(sentence.split())}" in words


def test_a_run_ends_in_lines_that_are_wrapped_with_grades_in_colour(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.delenv("NO_COLOR", raising=False)
    reason = Check(
        "Far points", "bad", "half of the held-out points lie more than 20 mm from the surface " * 2
    )
    found = Summary(Path("a/run"), "icp", "bad", (reason, Check("Size", "amber", "x 1.20")), (), None)
    found.say()
    plain = capsys.readouterr().out
    assert plain == f"{found}\n"  # whole lines where no terminal is
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    found.say()
    seen = capsys.readouterr().out
    bare = re.sub("\x1b\\[[0-9]*m", "", seen)
    assert max(map(len, bare.splitlines())) <= 60
    assert bare.split() == plain.split()
    assert "\x1b[31mFAIL  icp" in seen
    assert "\x1b[33m  CHECK  Size" in seen
