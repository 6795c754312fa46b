"""What the refusals of `live` ask for begins a session, and the link that it prints opens its page."""

from __future__ import annotations

import http.client
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from said import said_by

from o3dls.io.case_writer import write_case
from o3dls.live.record import open_record
from tests.live.test_server import Page
from tests.live.test_server import Session as Server
from tests.tiny import ball_case

pytest.importorskip("o3dls.live.display")
SLOW = 300.0  # seconds: a session stands back behind all else on a busy machine


def refused(*arguments: object) -> str:
    code, said = said_by("live", *arguments)
    assert code == 2, said
    return said


def followed(*arguments: object, given: str = '{"do": "end"}\n') -> None:
    """A session without a page that is ended at once, or by its source, and leaves a run where it can."""
    command = [sys.executable, "-m", "o3dls", "live", *map(str, arguments), "--headless"]
    done = subprocess.run(command, input=given, capture_output=True, text=True, timeout=SLOW, check=False)
    assert "Traceback" not in done.stderr
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("live") / "ball"
    write_case(folder, replace(ball_case(), truth=None))
    return folder


def test_a_session_begins_with_the_case_and_the_rate_that_are_asked_for(case: Path, tmp_path: Path) -> None:
    record = ("--record", tmp_path / "record")
    assert "no CASE given, and no --record folder to go on from" in refused("--headless")
    assert "--rate: is of --replay, which is not given" in refused(case, *record, "--rate", 200)
    replay = ("--replay", case / "points.csv")
    assert "say --rate, in points a second" in refused(case, *record, *replay, "--headless")
    assert not (tmp_path / "record").exists()
    followed(case, *record, *replay, "--rate", 200, given="")
    assert (tmp_path / "record/run/run.json").is_file()
    with begun(*record, "--no-browser") as session:  # it goes on
        assert session.stderr is not None
        assert any(line.startswith("http") for line in session.stderr)


def test_a_session_goes_on_with_its_own_case_or_in_another_folder(case: Path, tmp_path: Path) -> None:
    prior = ball_case().prior
    larger = replace(ball_case(), prior=prior.with_vertices(1.01 * prior.vertices), truth=None)
    other, record = tmp_path / "other", tmp_path / "record"
    write_case(other, larger)
    open_record(record, case)[0].close()
    said = refused(other, "--record", record, "--headless")
    assert "name the case folder that the session was begun with, or another --record folder" in said
    open_record(record, case)[0].close()
    open_record(tmp_path / "another", other)[0].close()


def test_the_address_of_a_navigation_system_is_said_as_the_sentence_shows(case: Path, tmp_path: Path) -> None:
    """It waits for a system that is not there yet."""
    found = re.search(r"must be HOST:PORT, such as (\S+)", refused(case, "--igtl", "localhost"))
    assert found
    with begun(case, "--record", tmp_path / "record", "--headless", "--json", "--igtl", found[1]) as session:
        assert session.stdout is not None
        assert any(found[1] in line for line in session.stdout)


@contextmanager
def begun(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    """A session that is killed in the end."""
    command = [sys.executable, "-m", "o3dls", "live", *map(str, arguments)]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, text=True, **pipes) as session:
        try:
            yield session
        finally:
            session.kill()


def test_the_link_that_is_printed_opens_the_page(case: Path, tmp_path: Path) -> None:
    answers = []
    with begun(case, "--no-browser", "--record", tmp_path / "record") as session:
        assert session.stderr is not None
        parts = urlsplit(next(line.strip() for line in session.stderr if line.startswith("http")))
        for path in ("/", f"{parts.path}?{parts.query}"):
            connection = http.client.HTTPConnection(parts.netloc, timeout=60)
            connection.request("GET", path)
            answer = connection.getresponse()
            answers.append((answer.status, answer.read().decode()))
            connection.close()
    assert answers[0][0] == 403
    assert "open the page by the link that o3dls live printed" in answers[0][1]
    assert answers[1][0] == 200
    assert "<title>" in answers[1][1]


def test_a_request_that_says_what_is_asked_for_is_answered() -> None:
    server = Server()
    page = Page(server)
    page.until("role")
    undo = b'{"do": "undo"}'
    refusals: tuple[tuple[bytes | None, dict[str, str | None], int, str], ...] = (
        (undo, {"Origin": None}, 403, "must say where it comes from (Origin)"),
        (None, {"Transfer_Encoding": "chunked"}, 411, "must say its length"),
    )
    try:
        for body, headers, status, sentence in refusals:
            found, text, _ = server.ask("POST", "/act", body, **headers)
            assert found == status
            assert sentence in text
        assert server.ask("POST", "/act", undo)[0] == 200
    finally:
        page.close()
        server.server.close()
