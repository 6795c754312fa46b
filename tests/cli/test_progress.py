"""What the commands say of their progress, and in which form the result comes."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pytest
from tiny import ball_case

from o3dls.case import Case
from o3dls.cli.doctor import Check
from o3dls.cli.main import answer
from o3dls.cli.progress import Bar, RunBar
from o3dls.cli.progress import bar as progress_bar
from o3dls.cli.words import Lines
from o3dls.estimate import Estimate
from o3dls.io.case_writer import write_case
from o3dls.pipeline.file import read_pipeline
from o3dls.pipeline.outcome import Outcome
from o3dls.pipeline.pipeline import Pipeline
from o3dls.plugins.stage import Stage
from o3dls.run_warning import RunWarning

ICP = 'folds = 2\n[[stage]]\nuse = "icp"\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_case(tmp_path / "ball", ball_case())
    (tmp_path / "pipe.toml").write_text(ICP)
    return tmp_path


def o3dls(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "o3dls", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_a_quiet_run_prints_json_alone(folder: Path) -> None:
    done = o3dls(folder, "run", "pipe.toml", "--case", "ball", "--out", "run", "--quiet", "--json")
    found = json.loads(done.stdout)
    assert (done.returncode, done.stderr) == (0, "")
    assert (found["folder"], found["final"], found["report"]) == ("run", "icp", None)
    assert found["verdict"] in ("OK", "CHECK")
    assert found["scores"] == {
        name: one["scores"]
        for name, one in json.loads((folder / "run/run.json").read_text())["estimates"].items()
    }


def test_a_verbose_run_names_parameters_and_the_fits_of_the_cross_validation(folder: Path) -> None:
    done = o3dls(folder, "run", "pipe.toml", "--case", "ball", "--out", "run", "-v")
    assert done.returncode == 0
    assert "'tolerance': " in done.stderr
    assert done.stderr.count("icp: converged") == 3
    assert done.stdout.splitlines()[-1] == "run"
    assert "\x1b" not in done.stdout + done.stderr
    assert " s  icp" not in done.stderr  # no clock where nobody waits


def test_a_batch_says_how_far_it_is_and_gives_a_line_of_json_for_each_case(folder: Path) -> None:
    done = o3dls(folder, "batch", "ball", "none", "--pipeline", "pipe.toml", "--out", "runs", "--json")
    *cases, found = map(json.loads, done.stdout.splitlines())
    assert [(one["done"], one["case"], one["error"] is None) for one in cases] == [
        (1, "ball", True),
        (2, "none", False),
    ]
    assert (found["cases"], found["failed"], found["skipped"]) == (2, 1, 0)
    assert sum(found["grades"].values()) == 1  # the case that failed has no run to grade
    assert {one["run"] for one in found["look_at"]} <= {"ball"}
    assert (found["table"], found["page"]) == (str(Path("runs/cohort.csv")), str(Path("runs/cohort.html")))
    assert "2 of 2: " in done.stderr
    assert "ball: done" in done.stderr


def test_checks_of_a_pipeline_and_of_the_machine_are_given_as_json(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "pipe.toml").write_text('[[stage]]\nuse = "icpp\\u007f"\n')
    assert answer(["check", str(folder / "pipe.toml"), "--json"]) == 2
    said = capsys.readouterr()
    (mistake,) = json.loads(said.out)["mistakes"]
    assert "no stage 'icpp\x7f'" in mistake
    assert "\x7f" not in said.out
    monkeypatch.setattr("o3dls.cli.doctor._check_renderer", lambda: Check("without", "f", "a", needed=False))
    assert answer(["doctor", "--json"]) in (0, 1)
    found = json.loads(capsys.readouterr().out)
    assert {"name": "without", "found": "f", "remedy": "a", "needed": False} in found


def test_lines_on_a_terminal_begin_with_the_seconds_since_the_start() -> None:
    record = logging.LogRecord("o3dls", logging.INFO, "", 0, "icp: converged", None, None)
    record.relativeCreated = 12_340.0
    assert Lines(terminal=True).format(record) == "  12.3 s  icp: converged"
    assert Lines(terminal=False).format(record) == "icp: converged"


@pytest.mark.parametrize(("code", "kind"), [("order-lost", "note"), ("map-shift", "warning")])
def test_what_only_informs_is_no_warning_on_the_terminal(
    code: str, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    """As in the report: a run that ends OK is not said to have warnings."""

    class Telling(Stage):
        name: ClassVar[str] = "telling"

        def __call__(self, case: Case, start: Estimate) -> Estimate:
            return replace(start, warnings=(RunWarning(code, "it is so"),))

    Pipeline([Telling()], folds=0).run(ball_case(points=40))
    said = [Lines(terminal=False).format(one) for one in caplog.records if "it is so" in one.getMessage()]
    assert said == [f"{kind}: it is so"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
@pytest.mark.parametrize(
    ("terminal", "env", "red"), [(True, {}, True), (True, {"NO_COLOR": "1"}, False), (False, {}, False)]
)
def test_errors_are_red_on_a_terminal_alone(
    tmp_path: Path, terminal: bool, env: dict[str, str], red: bool
) -> None:
    import pty

    ours, theirs = pty.openpty() if terminal else os.pipe()
    subprocess.run(
        [sys.executable, "-m", "o3dls", "stages", "icpp"],
        cwd=tmp_path,
        stderr=theirs,
        check=False,
        env={key: value for key, value in os.environ.items() if key != "NO_COLOR"} | env,
    )
    os.close(theirs)
    said = os.read(ours, 10_000).decode()
    os.close(ours)
    assert said.startswith("\x1b[31mo3dls: no stage" if red else "o3dls: no stage")
    assert ("\x1b" in said) == red


def test_the_bar_counts_what_is_done_and_estimates_the_rest() -> None:
    bar = Bar(8)
    assert bar.text(3.0) == f"[{'.' * 24}] 0 done, 0 failed, 8 left"
    bar.count(Outcome("a", [], [], skipped=True))
    assert "about" not in bar.text(3.0)  # what was skipped took no time, and tells nothing of the rest
    bar.count(Outcome("b", [], []))
    bar.count(Outcome("c", [], [], "no prior"))
    assert bar.text(40.0) == f"[{'#' * 9}{'.' * 15}] 2 done, 1 failed, 5 left, about 2 min"
    assert Bar(0).text(1.0).endswith("0 left")


def test_the_bar_is_for_terminals_whose_user_wants_to_hear_of_progress(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = logging.getLogger("bar")
    handler = logging.StreamHandler(sys.stderr)
    monkeypatch.setattr(logging.getLogger(), "handlers", [handler])
    with progress_bar(2) as shown:
        assert shown is None
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    handler.setLevel(logging.WARNING)
    with progress_bar(2) as shown:
        assert shown is None
    assert capsys.readouterr().err == ""
    handler.setLevel(logging.INFO)
    with progress_bar(2):
        log.warning("a line")
    assert "2 left\r\x1b[Ka line\n" in capsys.readouterr().err


def test_the_bar_of_a_run_counts_the_steps_that_its_log_tells(folder: Path) -> None:
    """Two folds and one stage, as a real run tells them."""
    plan = read_pipeline(folder / "pipe.toml")
    shown = RunBar(len(plan.stages) + plan.folds + len(plan.writes))
    log = logging.getLogger("o3dls")
    level = log.level
    log.setLevel(logging.INFO)
    log.addHandler(shown)
    try:
        plan.run(ball_case())
    finally:
        log.removeHandler(shown)
        log.setLevel(level)
    assert shown.text(70.0) == "[########################] 3 of 3 steps, 70 s"
    assert RunBar(4).text(0.0) == "[........................] 0 of 4 steps, 0 s"


def test_the_case_is_looked_at_before_anything_else_is_asked_for(folder: Path) -> None:
    done = o3dls(folder, "run", "--case", "missing")
    assert done.returncode == 2
    assert "missing" in done.stderr
    assert "--out" not in done.stderr


def test_a_run_without_a_folder_goes_into_one_named_as_its_case(folder: Path) -> None:
    done = o3dls(folder, "run", "pipe.toml", "--case", "ball", "-q")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "runs/ball"
    again = o3dls(folder, "run", "pipe.toml", "--case", "ball", "-q")
    assert again.returncode == 2
    assert "runs/ball: exists already" in again.stderr
