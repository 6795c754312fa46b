"""What a page may ask of the app. Whom it answers at all, the rules of our servers decide before."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response, StreamingResponse

from ..errors import InputError
from ..io.text import LARGEST_FILE
from ..places import temporary_name
from ..web.routes import Answer, Routes, read_action
from ..web.rules import Rule
from .desk import Desk
from .uploads import keep_file

MOST = 100_000  # bytes of an action
LOOK = 0.15  # seconds between two looks at the run
BEAT = 15.0  # seconds after which a silent page is sent a sign of life
# a report may have come with a run folder of others: what it runs has no origin, and may ask us nothing
APART = {"Content-Security-Policy": "sandbox allow-scripts allow-downloads allow-popups"}
Act = Callable[[dict[str, Any]], Any]


def routes_of(desk: Desk) -> Routes:
    """Return what answers the pages of a desk."""
    pages = {"/case": desk.case, "/run": desk.run, "/cohort": desk.cohort}
    acts: dict[str, Act] = {
        "/look": desk.look,
        "/unpack": desk.unpack,
        "/make": desk.make,
        "/fit": desk.fit,
        "/pose": desk.pose,
        "/place": desk.place,
        "/fuse": desk.fuse,
        "/cancel": lambda _: desk.cancel(),
        "/export": desk.take,
        "/live": desk.live,
    }
    return (
        (Rule("GET", "/"), _page_route(lambda _: desk.home())),
        *((Rule("GET", path), _page_route(make)) for path, make in pages.items()),
        (Rule("GET", "/compare"), _compare_route(desk)),
        # of a run, where the links of a comparison lead
        (Rule("GET", "/{run:path}/report.html"), _report_route(desk)),
        (Rule("GET", "/grade"), _line_route(desk.grade)),
        (Rule("GET", "/glance"), _line_route(desk.glance)),
        (Rule("GET", "/export"), _file_route(desk)),
        (Rule("GET", "/events"), _event_route(desk)),
        # a file has the bound of every file that is read
        (Rule("PUT", "/files/{name}", LARGEST_FILE), _upload_route(desk)),
        *((Rule("POST", path, MOST), _act_route(act)) for path, act in acts.items()),
    )


def _read_folder(request: Request) -> str:
    return request.query_params.get("folder", "")


def _page_route(make: Callable[[str], str]) -> Answer:
    async def answer(request: Request) -> Response:
        return HTMLResponse(await run_in_threadpool(make, _read_folder(request)))

    return answer


def _compare_route(desk: Desk) -> Answer:
    async def answer(request: Request) -> Response:
        return HTMLResponse(await run_in_threadpool(desk.compare, request.query_params.getlist("run")))

    return answer


def _report_route(desk: Desk) -> Answer:
    async def answer(request: Request) -> Response:
        page = await run_in_threadpool(desk.report, request.path_params["run"])
        return HTMLResponse(page, headers=APART)

    return answer


def _line_route(told: Callable[[str], Any]) -> Answer:
    async def answer(request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(told, _read_folder(request)))

    return answer


def _file_route(desk: Desk) -> Answer:
    async def answer(request: Request) -> Response:
        path = await run_in_threadpool(desk.export, request.query_params.get("file", ""))
        return FileResponse(path, filename=path.name)

    return answer


def _act_route(act: Act) -> Answer:
    async def answer(request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(act, await read_action(request)))

    return answer


def _upload_route(desk: Desk) -> Answer:
    async def answer(request: Request) -> Response:
        wanted = desk.shelf.new_file(request.path_params["name"])
        staged = temporary_name(wanted)
        try:
            with staged.open("xb") as file:
                async for piece in request.stream():
                    await run_in_threadpool(file.write, piece)
            path = await run_in_threadpool(keep_file, staged, desk.shelf, request.path_params["name"])
        except OSError as error:
            raise InputError(f"{wanted.name}: cannot be kept: {error.strerror}") from error
        finally:
            staged.unlink(missing_ok=True)
        return JSONResponse({"file": path})

    return answer


def _event_route(desk: Desk) -> Answer:
    async def events() -> AsyncIterator[str]:
        told, silent = None, 0.0
        while True:
            job = desk.job
            now = (id(job), job.version) if job else None
            if job is not None and now != told:
                told, silent = now, 0.0
                yield f"event: job\ndata: {json.dumps(job.record())}\n\n"
            elif silent >= BEAT:
                silent = 0.0
                yield ": here\n\n"
            await asyncio.sleep(LOOK)
            silent += LOOK

    async def answer(_: Request) -> Response:
        return StreamingResponse(events(), media_type="text/event-stream")

    return answer
