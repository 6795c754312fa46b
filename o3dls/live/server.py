"""The server of a session's pages: routes and pages of live, on the server that all our pages have."""

from __future__ import annotations

from ..web.server import LocalServer
from .board import Board, Event
from .pages import Act, Pages
from .routes import routes_of


class LiveServer:
    """This server shows the pages of one session, from when it is made until `close`.

    act: as for `Pages`. Raises InputError where the port is taken.
    """

    def __init__(self, act: Act, port: int = 0) -> None:
        self.pages = Pages(act)
        self._server = LocalServer(routes_of(self.pages), "live", port, self.pages.roles)
        self.port, self.token, self.url = self._server.port, self._server.token, self._server.url

    @property
    def board(self) -> Board:
        """What the pages are told."""
        return self.pages.board

    def publish(self, event: Event) -> None:
        """Send an event to all pages. Returns at once, however slow they are.

        An event is a dict with its kind as `event`; its `seq` is given here. Raises ValueError where a number
        in it is not finite.
        """
        self.pages.board.publish(event)

    def wait(self) -> None:
        """Return once no page is open any more."""
        self.pages.wait()

    def close(self) -> None:
        """Let every page go and stop. A second time does nothing."""
        self.pages.close()
        self._server.close()
