"""The routes of a server: what answers each method on each path, once its rule lets the request through."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any

from starlette.requests import Request
from starlette.routing import Route, Router
from starlette.types import ASGIApp, Receive, Scope, Send

from ..errors import InputError
from ..io.documents import parse_json
from .roles import Roles
from .rules import READS, Refusal, Rule, check_page_name

Answer = Callable[[Request], Awaitable[ASGIApp]]  # a response is one
Routes = Sequence[tuple[Rule, Answer]]


def router_of(routes: Routes, roles: Roles) -> Router:
    """Return what answers the routes of a server. It lets every error pass to the guard, which says it."""
    paths: dict[str, dict[str, tuple[Rule, Answer]]] = {}
    for rule, answer in routes:
        paths.setdefault(rule.path, {})[rule.method] = (rule, answer)
    doors = [Route(path, _Door(path, methods, roles)) for path, methods in paths.items()]
    return Router(doors, redirect_slashes=False, default=_refuse_page)


def page_name(request: Request) -> str:
    """Return the name that the asking page gave itself: in the address where it reads, since a browser sends
    no header of ours with a request for events; else in the header X-Page. Raises Refusal where it is none.
    """
    if request.method in READS:
        return check_page_name(request.query_params.get("page", ""))
    return check_page_name(request.headers.get("x-page", ""))


async def read_action(request: Request) -> dict[str, Any]:
    """Read what a page asks to be done. Raises Refusal where it is no object in JSON."""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise Refusal(415, "an action is sent as application/json")
    try:
        found = parse_json((await request.body()).decode(), "an action")
    except (InputError, UnicodeDecodeError) as error:
        raise Refusal(400, f"an action must be JSON: {error}") from None
    if not isinstance(found, dict):
        raise Refusal(400, "an action must be a JSON object")
    return found


class _Door:
    """This class is one path: it lets a request through by the rule of its method."""

    def __init__(self, path: str, methods: Mapping[str, tuple[Rule, Answer]], roles: Roles) -> None:
        self._path, self._methods, self._roles = path, methods, roles

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        request = Request(scope, receive, send)
        if request.method not in self._methods:
            raise Refusal(405, f"{self._path} takes {' and '.join(self._methods)} alone")
        rule, answer = self._methods[request.method]
        self._check_rule(rule, request)
        await (await answer(request))(scope, receive, send)

    def _check_rule(self, rule: Rule, request: Request) -> None:
        rule.check_length(
            request.headers.get("content-length", ""), request.headers.get("transfer-encoding", "")
        )
        if rule.asker == "any":
            return
        page = page_name(request)
        if rule.asker == "acting" and not self._roles.acts(page):
            raise Refusal(409, "this page looks on: another page acts")


async def _refuse_page(_: Scope, __: Receive, ___: Send) -> None:
    raise Refusal(404, "there is no such page")
