"""What a source of points talks to, and the loop that keeps one going."""

from __future__ import annotations

import json
from collections.abc import Iterable
from threading import Event, Thread
from typing import Protocol

from ...errors import InputError
from ..messages import Message, action, error

AGAIN = 1.0  # seconds after which a source that was lost is tried again


class Desk(Protocol):
    """A desk takes points, and where the catheter's tip is, in the frame of the map."""

    def act(self, given: Message) -> Message: ...

    def say_source(self, text: str) -> None: ...

    def say_tip(self, xyz: list[float] | None) -> None: ...

    def tell(self, message: Message) -> None: ...


class Source(Protocol):
    """A source delivers points. Raises InputError, in words, where it is lost."""

    def follow(self, desk: Desk, stop: Event) -> None:
        """Give points to the desk until `stop` is set, or there are no more."""


def identity(given: Message) -> str:
    """Return a key that tells whether a point was taken before: all that the source says of it."""
    kept = {key: value for key, value in action(given).items() if key not in ("seq", "time")}
    return json.dumps(kept, sort_keys=True)


def identities(actions: Iterable[Message]) -> list[str]:
    """Return the identities of the points and landmarks among the actions of a journal."""
    bare = ({k: v for k, v in one.items() if k not in ("seq", "time")} for one in actions)
    return [identity(one) for one in bare if one["do"] in ("take", "landmark") and "next" not in one]


def begin(source: Source, desk: Desk, stop: Event, done: Event) -> Thread:
    """Follow a source in a thread of its own, again and again where it is lost; `done` is set once it has no
    more.
    """
    thread = Thread(target=_keep_following, args=(source, desk, stop, done), daemon=True)
    thread.start()
    return thread


def _keep_following(source: Source, desk: Desk, stop: Event, done: Event) -> None:
    said = ""
    while not stop.is_set():
        try:
            source.follow(desk, stop)
            done.set()
            return
        except InputError as lost:
            desk.say_tip(None)
            if str(lost) != said:
                said = str(lost)
                desk.tell(error(said))
            desk.say_source(f"hung up: {lost}")
        stop.wait(AGAIN)
