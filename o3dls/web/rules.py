"""Whom our servers answer: requests that were meant for this server, come from its own page, and have its
token. Every server of ours asks these functions before anything else, and then the rule of the route.

A link with the token opens the page and leaves the token as a cookie that scripts cannot read and that no
other site's request carries. Host and Origin must be ours: a name turned to this machine gets nothing.
"""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Literal

NAMES = ("127.0.0.1", "localhost")
PATIENCE = 10.0  # seconds that a page may take to ask or to read
LONGEST = 20  # digits of a length; Python reads a number of at most 4300
NAME = 64  # letters of a page's name, at most
READS = ("GET", "HEAD")  # methods whose body is not read
HEADERS = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class Refusal(Exception):
    """A refusal says why a request does not get what it asked for: status and one sentence."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = status


@dataclass(frozen=True)
class Rule:
    """A rule says of one method on one path which pages may ask, and how much they may send.

    path: as Starlette writes it; most: bytes that a body may have; asker: any page, one that names itself, or
    the one that acts (`roles`).
    """

    method: str
    path: str
    most: int = 0
    asker: Literal["any", "named", "acting"] = "any"

    def check_length(self, length: str, encoding: str) -> None:
        """Raise Refusal for a body whose length is not given, or is too large."""
        if self.method in READS and not encoding:
            return
        if not (length.isascii() and length.isdecimal()):
            raise Refusal(411, "a body must say its length")
        if len(length) > LONGEST or int(length) > self.most:
            raise Refusal(413, f"what is sent here may have {self.most} bytes")


def check_page_name(page: str) -> str:
    """Return the name that a page gave itself. Raises Refusal where it is none."""
    if not (page.isascii() and page.isalnum() and len(page) <= NAME):
        raise Refusal(400, "a page must name itself in letters and digits")
    return page


def check_sender(port: int, method: str, host: str, origin: str | None) -> None:
    """Raise Refusal where the request was meant for another server, or comes from another's page."""
    if host not in [f"{name}:{port}" for name in NAMES]:
        raise Refusal(403, "this server answers to its own address alone")
    if origin is None and method != "GET":
        raise Refusal(403, "a request that changes something must say where it comes from (Origin)")
    if origin not in (None, f"http://{host}"):
        raise Refusal(403, "this server answers its own page alone")


def cookie_name(command: str, port: int) -> str:
    """Return a name of its own for each port, since browsers give all ports of a machine the same cookies."""
    return f"o3dls_{command}_{port}"


def cookie_line(command: str, port: int, token: str) -> str:
    """Return the header by which a page leaves the token with the browser."""
    return f"{cookie_name(command, port)}={token}; HttpOnly; SameSite=Strict; Path=/"


def check_token(command: str, port: int, token: str, given: str, cookies: str) -> None:
    """Raise Refusal where neither the link nor the cookies of a request have the token."""
    try:
        known = SimpleCookie(cookies)
    except CookieError:
        known = SimpleCookie()
    name = cookie_name(command, port)
    kept = known[name].value if name in known else ""
    if not any(hmac.compare_digest(one.encode(), token.encode()) for one in (given, kept)):
        raise Refusal(403, f"open the page by the link that o3dls {command} printed: it holds the token")
