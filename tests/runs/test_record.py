"""A run.json that was damaged or edited: every command that reads it says where, and what is expected."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tiny import Nudge, ball_case

from o3dls.cli.main import answer
from o3dls.errors import InputError
from o3dls.pipeline.pipeline import Pipeline
from o3dls.runs.folder import read_record, read_run
from o3dls.runs.run import record

ONE = "estimates.nudge"
EDITS = [
    ("estimates", None, "estimates = null: must be a table"),
    (f"{ONE}.T_map_prior", "text", f'{ONE}.T_map_prior = "text": must be a list'),
    (f"{ONE}.T_map_prior", [[1.0, 2.0], [3.0]], f"{ONE}.T_map_prior: must be 4 rows of 4 numbers"),
    (f"{ONE}.scores", 5, f"{ONE}.scores = 5: must be a table"),
    (f"{ONE}.scores.fitted", 5, f"{ONE}.scores.fitted = 5: must be a table"),
    (f"{ONE}.scores.fitted.mean_mm", None, f"{ONE}.scores.fitted: has no number 'mean_mm'"),
    (f"{ONE}.scores.truth.dice", [1], f"{ONE}.scores.truth.dice = [1]: must be a number"),
    (f"{ONE}.seconds", "x", f'{ONE}.seconds = "x": must be a number'),
    (f"{ONE}.seconds", 10**30, "has a whole number beyond 64 bits"),
    (f"{ONE}.seconds", float("nan"), "is not JSON: NaN is not a number there"),
    (f"{ONE}.iterations", True, f"{ONE}.iterations = true: must be a whole number"),
    (f"{ONE}.warnings", 3, f"{ONE}.warnings = 3: must be a list"),
    (f"{ONE}.validity.watertight", 3, f"{ONE}.validity.watertight = 3: must be true or false"),
    (f"{ONE}.sigma_mm", "1 mm", f'{ONE}.sigma_mm = "1 mm": must be a number'),
    (f"{ONE}.facts", {"observability": [3]}, f"{ONE}.facts.observability[0] = 3: must be a table"),
    ("pipeline", 3, "pipeline = 3: must be a table"),
    ("pipeline.stage", [{}], "has no 'pipeline.stage[0].use', so it is not a finished run"),
    ("case.units", "cm", "case.units = \"cm\": must be 'mm' or 'px'"),
    ("case", {}, "has no 'case.name', so it is not a finished run"),
    ("case.dimension", 2, "estimates.start.T_map_prior: must be 3 rows of 3 numbers"),
    ("case.units", "px", "has no 'estimates.start.sigma_px', so it is not a finished run"),
    ("valid", "yes", 'valid = "yes": must be true or false'),
    ("versions", {"o3dls": 1}, "versions.o3dls = 1: must be a text"),
    ("final", "other", "final: 'other' is no estimate of the run"),
    ("estimates", {}, "estimates: has no 'start'"),
]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = Pipeline([Nudge()], folds=0).run(ball_case())
    return run.write(tmp_path_factory.mktemp("record") / "run")


@pytest.fixture
def edited(whole: Path, tmp_path: Path) -> Callable[[str, Any], Path]:
    """A copy of the run whose run.json has another value at one place."""

    def edit(place: str, value: Any) -> Path:
        record = json.loads((whole / "run.json").read_text())
        *tables, key = place.split(".")
        inner = record
        for name in tables:
            inner = inner[name]
        inner[key] = value
        shutil.copytree(whole, tmp_path / "run")
        (tmp_path / "run/run.json").write_text(json.dumps(record))
        return tmp_path / "run"

    return edit


@pytest.mark.parametrize(("place", "value", "sentence"), EDITS)
def test_an_edit_is_refused_with_its_place(
    place: str, value: Any, sentence: str, edited: Callable[[str, Any], Path]
) -> None:
    with pytest.raises(InputError) as caught:
        read_record(edited(place, value))
    assert f"run.json: {sentence}" in str(caught.value)


def test_what_is_read_is_written_again_byte_for_byte(edited: Callable[[str, Any], Path]) -> None:
    """A record keeps the order of its tables, and what another version said more."""
    run = edited("estimates.nudge.facts", {"later": [1, 0.5, None], "changes": [], "n": 2})
    found = json.loads((run / "run.json").read_text())
    text = json.dumps(found | {"later": {"a": 1}}, indent=1) + "\n"
    (run / "run.json").write_text(text)
    assert read_record(run).text() == record(read_run(run)).text() == text


@pytest.mark.parametrize("name", ["../nudge", "a/b", "nudge\x1b[31m", ""])
def test_the_name_of_an_estimate_leads_to_no_other_folder(whole: Path, name: str, tmp_path: Path) -> None:
    record = json.loads((whole / "run.json").read_text())
    record["estimates"][name] = record["estimates"]["nudge"]
    (tmp_path / "run.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match="the name of an estimate must be letters"):
        read_record(tmp_path)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[" * 100_000, "in each other more than 20 deep"),
        ('{"a":' * 300 + "1" + "}" * 300, "in each other more than 20 deep"),
        ("9" * 5000, "has a whole number beyond 64 bits"),
        ('{"schema": "o3dls/run/2", "seconds": 1e', "is not JSON"),
    ],
)
def test_deep_and_long_records_are_refused_at_once(text: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(text)
    begun = time.process_time()
    with pytest.raises(InputError, match=sentence):
        read_record(tmp_path)
    assert time.process_time() - begun < 1.0  # the task: refused within a second


@pytest.mark.parametrize("command", [["report"], ["compare"], ["export"], ["report", "--pdf"]])
def test_every_command_that_reads_a_run_says_so(
    command: list[str],
    edited: Callable[[str, Any], Path],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    run = edited(f"{ONE}.scores", None)
    assert answer([command[0], str(run), *command[1:]]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err == f"o3dls: {run / 'run.json'}: {ONE}.scores = null: must be a table\n"
    assert not list(tmp_path.glob("*.html")) + list(run.glob("*.html"))


def test_points_without_their_distances_are_not_those_of_the_run(whole: Path, tmp_path: Path) -> None:
    run = Path(shutil.copytree(whole, tmp_path / "run"))
    text = (run / "points.csv").read_text()
    (run / "points.csv").write_text(text.replace("distance_nudge_mm", "distance_other_mm"))
    with pytest.raises(InputError, match=r"points\.csv: has no column 'distance_nudge_mm' of numbers"):
        read_run(run)
