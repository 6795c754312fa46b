"""`o3dls init`: the case and the pipeline file that it makes run, pass the check, and explain themselves."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from tiny import ball_case, disc_case

from o3dls.cli.commands import cli, run_command
from o3dls.errors import InputError
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.io.markups import Markups, write_markups
from o3dls.io.surfaces import write_surface
from o3dls.pipeline.file import all_mistakes, read_pipeline
from o3dls.pipeline.new_case import Inputs, make_case

DEFAULT = re.compile(r"^# (?=\w+ = )", re.MULTILINE)  # before a default that may be uncommented


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files") / "ball"
    write_case(folder, ball_case())
    return folder


@pytest.fixture(scope="module")
def made(files: Path) -> Path:
    """A new case of these files, with landmarks."""
    folder = files.parent / "new"
    landmarks = ("--landmarks", files / "prior_landmarks.csv")
    assert init(folder, *given(files), *landmarks).exit_code == 0
    return folder


def given(files: Path) -> tuple[str | Path, ...]:
    return ("--prior", files / "prior.ply", "--points", files / "points.csv")


def init(folder: Path, *options: str | Path) -> Result:
    return CliRunner().invoke(cli, ["init", str(folder), *map(str, options)])


def test_what_it_makes_passes_the_check_and_runs(made: Path, tmp_path: Path) -> None:
    assert all_mistakes(made / "pipeline.toml") == []
    # as it stands but for the time that it takes
    fast = ["--set", "level_set.spacing=4", "--set", "folds=0", "--out", str(tmp_path / "run")]
    assert run_command(["run", str(made / "pipeline.toml"), "-q", *fast]) == 0
    found = json.loads((tmp_path / "run/run.json").read_text())
    assert [stage["use"] for stage in found["pipeline"]["stage"]] == [
        *("landmarks", "icp", "deform", "topology", "level_set"),
    ]
    assert (tmp_path / "run/report.html").is_file()


def test_the_case_refers_to_the_files_that_were_named(made: Path, files: Path) -> None:
    case = read_case(made)
    assert case.name == "new"
    assert (case.prior.vertices == read_case(files).prior.vertices).all()
    assert len(case.points) == len(ball_case().points)
    assert list(case.prior_landmarks) == ["a", "b", "c"]
    settings = tomllib.loads((made / "case.toml").read_text())
    assert settings["prior"] == "../ball/prior.ply"  # the whole tree may be moved


@pytest.mark.parametrize("name", ["pipeline.toml", "case.toml"])
def test_every_line_that_is_commented_out_is_valid(made: Path, name: str) -> None:
    """One at a time, and all at once: a default changes nothing."""
    text = (made / name).read_text()
    places = [match.start() for match in DEFAULT.finditer(text)]
    assert len(places) >= {"pipeline.toml": 15, "case.toml": 4}[name]
    before = read_pipeline(made / "pipeline.toml").record()
    try:
        for place in places:
            (made / name).write_text(text[:place] + text[place + 2 :])
            if name == "pipeline.toml":  # the case is as it was
                assert read_pipeline(made / name).record() == before
            else:
                read_case(made)
        (made / name).write_text(DEFAULT.sub("", text))
        assert all_mistakes(made / "pipeline.toml") == []
    finally:
        (made / name).write_text(text)


@pytest.mark.parametrize(
    "key", ["folds", "spacing", "outliers", "ablation", "reject", "pdf", "units", "frame"]
)
def test_what_people_change_most_is_there_with_its_meaning(made: Path, key: str) -> None:
    text = (made / "pipeline.toml").read_text() + (made / "case.toml").read_text()
    assert re.search(rf"^# {key} = \S+ +# \w{{2,}}", text, re.MULTILINE)
    assert max(map(len, text.splitlines())) <= 120


def test_units_frame_and_run_folder_as_given(files: Path, tmp_path: Path) -> None:
    done = init(
        tmp_path / "new", *given(files), "--units", "mm", "--frame", "LPS", "--out", tmp_path / "there"
    )
    assert done.exit_code == 0, done.output
    assert read_case(tmp_path / "new").frame == "LPS"
    assert re.search('^units = "mm"', (tmp_path / "new/case.toml").read_text(), re.MULTILINE)
    out = read_pipeline(tmp_path / "new/pipeline.toml").out
    assert out is not None
    assert out.resolve() == (tmp_path / "there").resolve()


def test_landmarks_of_slicer_are_read_in_the_frame_of_the_prior(files: Path, tmp_path: Path) -> None:
    marks = ball_case().prior_landmarks
    turned = np.array(list(marks.values())) * [-1.0, -1.0, 1.0]
    write_markups(tmp_path / "places.mrk.json", Markups(tuple(marks), turned, "RAS"))
    write_surface(tmp_path / "prior.ply", ball_case().prior, space="LPS", units="mm")
    flags = ("--prior", tmp_path / "prior.ply", "--points", files / "points.csv")
    done = init(tmp_path / "new", *flags, "--landmarks", tmp_path / "places.mrk.json")
    assert done.exit_code == 0, done.output
    found = read_case(tmp_path / "new").prior_landmarks
    assert {name: at.tolist() for name, at in found.items()} == {n: at.tolist() for n, at in marks.items()}


def test_outlines_make_a_case_in_2d(tmp_path: Path) -> None:
    write_case(tmp_path / "disc", disc_case())
    flags = (
        "--prior",
        tmp_path / "disc/prior.csv",
        "--points",
        tmp_path / "disc/points.csv",
        "--units",
        "px",
    )
    done = init(tmp_path / "new", *flags)
    assert done.exit_code == 0, done.output
    assert read_case(tmp_path / "new").dimension == 2
    assert all_mistakes(tmp_path / "new/pipeline.toml") == []
    write_markups(tmp_path / "places.mrk.json", Markups(("a",), np.zeros((1, 3)), "LPS"))
    done = init(tmp_path / "other", *flags, "--landmarks", tmp_path / "places.mrk.json")
    assert "Slicer's markups are places in 3D" in str(done.exception)


def test_without_a_terminal_it_names_the_flags_that_are_missing(files: Path, tmp_path: Path) -> None:
    done = init(tmp_path / "new", "--prior", files / "prior.ply")
    assert done.exit_code == 2
    assert "give --points FILE" in done.output
    assert "--prior FILE and --points FILE" in init(tmp_path / "new").output
    assert not (tmp_path / "new").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="there is no pseudo-terminal")
def test_on_a_terminal_it_asks_for_what_is_missing(files: Path, tmp_path: Path) -> None:
    import pty

    ours, theirs = pty.openpty()
    answers = [files / "prior.ply", files / "points.csv", "", "template"]
    os.write(ours, "".join(f"{answer}\n" for answer in answers).encode())
    command = [sys.executable, "-m", "o3dls", "init", "new"]
    done = subprocess.run(command, stdin=theirs, capture_output=True, text=True, cwd=tmp_path, timeout=120)
    os.close(ours)
    os.close(theirs)
    assert done.returncode == 0, done.stderr
    asked = ("Prior: file", "Points: ", "Landmarks: ", "Prior: the patient's own")
    assert [done.stderr.count(word) for word in asked] == [1, 1, 1, 1]
    assert done.stdout == f"{Path('new/pipeline.toml')}\n"
    case = read_case(tmp_path / "new")
    assert not case.prior_landmarks
    assert case.prior_of == "template"


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        (("--units", "ell"), "--units = 'ell': must be one of mm"),
        (("--frame", "LAS"), "--frame = 'LAS': must be one of LPS"),
        (("--points", "study"), "is a folder; name a file; if it is the export of a study, use o3dls import"),
        (("--landmarks", "none.csv"), "--landmarks none.csv: no such file"),
        (("--units", "m"), "points"),
        (("--out", "."), "is or holds the case"),
        (("--label", "1"), "label"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_what_cannot_run_is_refused_and_nothing_is_written(
    changed: tuple[str, str], sentence: str, files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study").mkdir()
    done = init(tmp_path / "new", *given(files), *changed)
    assert done.exit_code != 0
    assert sentence in str(done.exception or done.output)
    assert [path.name for path in tmp_path.iterdir()] == ["study"]


def test_a_case_is_replaced_only_when_told_and_never_with_what_is_not_ours(
    files: Path, tmp_path: Path
) -> None:
    new = tmp_path / "new"
    assert init(new, *given(files)).exit_code == 0
    assert "exists already" in str(init(new, *given(files)).exception)
    assert init(new, *given(files), "--force").exit_code == 0
    (new / "mine.txt").write_text("kept")
    assert "mine.txt" in str(init(new, *given(files), "--force").exception)
    assert (new / "mine.txt").read_text() == "kept"


def test_a_folder_of_dicom_is_told_what_it_is(tmp_path: Path) -> None:
    series = tmp_path / "series"
    series.mkdir()
    (series / "1.dcm").write_bytes(bytes(128) + b"DICM")
    (tmp_path / "points.csv").write_text("x,y,z\n")
    with pytest.raises(InputError, match=r"is a folder of DICOM files.*segment the left atrium first"):
        make_case(tmp_path / "case", Inputs(series, tmp_path / "points.csv"))
