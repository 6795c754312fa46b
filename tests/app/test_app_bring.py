"""What is brought: read in its role, asked about where it is doubtful, and made into a case."""

from __future__ import annotations

import base64
import http.client
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest

from o3dls.app.shelf import ENDINGS
from o3dls.errors import Answer, Doubt, choices
from o3dls.io.case_reader import read_case
from o3dls.io.surfaces import read_surface, write_surface
from o3dls.pipeline.supervision import Limits
from o3dls.resources import demo_case
from tests.app.served import Served, ask_as_page, served

PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("work")) as made:
        yield made


def bring(app: Served, path: Path, name: str = "") -> str:
    return str(app.put(name or path.name, path.read_bytes())["file"])


def two_labels(path: Path) -> Path:
    """A label volume of two balls: 1 of 4 ml and 2 of 33 ml."""
    grid = np.stack(np.meshgrid(*[np.arange(60.0)] * 3, indexing="ij"), axis=-1)
    labels = np.zeros((60, 60, 60), dtype=np.uint8)
    labels[np.linalg.norm(grid - [12.0, 12.0, 12.0], axis=-1) < 10.0] = 1
    labels[np.linalg.norm(grid - [38.0, 38.0, 38.0], axis=-1) < 20.0] = 2
    nibabel.save(nibabel.Nifti1Image(labels, np.diag([1.0, 1.0, 1.0, 1.0])), path)
    return path


def test_what_was_read_is_said_with_a_picture(app: Served) -> None:
    found = app.act("/look", {"role": "prior", "file": bring(app, demo_case() / "prior.ply")})
    assert found["facts"]["Volume"] == "42.9 ml"
    assert base64.b64decode(found["picture"]).startswith(PNG)
    found = app.act("/look", {"role": "map", "file": bring(app, demo_case() / "points.csv")})
    assert found["facts"]["Points"] == "250 eam, 40 ablation, 4 landmark"
    assert any("bipolar" in line for line in found["notes"])
    found = app.act("/look", {"role": "landmarks", "file": bring(app, demo_case() / "prior_landmarks.csv")})
    assert found["facts"]["Landmarks"] == "LSPV, LIPV, RSPV, RIPV"


def test_a_doubt_is_a_question_whose_answers_are_settings(app: Served, tmp_path: Path) -> None:
    file = bring(app, two_labels(tmp_path / "labels.nii.gz"))
    asked = app.act("/look", {"role": "prior", "file": file})
    assert asked["error"] == f"{file}: holds 2 labels; say --label (there are 1, 2)"
    assert asked["doubt"]["question"] == f"{file}: holds 2 labels"
    answers = {one["words"]: one["settings"] for one in asked["doubt"]["answers"]}
    assert answers == {"label 1": {"label": 1}, "label 2": {"label": 2}}
    volumes = [
        app.act("/look", {"role": "prior", "file": file, "settings": settings})["facts"]["Volume"]
        for settings in answers.values()
    ]
    assert [round(float(one.split()[0])) for one in volumes] == [4, 33]


def test_units_and_openings_are_asked_about(app: Served, tmp_path: Path) -> None:
    prior = read_surface(demo_case() / "prior.ply")
    write_surface(tmp_path / "small.stl", prior.with_vertices(prior.vertices / 1000.0))
    write_surface(tmp_path / "open.ply", type(prior)(prior.vertices, prior.faces[10:]))
    asked = app.act("/look", {"role": "prior", "file": bring(app, tmp_path / "small.stl")})
    assert "doubt" in asked, asked
    assert {"units": "m"} in [one["settings"] for one in asked["doubt"]["answers"]]
    file = bring(app, tmp_path / "open.ply")
    asked = app.act("/look", {"role": "prior", "file": file})
    assert [one["settings"] for one in asked["doubt"]["answers"]] == [{"cap": True}]
    assert "--" not in asked["doubt"]["question"]
    assert "facts" in app.act("/look", {"role": "prior", "file": file, "settings": {"cap": True}})


def test_a_case_that_was_made_is_one_of_the_command_that_is_said(app: Served) -> None:
    files = {role: bring(app, demo_case() / name) for role, name in FILES.items()}
    made = app.act("/make", {"name": "one", **files})
    assert made["case"] == "cases/one"
    line = shlex.split(made["command"])
    assert line[:3] == ["o3dls", "init", "cases/one"]
    again = [*line[1:2], "cases/two", *line[3:]]
    done = subprocess.run(
        [sys.executable, "-m", "o3dls", *again], cwd=app.folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    one, two = (app.folder / "cases" / name for name in ("one", "two"))
    assert sorted(path.name for path in one.iterdir()) == sorted(path.name for path in two.iterdir())
    assert (one / "case.toml").read_text().replace('"one"', '"two"') == (two / "case.toml").read_text()
    assert len(read_case(one).landmark_pairs()[0]) == 4


FILES = {"prior": "prior.ply", "map": "points.csv", "landmarks": "prior_landmarks.csv"}


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"force": True}, "settings: force: no such setting"),
        ({"label": "1"}, "settings: label = '1': must be of type int"),
        ({"units": "ells"}, "units"),
        ([1], "settings: must be an object"),
    ],
)
def test_settings_that_are_none_are_refused(app: Served, settings: object, said: str) -> None:
    files = {role: bring(app, demo_case() / name) for role, name in FILES.items()}
    assert said in app.act("/make", {"name": "bad", **files, "settings": settings})["error"]
    assert not (app.folder / "cases" / "bad").exists()


def test_what_is_missing_is_said(app: Served) -> None:
    points = bring(app, demo_case() / "points.csv")
    assert "prior" in app.act("/make", {"name": "bad", "map": points})["error"]
    assert "map" in app.act("/make", {"name": "bad", "prior": points})["error"]
    assert "name" in app.act("/make", {"prior": points, "map": points})["error"]
    assert "role" in app.act("/look", {"role": "cat", "file": points})["error"]
    prior = bring(app, demo_case() / "prior.ply")
    app.act("/make", {"name": "asked", "prior": prior, "map": points})
    assert "preset" in app.act("/fuse", {"case": "cases/asked", "preset": "x"})["error"]


def test_wrong_files_end_in_a_sentence_or_a_choice(app: Served, shared_data: Path) -> None:
    paths = sorted(path for path in (shared_data / "reports").rglob("*") if path.name.endswith(ENDINGS))
    assert len(paths) > 30
    answers = 0
    for k, path in enumerate(paths):
        file = bring(app, path, f"{k}_{path.name}")
        for role in ("prior", "map", "landmarks", "image"):
            found = app.act("/look", {"role": role, "file": file})
            assert ("facts" in found) != ("error" in found), path
            said = found.get("error", "")
            assert "internal error" not in said, (path, said)
            assert "error inside" not in said, (path, said)
            assert said == "" or len(said) > 20, (path, said)
            answers += "error" in found
    assert answers > 30  # most are nothing in most roles


def test_a_reader_that_is_killed_is_replaced(app: Served) -> None:
    file = bring(app, demo_case() / "prior.ply")
    process = app.desk._reader._worker._process
    os.kill(process.pid or 0, signal.SIGKILL)
    process.join(10.0)
    assert "facts" in app.act("/look", {"role": "prior", "file": file})


def test_a_server_that_is_killed_leaves_nothing_half_made(tmp_path: Path) -> None:
    """Its processes end with it, what it had half made is gone, and the next one goes on."""
    work = tmp_path / "work"
    with served(work) as app:
        files = {role: bring(app, demo_case() / name) for role, name in FILES.items()}
        app.act("/make", {"name": "one", **files})
    command = [sys.executable, "-m", "o3dls", "app", str(work), "--no-browser"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        url = process.stderr.readline().strip()
        _begin_run(url)
        half = _begin_upload(url)
        time.sleep(4.0)  # somewhere in the run
        assert list((work / "files").glob(".half.csv*"))
        process.kill()
    half.close()
    end = time.monotonic() + 20.0
    while found := [path for path in (work / "runs").glob("*") if not path.name.endswith(".failed.log")]:
        assert time.monotonic() < end, found
        time.sleep(0.2)
    with served(work) as app:
        assert sorted(path.name for path in (work / "files").iterdir()) == sorted(FILES.values())
        assert app.desk.shelf.listed()["runs"] == []
        assert app.act("/fuse", {"case": "cases/one", "preset": "quick"}) == {"run": "runs/one-quick"}
        assert app.act("/cancel", {}) == {"ok": True}
        assert app.desk.job is not None
        assert app.desk.job.record()["state"] == "cancelled"


def _begin_run(url: str) -> None:
    host, headers = ask_as_page(url)
    connection = http.client.HTTPConnection(host, timeout=30)
    connection.request("POST", "/fuse", json.dumps({"case": "cases/one", "preset": "quick"}), headers)
    assert json.loads(connection.getresponse().read()) == {"run": "runs/one-quick"}


def _begin_upload(url: str) -> http.client.HTTPConnection:
    """Send half of a file."""
    host, headers = ask_as_page(url)
    connection = http.client.HTTPConnection(host, timeout=30)
    connection.putrequest("PUT", "/files/half.csv")
    for key, value in {**headers, "Content-Length": "1000"}.items():
        connection.putheader(key, value)
    connection.endheaders(b"x" * 500)
    return connection


def test_a_doubt_says_its_advice_to_who_reads_and_its_answers_to_who_is_asked() -> None:
    import pickle

    doubt = Doubt(
        "a.nii: holds 2 labels", "say --label", [*choices("label", (1, 2)), Answer("none", {"cap": True})]
    )
    for one in (doubt, pickle.loads(pickle.dumps(doubt))):  # it comes from another process
        assert str(one) == "a.nii: holds 2 labels; say --label"
        assert one.record()["question"] == "a.nii: holds 2 labels"
        assert [answer["words"] for answer in one.record()["answers"]] == ["1", "2", "none"]


def events(app: Served) -> Iterator[dict[str, Any]]:
    """What a page is told, as it comes."""
    connection = http.client.HTTPConnection(app.host, timeout=60)
    connection.request("GET", "/events", headers=app.headers())
    answer = connection.getresponse()
    assert answer.headers["content-type"].startswith("text/event-stream")
    while line := answer.readline().decode():
        if line.startswith("data: "):
            yield json.loads(line.removeprefix("data: "))
    connection.close()


def test_a_run_beyond_its_limit_is_ended_and_every_page_is_told(tmp_path: Path) -> None:
    work = tmp_path / "work"
    work.mkdir()
    shutil.copytree(demo_case(), work / "cases" / "one")
    with served(work, Limits(seconds=3.0)) as app:
        assert app.act("/fuse", {"case": "cases/one", "preset": "default"}) == {"run": "runs/one"}
        assert "is at work" in app.act("/fuse", {"case": "cases/one", "preset": "default"})["error"]
        first, second = (list(_until_ended(events(app))) for _ in range(2))
        assert first[-1] == second[-1]  # who comes later is told the same
        assert first[-1]["state"] == "refused"
        assert first[-1]["said"] == "took more than 3 s and was stopped (--timeout)"
        assert first[-1]["command"] == "o3dls run --case cases/one --out runs/one"
        assert app.desk.shelf.listed()["runs"] == []
        assert "no run is at work" in app.act("/cancel", {})["error"]


def _until_ended(told: Iterator[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    for job in told:
        yield job
        if job["state"] != "running":
            return


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="this system lists no children")
def test_an_interrupt_ends_the_command_and_its_processes(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "o3dls", "app", str(tmp_path), "--no-browser"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("http://127.0.0.1:")
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        assert children
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 130
        assert process.stderr.read() == "o3dls: interrupted\n"
    end = time.monotonic() + 10.0
    while any(Path(f"/proc/{child}").exists() for child in children):
        assert time.monotonic() < end
        time.sleep(0.1)
    assert sorted(path.name for path in tmp_path.iterdir()) == []
