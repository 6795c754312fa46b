"""Whom the app answers: the rules hold for every route that it has, now and later."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from starlette.routing import Route

from o3dls.app.desk import Desk
from o3dls.app.routes import MOST, most_bytes, routes_of
from o3dls.errors import InputError
from o3dls.io.text import LARGEST_FILE
from o3dls.web import guard, server
from o3dls.web.server import LocalServer
from tests.app.served import Served, served

FILLED = {"{name}": "a.csv", "{run:path}": "runs/one"}
PATIENCE = 1.0  # seconds, in place of those of a user
CLIENTS = 200


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("work")) as made:
        yield made


def every_route(app: Served) -> list[tuple[str, str]]:
    """Method and path of every route."""
    found = []
    for route in routes_of(app.desk).routes:
        assert isinstance(route, Route)
        path = route.path
        for name, value in FILLED.items():
            path = path.replace(name, value)
        found += [(method, path) for method in sorted(route.methods or ()) if method != "HEAD"]
    return found


def test_these_are_the_routes(app: Served) -> None:
    pages = ("/", "/case", "/run", "/runs/one/report.html", "/grade", "/export", "/events")
    pages += ("/compare", "/cohort")
    acts = ("/look", "/unpack", "/make", "/fit", "/pose", "/place", "/fuse", "/cancel", "/export")
    own = {("PUT", "/files/a.csv"), *(("GET", one) for one in pages), *(("POST", one) for one in acts)}
    assert set(every_route(app)) == own


def test_without_the_token_no_route_answers(app: Served) -> None:
    name = f"o3dls_app_{app.server.port}"
    for method, path in every_route(app):
        for cookie in (None, f"{name}=wrong", f"o3dls_live_{app.server.port}={app.server.token}", "=;="):
            status, text, _ = app.ask(method, path, {}, Cookie=cookie)
            assert (status, "by the link that o3dls app printed" in text) == (403, True), (method, path)
        if (method, path) != ("GET", "/"):  # the link opens the page alone
            assert app.ask(method, f"{path}?token={app.server.token}", {}, Cookie=None)[0] == 403


def test_a_name_that_is_turned_to_this_machine_and_other_sites_get_nothing(app: Served) -> None:
    for method, path in every_route(app):
        for host in ("evil.example", "127.0.0.1", "localhost.evil", f"evil.example:{app.server.port}", ""):
            status, text, _ = app.ask(method, path, {}, Host=host)
            assert (status, "own address" in text) == (403, True), (method, path, host)
        for origin in ("http://evil.example", "null", "http://127.0.0.1:1", f"https://{app.host}"):
            status, text, _ = app.ask(method, path, {}, Origin=origin)
            assert (status, "own page alone" in text) == (403, True), (method, path, origin)
        if method != "GET":
            assert app.ask(method, path, {}, Origin=None)[0] == 403


def test_every_answer_has_the_headers_that_protect_it(app: Served) -> None:
    for method, path in every_route(app):
        if path in ("/events", "/cancel"):
            continue
        _, _, headers = app.ask(method, path, {})
        assert headers["x-frame-options"] == "DENY", (method, path)
        assert headers["cache-control"] == "no-store"
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"


def test_the_link_leaves_a_cookie_that_no_script_reads_and_no_other_page_does(app: Served) -> None:
    status, text, headers = app.ask("GET", f"/?token={app.server.token}", Cookie=None)
    assert status == 200
    assert "HttpOnly; SameSite=Strict" in headers["set-cookie"]
    rules = text.partition('Content-Security-Policy" content="')[2].partition('"')[0]
    assert "default-src 'none'" in rules.replace("&#x27;", "'")
    assert "unsafe" not in rules
    assert "set-cookie" not in app.ask("GET", "/case?folder=none")[2]


def test_a_body_that_is_too_long_or_no_action_is_refused(
    app: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard, "HEARD", 0.2)
    assert most_bytes("/files/a") == LARGEST_FILE
    for method, path in every_route(app):
        if method == "GET":
            continue
        assert app.ask(method, path, None, Content_Length=None, Transfer_Encoding="chunked")[0] == 411
        status, text, _ = app.ask(method, path, b"{}", Content_Length=str(LARGEST_FILE + 1))
        assert (status, "may have" in text) == (413, True), (method, path)
        assert app.ask(method, path, None, Content_Length="9" * 400)[0] == 400
        if method == "POST":
            assert app.ask(method, path, b"[" * 50_000)[0] == 400
            assert app.ask(method, path, b"[1]")[0] == 400
            assert app.ask(method, path, b"{}", Content_Type="text/plain")[0] == 415


def test_who_sends_too_much_hears_why(app: Served) -> None:
    for method, path in every_route(app):
        if method == "POST":
            status, text, _ = app.ask(method, path, b" " * (MOST + 1))
            assert (status, f"may have {MOST} bytes" in text) == (413, True), path


def test_other_methods_and_other_paths_are_refused(app: Served) -> None:
    assert app.ask("DELETE", "/files/a.csv", {})[0] == 405
    for path in ("/nothing", "/files/", "/files/..%2Fa.csv", "/static/app.js", "//"):
        assert app.ask("GET", path)[0] in (404, 405)


@pytest.mark.parametrize(
    "path", ["../secret", "/etc", "cases/../../secret", "link", "link/inside", "", "a\0b", ".", "~"]
)
def test_no_path_leads_out_of_the_folder(app: Served, path: str) -> None:
    outside = app.folder.parent / "secret"
    outside.mkdir(exist_ok=True)
    for name in ("run.json", "case.toml", "prior.ply"):
        (outside / name).write_text("{}")
    with suppress(FileExistsError):
        (app.folder / "link").symlink_to(outside)
    for action, content in (
        ("/look", {"role": "prior", "file": path}),
        ("/unpack", {"file": path}),
        ("/make", {"name": "a", "prior": path, "map": path}),
        ("/fuse", {"case": path, "preset": "quick"}),
        ("/pose", {"case": path}),
        ("/place", {"case": path, "T": np.eye(4).tolist()}),
        ("/export", {"run": path, "export": "ply"}),
    ):
        status, text, _ = app.ask("POST", action, content)
        assert (status, "error" in json.loads(text)) == (422, True), (action, text)
    quoted = path.replace("\0", "%00").replace("/", "%2F")
    for page in ("case?folder", "run?folder", "grade?folder", "export?file", "cohort?folder"):
        assert app.ask("GET", f"/{page}={quoted}")[0] == 422, page
    assert app.ask("GET", f"/compare?run={quoted}&run=.{quoted}")[0] == 422
    assert app.ask("GET", f"/{quoted}/report.html")[0] in (404, 422)


@pytest.mark.parametrize("name", [".hidden", "-rf", "a%00b", "%2e%2e", "a" * 200, "a%0ab", "%20", "a%5Cb"])
def test_a_file_of_no_name_is_not_kept(app: Served, name: str) -> None:
    before = sorted((app.folder / "files").glob("*"))
    status, text, _ = app.ask("PUT", f"/files/{name}", b"x")
    assert (status, "name" in text) == (422, True)
    assert sorted((app.folder / "files").glob("*")) == before


def test_a_file_is_kept_once_and_another_of_its_name_beside_it(app: Served) -> None:
    assert app.put("b.csv", b"x,y,z\n") == {"file": "files/b.csv"}
    assert app.put("b.csv", b"x,y,z\n") == {"file": "files/b.csv"}
    assert app.put("b.csv", b"x,y\n") == {"file": "files/b_2.csv"}
    assert (app.folder / "files" / "b.csv").read_bytes() == b"x,y,z\n"
    for path in (app.folder / "files").iterdir():
        path.unlink()


def test_a_file_that_breaks_off_leaves_nothing(app: Served) -> None:
    connection = socket.create_connection(("127.0.0.1", app.server.port))
    lines = [f"{key}: {value}" for key, value in app.headers().items()]
    head = "\r\n".join(["PUT /files/c.csv HTTP/1.1", *lines, "Content-Length: 1000", "", ""])
    connection.sendall(head.encode() + b"x" * 500)
    files = app.folder / "files"
    until(lambda: any(files.glob(".c.csv*")))
    connection.close()
    until(lambda: not list(files.iterdir()))


def until(reached: object, seconds: float = 10.0) -> None:
    """Wait until something is so."""
    end = time.monotonic() + seconds
    while not reached():  # type: ignore[operator]
        assert time.monotonic() < end
        time.sleep(0.05)


def test_who_is_slow_is_hung_up_on_and_costs_the_others_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (guard, server):
        monkeypatch.setattr(module, "PATIENCE", PATIENCE)
    with served(tmp_path / "work") as app:
        idle = [socket.create_connection(("127.0.0.1", app.server.port)) for _ in range(CLIENTS)]
        for one in idle[: CLIENTS // 2]:
            one.sendall(b"GET / HTTP/1.1\r\nHost:")  # it never ends its head
        begin = time.monotonic()
        assert app.ask("GET", "/")[0] == 200
        assert time.monotonic() - begin < PATIENCE
        slow = socket.create_connection(("127.0.0.1", app.server.port))
        lines = [f"{key}: {value}" for key, value in app.headers().items()]
        slow.sendall("\r\n".join(["POST /fuse HTTP/1.1", *lines, "Content-Length: 10", "", "{"]).encode())
        slow.settimeout(10.0)
        assert b" 408 " in slow.recv(1000)
        for one in idle:
            one.settimeout(10.0)
            assert one.recv(100) == b""
            one.close()
        slow.close()


def test_a_taken_port_and_a_folder_that_is_none_are_refused(app: Served, tmp_path: Path) -> None:
    for port in (app.server.port, 70_000):
        with pytest.raises(InputError, match=f"port = {port}: cannot be listened on"):
            LocalServer(routes_of(app.desk), "app", most_bytes, port)
    with pytest.raises(InputError, match="no such folder"):
        Desk(tmp_path / "none")
