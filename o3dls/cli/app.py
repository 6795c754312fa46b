"""The command `app`: pages that lead from two files to a judged surface."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from time import sleep

import click

from .options import limits
from .words import DONE, FOLDER, say

LOOK = 0.5  # seconds between two looks; signals are handled in between


@click.command()
@click.argument("folder", type=FOLDER, default=Path())
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="of the page; 0: any that is free")
@click.option("--no-browser", is_flag=True, help="do not open the page")
@limits
def app(folder: Path, port: int, no_browser: bool, timeout: float | None, memory: float | None) -> int:
    """Open a page that leads from two files to a judged surface, without a terminal.

    Files that are brought, cases and runs stay in FOLDER, by default the working folder, as the other
    commands know them. The page is served to this machine alone, until Ctrl-C.
    """
    from ..app.desk import Desk
    from ..app.routes import most_bytes, routes_of
    from ..pipeline.supervision import Limits
    from ..web.link import led_to
    from ..web.server import LocalServer
    from .environment import check_libraries

    check_libraries()
    desk = Desk(folder, Limits(timeout, int(memory) if memory else None))
    try:
        server = LocalServer(routes_of(desk), "app", most_bytes, port)
        try:
            say(server.url, error=True)
            with nullcontext() if no_browser else led_to(server.url, folder) as leads:
                if leads:
                    click.launch(str(leads))
                while True:
                    sleep(LOOK)
        finally:
            desk.closing = True
            server.close()
    finally:
        desk.close()
    return DONE
