"""A navigation system that sends points, or the pose of its catheter's tip, by OpenIGTLink."""

from __future__ import annotations

import socket
from collections import OrderedDict
from collections.abc import Callable
from threading import Event

import numpy as np

from ...errors import InputError
from ...geometry.similarity import TURN, apply
from ...io.mapping.igtl_received import (
    BadMessage,
    Received,
    ReceivedPoint,
    points_of,
    receive,
    transform_of,
)
from ..messages import TYPES, Message, error
from .source import Desk

PATIENCE = 0.2  # seconds of silence, after which it is asked whether to stop
WAIT = 5.0  # seconds for a connection
REMEMBERED = 1000  # messages whose numbers are kept, to notice repeats


class Igtl:
    """This source listens to the server at a host and port, which sends POINT or TRANSFORM, in RAS. frame: of
    the session's case: places are turned for one in LPS, and as they come for one whose frame is unknown.
    """

    def __init__(self, host: str, port: int, frame: str) -> None:
        self.host, self.port, self.frame = host, port, frame
        self.given: OrderedDict[int, set[ReceivedPoint]] = OrderedDict()

    def follow(self, desk: Desk, stop: Event) -> None:
        """Take every point that comes, and know the tip, until `stop` is set. Raises InputError where the
        connection is lost.
        """
        at = f"{self.host}:{self.port}"
        try:
            connection = socket.create_connection((self.host, self.port), timeout=WAIT)
        except OSError as lost:
            raise InputError(f"{at}: nobody answers: {lost}; start the OpenIGTLink server there") from None
        with connection:
            connection.settimeout(PATIENCE)
            desk.say_source("connected")
            read = _make_reader(connection, stop)
            while not stop.is_set():
                try:
                    self._take_message(receive(read), desk)
                except BadMessage as bad:
                    desk.tell(error(f"{at}: {bad}"))
                except (InputError, OSError) as lost:
                    if not stop.is_set():
                        raise InputError(f"{at}: {lost}") from None

    def _take_message(self, message: Received, desk: Desk) -> None:
        if message.kind == "POINT":
            for point in self._drop_repeats(message, points_of(message), desk):
                desk.act(self._make_action(point))
        elif message.kind == "TRANSFORM":
            desk.say_tip(self._turn_place(tuple(transform_of(message)[:3, 3].tolist())))
        elif message.kind not in ("STATUS", "GET_STATUS", "CAPABILITY"):
            raise BadMessage(f"a message {message.kind} is no POINT and no TRANSFORM, and is left out")

    def _drop_repeats(
        self, message: Received, points: list[ReceivedPoint], desk: Desk
    ) -> list[ReceivedPoint]:
        """Return the points without those that a message of this number has held before; a message without a
        number is one of its own.
        """
        given = self.given.setdefault(message.number, set()) if message.number else set[ReceivedPoint]()
        if len(self.given) > REMEMBERED:
            self.given.popitem(last=False)
        found = []
        for point in points:
            if point in given:
                desk.tell(error(f"the point {point.name or list(point.xyz)} was sent twice: taken once"))
                continue
            given.add(point)
            found.append(point)
        return found

    def _make_action(self, point: ReceivedPoint) -> Message:
        kind = point.group.lower() if point.group.lower() in TYPES else "eam"
        values = {"name": point.name} if point.name else {}
        return {"do": "take", "xyz": self._turn_place(point.xyz), "type": kind, "values": values}

    def _turn_place(self, xyz: tuple[float, ...]) -> list[float]:
        turned: list[float] = apply(TURN if self.frame == "LPS" else np.eye(4), [xyz])[0].tolist()
        return turned


def _make_reader(connection: socket.socket, stop: Event) -> Callable[[int], bytes]:
    """Make a function that reads as many bytes as are asked for; fewer where the connection ends, or it is
    told to stop.
    """

    def read(count: int) -> bytes:
        data = bytearray()
        while len(data) < count and not stop.is_set():
            try:
                more = connection.recv(count - len(data))
            except TimeoutError:
                continue
            if not more:
                break
            data += more
        return bytes(data)

    return read
