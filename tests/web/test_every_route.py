"""Whom our servers answer: the rules hold for every route that the app and a session have, now and later."""

from __future__ import annotations

import http.client
import json
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest

from o3dls.app import routes as app_routes
from o3dls.app.desk import Desk
from o3dls.io.text import LARGEST_FILE
from o3dls.live import messages
from o3dls.live import routes as live_routes
from o3dls.live.pages import Pages
from o3dls.web import guard, server
from o3dls.web.routes import Routes
from o3dls.web.rules import Rule
from o3dls.web.server import LocalServer
from tests.web.asking import Asking

FILLED = {"{name}": "a.csv", "{run:path}": "runs/one"}
PATIENCE = 1.0  # seconds, in place of those of a user
CLIENTS = 200
ACTION = app_routes.MOST
# What each route is, in words of this test: a route that is new must be written here too.
RULES = {
    "app": {
        *(Rule("GET", path) for path in ("/", "/case", "/run", "/grade", "/glance", "/export", "/events")),
        *(Rule("GET", path) for path in ("/compare", "/cohort", "/{run:path}/report.html")),
        Rule("PUT", "/files/{name}", LARGEST_FILE, "any"),
        *(
            Rule("POST", f"/{act}", ACTION)
            for act in ("look", "make", "place", "fuse", "cancel", "export", "live", "unpack", "fit", "pose")
        ),
    },
    "live": {
        Rule("GET", "/"),
        Rule("GET", "/report"),
        Rule("GET", "/events", asker="named"),
        Rule("POST", "/act", messages.MOST, "acting"),
        Rule("POST", "/role", messages.MOST, "named"),
    },
}


class Served(Asking):
    """A server that has begun, and what its pages have done."""

    def __init__(self, command: str, routes: Routes, server: LocalServer, done: list[Any]) -> None:
        self.command, self.server, self.done = command, server, done
        self.found = [rule for rule, _ in routes]
        self.rules = RULES[command]

    def every_path(self) -> Iterator[tuple[Rule, str]]:
        """Every rule with a path that it is of, which names the page where it must."""
        for rule in self.rules:
            path = rule.path
            for name, value in FILLED.items():
                path = path.replace(name, value)
            yield rule, path + ("?page=a" if rule.asker == "named" and rule.method == "GET" else "")


@contextmanager
def serve_app(folder: Path) -> Iterator[Served]:
    with closing(Desk(folder)) as desk:
        routes = app_routes.routes_of(desk)
        with closing(LocalServer(routes, "app")) as server:
            yield Served("app", routes, server, [])


@contextmanager
def serve_live(_: Path) -> Iterator[Served]:
    """A session, in which page a is open and acts."""
    done: list[Any] = []

    def act(action: dict[str, Any]) -> dict[str, Any]:
        done.append(action)
        return {"ok": True}

    pages = Pages(act)
    routes = live_routes.routes_of(pages)
    with closing(LocalServer(routes, "live", roles=pages.roles)) as server, closing(pages):
        served = Served("live", routes, server, done)
        with closing(http.client.HTTPConnection(served.host, timeout=60)) as page:
            page.request("GET", "/events?page=a", headers={"Cookie": served.cookie})
            page.getresponse()
            yield served


SERVERS = {"app": serve_app, "live": serve_live}
Begin = Callable[[Path], Any]


@pytest.fixture(scope="module", params=list(SERVERS))
def served(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with SERVERS[request.param](tmp_path_factory.mktemp("work")) as made:
        yield made


def test_every_route_has_its_rule_and_no_route_is_new(served: Served) -> None:
    assert set(served.found) == served.rules
    assert len(served.found) == len(served.rules)


def test_without_the_token_no_route_answers(served: Served) -> None:
    name, token = f"o3dls_{served.command}_{served.server.port}", served.server.token
    other = "live" if served.command == "app" else "app"
    for rule, path in served.every_path():
        for cookie in (
            None,
            f"{name}=wrong",
            f"o3dls_{other}_{served.server.port}={token}",
            "=;=",
            f"{name}=",
        ):
            status, text, _ = served.ask(rule.method, path, {}, Cookie=cookie)
            said = f"by the link that o3dls {served.command} printed"
            assert (status, said in json.loads(text)["error"]) == (403, True), rule
        if rule.path != "/":  # the link opens the page alone
            more = f"{path}{'&' if '?' in path else '?'}token={token}"
            assert served.ask(rule.method, more, {}, Cookie=None)[0] == 403
    for path in ("/?token=wrong", "/?token=", "/nothing", "/nothing?token=" + token):
        assert served.ask("GET", path, Cookie=None)[0] == 403


def test_a_name_that_is_turned_to_this_machine_and_other_sites_get_nothing(served: Served) -> None:
    port = served.server.port
    hosts = ("evil.example", f"evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "localhost.evil", "")
    origins = (
        "http://evil.example",
        "null",
        "http://127.0.0.1:1",
        "https://127.0.0.1",
        f"https://{served.host}",
    )
    for rule, path in served.every_path():
        for host in hosts:
            status, text, _ = served.ask(rule.method, path, {}, Host=host)
            assert (status, "own address" in text) == (403, True), (rule, host)
        for origin in origins:
            status, text, _ = served.ask(rule.method, path, {}, Origin=origin)
            assert (status, "own page alone" in text) == (403, True), (rule, origin)
        if rule.method != "GET":
            assert served.ask(rule.method, path, {}, Origin=None)[0] == 403
    assert served.done == []


def test_this_machine_alone_reaches_a_server(served: Served) -> None:
    """Every other address of the machine leads to nobody."""
    with pytest.raises(OSError):
        socket.create_connection(("127.0.0.2", served.server.port), timeout=2.0)
    with pytest.raises(OSError):
        socket.create_connection(("::1", served.server.port), timeout=2.0)


def test_every_answer_has_the_headers_that_protect_it(served: Served) -> None:
    for rule, path in served.every_path():
        if rule.path == "/cancel":
            continue
        _, _, headers = served.ask(rule.method, path, {})
        assert headers["x-frame-options"] == "DENY", rule
        assert headers["cache-control"] == "no-store"
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["cross-origin-resource-policy"] == "same-origin"
        assert "server" not in headers
        assert ("set-cookie" in headers) == (rule.path == "/"), rule


def test_the_link_leaves_a_cookie_that_no_script_reads_and_no_other_page_does(served: Served) -> None:
    status, text, headers = served.ask("GET", f"/?token={served.server.token}", Cookie=None)
    assert status == 200
    assert "HttpOnly; SameSite=Strict" in headers["set-cookie"]
    rules = text.partition('Content-Security-Policy" content="')[2].partition('"')[0].replace("&#x27;", "'")
    assert "default-src 'none'" in rules
    assert "connect-src 'self'" in rules
    assert "unsafe" not in rules


def test_who_may_ask_is_checked_by_the_name_of_the_page(served: Served) -> None:
    before = len(served.done)
    for rule, path in served.every_path():
        if rule.asker == "any":
            continue
        for name in ("", "a b", "a/b", "a" * 65, "ä"):
            bare = path.partition("?")[0]
            if rule.method == "GET":
                status, text, _ = served.ask("GET", f"{bare}?page={quote(name)}")
            else:
                status, text, _ = served.ask(rule.method, bare, {}, X_Page=name)
            assert (status, "name itself" in text) == (400, True), (rule, name)
        if rule.asker == "acting":
            status, text, _ = served.ask(rule.method, path, {"do": "undo"}, X_Page="b")
            assert (status, "looks on" in text) == (409, True), rule
            assert served.ask(rule.method, f"{path}?page=a", {"do": "undo"}, X_Page="b")[0] == 409
    assert len(served.done) == before


def test_a_body_that_is_too_long_or_no_action_is_refused(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard, "HEARD", 0.05)
    before = len(served.done)
    for rule, path in served.every_path():
        assert served.ask(rule.method, path, None, Transfer_Encoding="chunked")[0] == 411, rule
        if rule.method == "GET":
            continue
        status, text, _ = served.ask(rule.method, path, b"{}", Content_Length=str(rule.most + 1))
        assert (status, f"may have {rule.most} bytes" in text) == (413, True), rule
        assert served.ask(rule.method, path, None, Content_Length="9" * 400)[0] == 400
        assert served.ask(rule.method, path, None, Content_Length="two")[0] == 400
        if rule.method == "POST":
            for body in (
                b"not JSON",
                b"[" * 9000,
                b"[1]",
                b"\xff\xfe",
                b'{"a": NaN}',
                b'{"a": "\\ud800"}',
                b"",
            ):
                status, text, _ = served.ask(rule.method, path, body)
                assert (status, "an action must be" in text) == (400, True), (rule, body)
            assert served.ask(rule.method, path, b"{}", Content_Type="text/plain")[0] == 415
    assert len(served.done) == before


def test_who_sends_too_much_hears_why_and_who_sends_just_enough_does_not(served: Served) -> None:
    for rule, path in served.every_path():
        if rule.method == "POST":
            status, text, _ = served.ask(rule.method, path, b" " * (rule.most + 1))
            assert (status, f"may have {rule.most} bytes" in text) == (413, True), rule
            assert served.ask(rule.method, path, b" " * rule.most)[0] == 400, rule


def test_other_methods_and_other_paths_are_refused_in_a_sentence(served: Served) -> None:
    known = {(rule.method, rule.path) for rule in served.rules}
    for rule, path in served.every_path():
        for method in ("GET", "POST", "PUT", "DELETE", "PATCH", "OPTIONS", "HEAD", "BREW"):
            if (method, rule.path) not in known:
                status, text, _ = served.ask(method, path, {})
                assert status == 405, (method, path)
                assert method == "HEAD" or "alone" in json.loads(text)["error"]
    for path in (
        "/nothing",
        "/files/",
        "/files/..%2Fa.csv",
        "/static/app.js",
        "//",
        "/../../etc/passwd",
        "//[",
    ):
        status, text, _ = served.ask("GET", path)
        assert status in (404, 405)
        assert json.loads(text)["error"]


@pytest.mark.parametrize("begin", SERVERS.values(), ids=SERVERS)
def test_who_is_slow_is_hung_up_on_and_costs_the_others_nothing(
    begin: Begin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (guard, server):
        monkeypatch.setattr(module, "PATIENCE", PATIENCE)
    with begin(tmp_path) as served:
        idle = [socket.create_connection(("127.0.0.1", served.server.port)) for _ in range(CLIENTS)]
        for one in idle[: CLIENTS // 2]:
            one.sendall(b"GET / HTTP/1.1\r\nHost:")  # it never ends its head
        assert served.ask("GET", "/")[0] == 200
        slow = [
            served.begin(rule.method, path, "Content-Length: 10\r\n\r\n{")
            for rule, path in served.every_path()
            if rule.method != "GET"
        ]
        for one in slow:
            assert b" 408 " in one.recv(1000)
            one.close()
        for one in idle:
            one.settimeout(10.0)
            with suppress(ConnectionResetError):
                assert one.recv(100) == b""
            one.close()
        assert served.done == []
        assert served.ask("GET", "/")[0] == 200


@pytest.mark.parametrize("begin", SERVERS.values(), ids=SERVERS)
def test_clients_that_are_idle_do_not_hold_up_the_end(begin: Begin, tmp_path: Path) -> None:
    with begin(tmp_path) as served:
        idle = [socket.create_connection(("127.0.0.1", served.server.port)) for _ in range(CLIENTS)]
        assert served.ask("GET", "/")[0] == 200
        before = time.monotonic()
        served.server.close()
        assert time.monotonic() - before < guard.PATIENCE
        for one in idle:
            one.close()
