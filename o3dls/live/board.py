"""What pages are told: events in order, the newest state for who comes late, and a bounded box for each."""

from __future__ import annotations

import json
import secrets
from collections import deque
from dataclasses import dataclass, field
from threading import Condition, Lock
from typing import Any

Event = dict[str, Any]
KEPT = 512  # events that a page which was away may catch up with one by one
WAITING = 256  # events that a page may be behind; a slower one is told the newest state instead
WHOLE = (
    "scene",
    "surface",
    "state",
    "tip",
    "role",
)  # of these the newest says all: those before it need not be sent


@dataclass(frozen=True)
class Sent:
    """A sent event is one as text, with its number, 0 for what is said to one page alone."""

    seq: int
    kind: str
    text: str


@dataclass(eq=False)
class Box:
    """A box holds the events that wait for one page. Nobody who puts one in ever waits."""

    waiting: deque[Sent] = field(default_factory=deque)
    overrun: bool = False
    closed: bool = False
    changed: Condition = field(default_factory=Condition)

    def put(self, one: Sent) -> None:
        with self.changed:
            if one.kind in WHOLE:
                self.waiting = deque(other for other in self.waiting if other.kind != one.kind)
            self.waiting.append(one)
            if len(self.waiting) > WAITING:
                self.waiting.clear()
                self.overrun = True
            self.changed.notify()

    def close(self) -> None:
        with self.changed:
            self.closed = True
            self.changed.notify()

    def take(self, seconds: float) -> tuple[list[Sent], bool]:
        """Take all that waits, after at most so many seconds, and say whether more was thrown away."""
        with self.changed:
            self.changed.wait_for(lambda: self.waiting or self.overrun or self.closed, seconds)
            found, overrun = list(self.waiting), self.overrun
            self.waiting.clear()
            self.overrun = False
            return found, overrun


class Board:
    """The board holds the session as pages know it. Safe to use from several threads."""

    def __init__(self) -> None:
        self.session = secrets.token_hex(4)  # each session numbers its events from 1
        self._lock = Lock()
        self._seq = 0
        self._log: deque[Sent] = deque()  # all events but those of the kinds in WHOLE
        self._forgotten = 0  # number of the last event that the log has dropped
        self._newest: dict[str, Sent] = {}  # the newest event of each kind in WHOLE, and `end`
        self._points: dict[int, Event] = {}
        self._boxes: list[Box] = []

    def publish(self, event: Event) -> None:
        """Number an event, remember what it changes, and put it into the box of every page."""
        with self._lock:
            self._seq += 1
            kind = event["event"]
            sent = Sent(self._seq, kind, _write_json({**event, "seq": self._seq}))
            self._remember_event(kind, event, sent)
            for box in self._boxes:
                box.put(sent)

    def join(self, last: str = "") -> Box:
        """Make a box for one page more, which begins with what it missed since the event `last`, else with
        the newest of everything.
        """
        box = Box()
        with self._lock:
            for one in self._events_since(last):
                box.waiting.append(one)  # not by `put`, which drops events when there are many
            self._boxes.append(box)
        return box

    def leave(self, box: Box) -> None:
        with self._lock:
            self._boxes.remove(box)

    def newest(self) -> list[Sent]:
        """Return the newest of everything, in the order in which a page needs it."""
        with self._lock:
            return self._take_snapshot()

    def last(self, kind: str) -> Event | None:
        """Return the newest event of a kind that says all of something; None before there is one."""
        with self._lock:
            found = self._newest.get(kind)
            return None if found is None else json.loads(found.text)

    def name(self, sent: Sent) -> str:
        """Return the name of an event over sessions, which a page gives when it comes back."""
        return f"{self.session}-{sent.seq}"

    def _events_since(self, last: str) -> list[Sent]:
        session, _, number = last.rpartition("-")
        seen = int(number) if session == self.session and number.isdecimal() else None
        if seen is None or not self._forgotten <= seen <= self._seq:
            return self._take_snapshot()
        newest = [one for kind, one in self._newest.items() if kind in WHOLE]
        return sorted((one for one in [*self._log, *newest] if one.seq > seen), key=lambda one: one.seq)

    def _take_snapshot(self) -> list[Sent]:
        newest = self._newest
        points = Sent(self._seq, "points", _write_json(self._all_points()))
        found = [newest.get("scene"), newest.get("surface"), points, newest.get("state"), newest.get("tip")]
        return [one for one in [*found, newest.get("end")] if one is not None]

    def _all_points(self) -> Event:
        return {"event": "points", "seq": self._seq, "points": list(self._points.values())}

    def _remember_event(self, kind: str, event: Event, sent: Sent) -> None:
        if kind in (*WHOLE, "end"):
            self._newest[kind] = sent
        if kind not in WHOLE:
            self._log.append(sent)
            if len(self._log) > KEPT:
                self._forgotten = self._log.popleft().seq
        if kind == "scene":
            self._newest.pop("surface", None)  # that surface belonged to the scene before
        elif kind == "point":
            _update_point(self._points, event)
        elif kind == "weights":
            for name, weight, distance in zip(
                event["ids"], event["weights"], event["distances"], strict=True
            ):
                if name in self._points:
                    self._points[name] |= {"weight": weight, "distance": distance}


def _update_point(points: dict[int, Event], given: Event) -> None:
    """Put what is new of a point over what was known of it; one that was taken back is gone."""
    if given.get("undone"):
        points.pop(given["id"], None)
        return
    content = {key: value for key, value in given.items() if key not in ("event", "seq")}
    points[given["id"]] = points.get(given["id"], {}) | content


def _write_json(event: Event) -> str:
    """Write one line of JSON. Raises ValueError where a number is not finite: browsers would not read it."""
    return json.dumps(event, allow_nan=False, separators=(",", ":"))
