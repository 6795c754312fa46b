"""A failed run leaves what it takes to find the cause, and nothing of the patient."""

from __future__ import annotations

import json
import platform
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from tiny import Nudge, ball_case

from o3dls.case import Case
from o3dls.errors import InputError, SolverError
from o3dls.estimate import Estimate
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.pipeline.batch import run_into
from o3dls.pipeline.pipeline import Pipeline

PATIENT = "Erika Mustermann 1961"


class Fails(Nudge):
    """Fails with a sentence that names the patient."""

    name: ClassVar[str] = "fails"
    how: ClassVar[type[BaseException]] = IndexError

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        try:
            raise KeyError(PATIENT)
        except KeyError as error:
            raise self.how(f"{case.name}: {PATIENT}") from error


def patient_case(folder: Path) -> Case:
    case = ball_case()
    names = np.array([PATIENT if kind == "ablation" else "" for kind in case.points.type])
    points = replace(case.points, columns={"name": np.where(names, names, case.points.columns["name"])})
    write_case(folder / PATIENT, replace(case, points=points, name=PATIENT, notes=PATIENT))
    (folder / PATIENT / "prior.ply").rename(folder / PATIENT / f"{PATIENT}.ply")
    with (folder / PATIENT / "case.toml").open("a") as file:
        file.write(f'prior = "{PATIENT}.ply"\n')
    return read_case(folder / PATIENT)


def test_what_is_wrong_with_the_input_is_no_crash(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Fails, "how", InputError)
    with pytest.raises(InputError):
        run_into(Pipeline([Fails()], folds=0), ball_case(), tmp_path / "run")
    assert not (tmp_path / "run.crash.json").exists()


@pytest.mark.parametrize("how", [IndexError, SolverError, MemoryError])
def test_a_failed_run_leaves_a_crash_file_without_the_patient(
    how: type[BaseException],
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Fails, "how", how)
    case = patient_case(tmp_path)
    with caplog.at_level("INFO", "o3dls"), pytest.raises(how):
        run_into(Pipeline([Fails()], folds=0), case, tmp_path / "run")
    path = tmp_path / "run.crash.json"
    assert any(str(path) in line for line in caplog.messages)
    text = path.read_text()
    assert all(word not in text for word in PATIENT.split())
    assert str(tmp_path) not in text
    assert platform.node() not in text or len(platform.node()) < 4
    found = json.loads(text)
    assert [one["error"] for one in found["errors"]] == [how.__name__, "KeyError"]
    assert any("o3dls/pipeline/pipeline.py:" in line for line in found["errors"][0]["lines"])
    assert sorted(digest for _, digest in found["inputs"]) == sorted(case.files.values())
    assert found["versions"]["o3dls"]
    own = {"use": "fails", "share": 1.0, "limit": 50.0, "mode": "..."}
    assert found["pipeline"]["stage"][0].items() >= own.items()
    assert found["threads"]["processors"]


def test_a_run_that_ends_well_removes_the_crash_file_of_an_earlier_one(tmp_path: Path) -> None:
    case = ball_case()
    with pytest.raises(IndexError):
        run_into(Pipeline([Fails()], folds=0), case, tmp_path / "run")
    run_into(Pipeline([Nudge()], folds=0), case, tmp_path / "run")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_an_interruption_leaves_no_crash_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Fails, "how", KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt):
        run_into(Pipeline([Fails()], folds=0), ball_case(), tmp_path / "run")
    assert [path.name for path in tmp_path.iterdir()] == ["run.failed.log"]
