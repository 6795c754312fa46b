"""What a page may ask of a session. Whom it answers at all, the rules of our servers decide before."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, StreamingResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from ..web.routes import Answer, Routes, page_name, read_action
from ..web.rules import Refusal, Rule
from .board import Box, Event, Sent
from .messages import MOST
from .page import live_page
from .pages import Pages

MOST_PAGES = 5  # a browser opens six connections to one server, and an action needs one
BEAT = 1.0  # seconds after which a silent page is sent a sign of life
RETRY = 1000  # ms after which a page that lost its connection comes back


def routes_of(pages: Pages) -> Routes:
    """Return what answers the pages of a session."""
    return (
        (Rule("GET", "/"), _show_page),
        (Rule("GET", "/events", asker="named"), _event_route(pages)),
        (Rule("GET", "/report"), _report_route(pages)),
        (Rule("POST", "/act", MOST, "acting"), _act_route(pages)),
        (Rule("POST", "/role", MOST, "named"), _role_route(pages)),
    )


async def _show_page(_: Request) -> ASGIApp:
    return HTMLResponse(await run_in_threadpool(live_page))


def _report_route(pages: Pages) -> Answer:
    async def answer(_: Request) -> ASGIApp:
        return HTMLResponse(await run_in_threadpool(_read_report, pages.board.last("end")))

    return answer


def _read_report(ended: Event | None) -> str:
    from ..report.browser import page_of

    if not ended or not ended.get("run"):
        raise Refusal(404, "there is no report before the session has ended")
    return page_of(Path(ended["run"])).read_text(encoding="utf-8")


def _act_route(pages: Pages) -> Answer:
    async def answer(request: Request) -> ASGIApp:
        found: dict[str, Any] = await run_in_threadpool(pages.act, await read_action(request))
        return JSONResponse(found, 422 if "error" in found else 200)

    return answer


def _role_route(pages: Pages) -> Answer:
    async def answer(request: Request) -> ASGIApp:
        await read_action(request)
        if not pages.ask_role(page_name(request)):
            raise Refusal(409, "another page acts")
        return JSONResponse({"ok": True})

    return answer


def _event_route(pages: Pages) -> Answer:
    async def answer(request: Request) -> ASGIApp:
        if pages.number >= MOST_PAGES:
            raise Refusal(503, f"{MOST_PAGES} pages are open already: close one")

        async def tell(scope: Scope, receive: Receive, send: Send) -> None:
            with pages.connected(page_name(request), request.headers.get("last-event-id", "")) as box:
                events = StreamingResponse(_write_events(pages, box), media_type="text/event-stream")
                await events(scope, receive, send)

        return tell

    return answer


async def _write_events(pages: Pages, box: Box) -> AsyncIterator[str]:
    """Write what waits, or a sign of life, until the session lets the page go."""
    yield f"retry: {RETRY}\n\n"
    while not box.closed:
        found = await run_in_threadpool(pages.take_box, box, BEAT)
        yield "".join(_write_event(pages.board.name(one), one) for one in found) or ": here\n\n"


def _write_event(name: str, one: Sent) -> str:
    number = f"id: {name}\n" if one.seq else ""
    return f"{number}event: {one.kind}\ndata: {one.text}\n\n"
