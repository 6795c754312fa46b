"""A command that a sentence names is taken by the program and mends what the sentence is about."""

from __future__ import annotations

import re
import shlex
import webbrowser
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from said import said_by
from tiny import ball_case, disc_case

import o3dls
from o3dls.errors import InputError
from o3dls.io.case_writer import write_case
from o3dls.io.surfaces import write_surface
from o3dls.live.sources import watch
from o3dls.report import window
from tests.io.test_io_advice import ball_points, study

LANDMARKS = 'folds = 0\n[[stage]]\nuse = "landmarks"\n'


def advised(said: str, command: str, **known: object) -> list[str]:
    """The command that a text advises, with what it leaves to the reader."""
    found = re.search(rf"o3dls ({command}\b[^`\n;]*)", said)
    assert found, said
    words = shlex.split(re.sub(r" (writes it|makes it|\(.*)$", "", found[1]))
    return [str(known.get(word, word)) for word in words]


def followed(*arguments: object) -> str:
    code, said = said_by(*arguments)
    assert code == 0, said
    return said


def refused(*arguments: object) -> str:
    code, said = said_by(*arguments)
    assert code == 2, said
    return said


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    (tmp_path / "plan.toml").write_text(LANDMARKS)
    return tmp_path / "plan.toml"


def ball(folder: Path, **changes: object) -> Path:
    write_case(folder, ball_case(**changes))  # type: ignore[arg-type]
    return folder


def test_what_init_says_is_run(tmp_path: Path) -> None:
    case = ball(tmp_path / "ball")
    made = tmp_path / "made"
    files = ("--prior", case / "prior.ply", "--points", case / "points.csv")
    said = followed("init", made, *files, "--landmarks", case / "prior_landmarks.csv")
    quick = ("--set", "folds=0", "--set", "level_set.spacing=4")
    followed(*advised(said, "run"), *quick)
    text = (made / "pipeline.toml").read_text()
    followed(*advised(text, "run --case", DIR=case), made / "pipeline.toml", *quick, "--out", tmp_path / "b")
    followed("stages", re.findall(r'use = "(\w+)"', text)[0])
    followed(*advised(text, "check", FILE=made / "pipeline.toml"))


def test_a_run_without_a_report_gets_one(plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said = followed("run", plan, "--case", ball(tmp_path / "ball"), "--out", tmp_path / "run")
    followed(*advised(said, "report"))
    page = (tmp_path / "run/report.html").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path / "run")
    assert "save the pipeline below in the run folder as pipeline.toml and run there" in page
    below = re.search(r'<pre id="?toml-[^>]*><code>(.*?)</code>', page, re.DOTALL)
    assert below
    Path("pipeline.toml").write_text(unescape(below[1]))
    followed(*advised(re.sub("<[^>]*>", "\n", page), "run"))
    assert (tmp_path / "run/again/run.json").is_file()


def test_a_table_is_no_study(tmp_path: Path) -> None:
    case = ball(tmp_path / "the ball")
    said = refused("import", case / "points.csv", tmp_path / "case")
    followed(*advised(said, "init", DIR=tmp_path / "case", PRIOR=case / "prior.ply"))


def test_a_study_is_no_table(plan: Path, tmp_path: Path) -> None:
    (tmp_path / "study").mkdir()
    prior = ball(tmp_path / "ball") / "prior.ply"
    study(tmp_path / "study")
    said = refused("init", tmp_path / "made", "--prior", prior, "--points", tmp_path / "study")
    said = followed(*advised(said, "import"), tmp_path / "study", tmp_path / "case")
    assert "prior.ply: no prior was given; put the MRI or CT surface there before o3dls run" in said
    surface = o3dls.read_surface(prior)
    middle = ball_points().mean(axis=0)
    write_surface(tmp_path / "case/prior.ply", surface.with_vertices(surface.vertices + middle), units="mm")
    plan.write_text(LANDMARKS.replace("landmarks", "icp"))
    followed(*advised(said, "run"), plan, "--case", tmp_path / "case", "--out", tmp_path / "run")


def test_landmarks_without_a_frame_get_one(tmp_path: Path) -> None:
    case, marks = ball(tmp_path / "ball"), ball_case().prior_landmarks
    rows = "".join(
        f"m{k},{x},{y},{z},0,0,0,1,1,1,0,{name},,\n" for k, (name, (x, y, z)) in enumerate(marks.items())
    )
    columns = "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"
    (tmp_path / "marks.fcsv").write_text(f"# Markups fiducial file version = 4.6\n{columns}{rows}")
    files = ("--prior", case / "prior.ply", "--points", case / "points.csv", "--landmarks")
    said = refused("init", tmp_path / "made", *files, tmp_path / "marks.fcsv")
    convert = advised(said, "convert --frame")[:2]
    followed(*convert, "LPS", tmp_path / "marks.fcsv", tmp_path / "marks.csv")
    followed("init", tmp_path / "made", *files, tmp_path / "marks.csv")
    found = o3dls.read_case(tmp_path / "made").prior_landmarks
    assert {name: at.tolist() for name, at in found.items()} == {k: v.tolist() for k, v in marks.items()}


def test_micrometres_for_one_file_alone(tmp_path: Path) -> None:
    case = ball(tmp_path / "ball")
    prior = o3dls.read_surface(case / "prior.ply")
    write_surface(tmp_path / "a.pts", prior)
    files = ("--prior", tmp_path / "a.pts", "--points", case / "points.csv")
    said = refused("init", tmp_path / "made", *files, "--units", "mm")
    assert "say um (for this file alone: o3dls convert)" in said
    followed("convert", tmp_path / "a.pts", tmp_path / "a.ply", "--units", "um")
    np.testing.assert_allclose(o3dls.read_surface(tmp_path / "a.ply").vertices, prior.vertices, atol=1e-3)


def test_what_is_too_much_for_a_session_is_run(
    plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = ball(tmp_path / "ball")
    monkeypatch.setattr(watch, "MOST_ROWS", 20)
    whole = (case / "points.csv").read_bytes()
    with pytest.raises(InputError, match=r"or run the case by o3dls run$") as found:
        watch.Watch(case / "points.csv", "LPS")._read_points(whole)
    followed(*advised(str(found.value), "run"), plan, "--case", case, "--out", tmp_path / "run")


def test_a_cohort_is_that_of_a_batch(plan: Path, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    case = ball(tmp_path / "ball")
    said = refused("cohort", runs)
    followed(*advised(said, "batch")[:1], case, "--pipeline", plan, "--out", runs)
    followed("cohort", runs)
    assert "name the folder that `o3dls batch`" in refused("cohort", case)


def test_a_prior_in_metres_is_written_in_millimetres(plan: Path, tmp_path: Path) -> None:
    case = ball(tmp_path / "ball")
    prior = o3dls.read_surface(case / "prior.ply")
    write_surface(tmp_path / "m.ply", prior.with_vertices(prior.vertices / 1000.0))
    (case / "prior.ply").write_bytes((tmp_path / "m.ply").read_bytes())
    (case / "prior_landmarks.csv").unlink()
    command = ("run", plan, "--case", case, "--out", tmp_path / "run")
    plan.write_text(LANDMARKS.replace("landmarks", "icp"))
    convert = advised(refused(*command), "convert", PRIOR=tmp_path / "m.ply", OUT=case / "prior.ply")
    followed(*convert)
    followed(*command)


def test_runs_of_two_cases_are_compared(plan: Path, tmp_path: Path) -> None:
    for name, points in (("a", 60), ("b", 50)):
        case = ball(tmp_path / name, points=points)
        followed("run", plan, "--case", case, "--out", tmp_path / f"run_{name}")
    said = refused("report", tmp_path / "run_a", tmp_path / "run_b", "--out", tmp_path / "c.html")
    out = ("--out", tmp_path / "compare.html")
    followed(*advised(said, "compare"), tmp_path / "run_a", tmp_path / "run_b", *out)


def test_a_run_in_2d_has_its_pictures_in_the_report(plan: Path, tmp_path: Path) -> None:
    write_case(tmp_path / "disc", disc_case())
    plan.write_text(LANDMARKS.replace("landmarks", "icp"))
    followed("run", plan, "--case", tmp_path / "disc", "--out", tmp_path / "the run")
    followed(*advised(refused("view", tmp_path / "the run", "--window"), "report"))


def test_where_no_window_opens_a_page_does(
    plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(window, "has_display", lambda: False)
    monkeypatch.setattr(webbrowser, "get", lambda *_: webbrowser.GenericBrowser("true"))
    monkeypatch.setenv("BROWSER", "true")
    followed("run", plan, "--case", ball(tmp_path / "ball"), "--out", tmp_path / "the run")
    said = followed(*advised(refused("view", tmp_path / "the run", "--window"), "view"))
    assert "report.html" in said


def test_a_prior_without_a_frame_gets_one(plan: Path, tmp_path: Path) -> None:
    case = ball(tmp_path / "ball", frame="unknown")
    run = ("run", plan, "--case", case, "--out", tmp_path / "run", "--force")
    followed(*run)
    export = ("export", tmp_path / "run", "--on", "prior", "--format", "vtp", "--out", tmp_path / "a.vtp")
    said = refused(*export, "--frame", "RAS")
    convert = advised(said, "convert", PRIOR=case / "prior.ply")
    followed(*(tmp_path / word if word == "prior.ply" else word for word in convert))
    (case / "prior.ply").write_bytes((tmp_path / "prior.ply").read_bytes())
    followed(*run)
    followed(*export, "--frame", "RAS")


def test_settings_that_others_print() -> None:
    said = followed("settings")
    others = set(re.findall(r"as `o3dls (settings \w+)` prints them", said))
    assert others
    for other in others:
        followed(*other.split())
