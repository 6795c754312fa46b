"""The command `app`: pages that lead from two files to a judged surface."""

from __future__ import annotations

from contextlib import closing, nullcontext
from pathlib import Path
from time import sleep
from typing import NoReturn

import click

from .options import limits
from .words import FOLDER, say

LINK = "o3dls_app_link.html"  # in the folder while the app runs, so that the token is in no list of processes
LOOK = 0.5  # seconds between two looks; signals are handled in between


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
    from ..app.routes import most_bytes, routes_of
    from ..pipeline.supervision import Limits
    from ..web.link import led_to
    from ..web.server import LocalServer
    from .environment import check_libraries

    check_libraries()
    bounds = Limits(timeout, int(memory) if memory else None)
    with (
        closing(Desk(folder, bounds)) as desk,
        closing(LocalServer(routes_of(desk), "app", most_bytes, port)) as server,
        nullcontext() if no_browser else led_to(server.url, folder, LINK) as leads,
    ):
        say(server.url, error=True)
        if leads:
            click.launch(str(leads))
        while True:
            sleep(LOOK)
