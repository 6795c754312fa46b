"""Commands that serve pages: live, a session in which points come one by one; and app, which leads from two
files to a judged surface.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from threading import Event
from time import sleep
from typing import TYPE_CHECKING, Any, NoReturn

import click

from .options import as_json, limits
from .words import DONE, FILE, FOLDER, NOT_VALID, complain, say, say_json

if TYPE_CHECKING:
    from ..live.finish import Finished
    from ..live.host import Host
    from ..live.sources.source import Source

LINK = "o3dls_app_link.html"  # in the folder while the app runs, so that the token is in no list of processes
SOURCES = ("watch", "igtl", "replay")
LOOK = 0.2  # seconds between two checks for the session's end; signals are handled in between
Message = dict[str, Any]


@click.command()
@click.argument("case", type=FOLDER, required=False)
@click.option("--watch", type=FILE, help="take points from this CSV file or export folder, which grows")
@click.option("--igtl", metavar="HOST:PORT", help="take points from this OpenIGTLink server")
@click.option("--replay", type=FILE, help="take the points of this CSV file, as if they came now")
@click.option("--rate", type=click.FloatRange(0.0, 1000.0, min_open=True), help="points a second of --replay")
@click.option("--record", type=FOLDER, help="folder of the journal; one with a journal is gone on from")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="of the page; 0: any that is free")
@click.option("--no-browser", is_flag=True, help="do not open the page")
@click.option("--headless", is_flag=True, help="no page: actions are lines of JSON on stdin")
@as_json
def live(
    case: Path | None,
    record: Path | None,
    port: int,
    no_browser: bool,
    headless: bool,
    as_json: bool,
    **given: Any,
) -> int:
    """Take points one by one; a page shows how the surface of CASE follows them.

    At the end of the session its case folder and the run of the default pipeline on it are in the record
    folder. With --json the session's events are printed, one a line.
    """
    from ..live.host import Host
    from ..live.record import default_record, open_record
    from ..live.sources.stdin import serve_stdin

    _check_options(given)
    if case is None and record is None:
        raise click.UsageError("no CASE given, and no --record folder to go on from")
    record = record or default_record()
    journal, session = open_record(record, case)
    if journal.cut:
        complain(journal.cut)
    tellers: list[Callable[[Message], None]] = [_print_event if as_json else _print_error]

    def tell(message: Message) -> None:
        for one in tellers:
            one(message)

    host = Host(journal, session, tell)
    stop = Event()
    try:
        source = _make_source(given, host)
        with (
            _serve_page(host, tellers, port, opened=None if no_browser else record)
            if not headless
            else serve_stdin(host, alone=source is None)
        ):
            host.begin()
            _wait_for_end(host, source, stop, ends=headless and given["replay"] is not None)
            return _finish_session(host, record, as_json=as_json)
    finally:
        stop.set()
        host.close()


def _check_options(given: Message) -> None:
    named = [f"--{name}" for name in SOURCES if given[name] is not None]
    if len(named) > 1:
        raise click.UsageError(f"{' and '.join(named)}: a session has one source of points")
    if given["rate"] is not None and given["replay"] is None:
        raise click.UsageError("--rate: is of --replay, which is not given")
    for name in ("watch", "replay"):  # checked here, before a record folder is made
        if given[name] is not None and not given[name].exists():
            raise click.UsageError(f"--{name} {given[name]}: no such file")
    if given["replay"] is not None:
        from ..live.sources.replay import Replay

        Replay(given["replay"], given["rate"])
    if given["igtl"] is not None:
        _read_address(given["igtl"])


def _read_address(given: str) -> tuple[str, int]:
    """Read host and port."""
    name, _, port = given.rpartition(":")
    if not name or not port.isdecimal() or not 0 < int(port) < 65536:
        raise click.UsageError(f"--igtl {given}: must be HOST:PORT, such as localhost:18944")
    return name, int(port)


def _make_source(given: Message, host: Host) -> Source | None:
    """Make the source that the options name, without what an earlier part of the session has taken."""
    frame = host.session.prior.frame
    if given["igtl"] is not None:
        from ..live.sources.igtl import Igtl

        return Igtl(*_read_address(given["igtl"]), frame)
    from ..live.sources.source import identities

    before = identities(host.journal.actions)
    if given["watch"] is not None:
        from ..live.sources.watch import Watch

        return Watch(given["watch"], frame, before)
    if given["replay"] is not None:
        from ..live.sources.replay import Replay

        return Replay(given["replay"], given["rate"], before)
    return None


@contextmanager
def _serve_page(
    host: Host, tellers: list[Callable[[Message], None]], port: int, *, opened: Path | None
) -> Iterator[None]:
    """Serve the page while the block runs, and then until nobody reads the report there any more. opened: the
    folder of the file by which a browser is led to the page, where it shall be opened.
    """
    from ..live.server import LiveServer
    from ..web.link import led_to

    server = LiveServer(host.act, port=port)
    tellers.append(server.publish)
    try:
        say(server.url, error=True)
        with led_to(server.url, opened) if opened else nullcontext() as leads:
            if leads:
                click.launch(str(leads))
            yield
            server.wait()
    finally:
        server.close()


def _wait_for_end(host: Host, source: Source | None, stop: Event, *, ends: bool) -> None:
    """Follow the source until the session has ended; where it `ends` with its source, it is ended then."""
    from ..live.sources.source import begin

    done = Event()
    if source is not None:
        begin(source, host, stop, done)
    while not host.ended.wait(LOOK):
        if ends and done.is_set():
            done.clear()
            host.act({"do": "end"})
    stop.set()


def _finish_session(host: Host, record: Path, *, as_json: bool) -> int:
    """Finish the session, and say what it leaves."""
    from ..errors import O3dlsError
    from ..live.finish import finish, telling
    from ..live.messages import error, event

    try:
        with telling(lambda text: host.tell(event("progress", text=text))):
            found = finish(record, host.session, host.last)
    except O3dlsError as refused:
        host.tell(error(f"the session has ended without a run: {refused}"))
        raise
    host.tell(
        {
            "event": "end",
            "run": str(found.out),
            "case": str(found.case),
            "from_motion_mm": found.from_motion,
            "from_final_mm": found.from_final,
        }
    )
    if not as_json:
        say(_describe_run(found))
    return NOT_VALID if found.run.faults else DONE


def _describe_run(found: Finished) -> str:
    apart = (
        f"; the surface shown last lies {found.from_motion:.2f} mm from its motion (mean)"
        if found.from_motion is not None
        else ""
    )
    return f"{found.out}: the run, {found.case}: the case{apart}"


def _print_event(message: Message) -> None:
    say_json(message, line=True)


def _print_error(message: Message) -> None:
    if message["event"] == "error":
        complain(message["text"])


@click.command()
@click.argument("folder", type=FOLDER, default=Path())
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="of the page; 0: any that is free")
@click.option("--no-browser", is_flag=True, help="do not open the page")
@limits
def app(folder: Path, port: int, no_browser: bool, timeout: float | None, memory: float | None) -> NoReturn:
    """Open a page that leads from two files to a judged surface, without a terminal.

    Files that are brought, cases and runs stay in FOLDER, by default the working folder, as the other
    commands know them. The page is served to this machine alone, until Ctrl-C.
    """
    from ..app.desk import Desk
    from ..app.routes import routes_of
    from ..pipeline.supervision import Limits
    from ..web.link import led_to
    from ..web.server import LocalServer
    from .environment import check_libraries

    check_libraries()
    bounds = Limits(timeout, int(memory) if memory else None)
    with (
        closing(Desk(folder, bounds)) as desk,
        closing(LocalServer(routes_of(desk), "app", port)) as server,
        nullcontext() if no_browser else led_to(server.url, folder, LINK) as leads,
    ):
        say(server.url, error=True)
        if leads:
            click.launch(str(leads))
        while True:
            sleep(LOOK)
