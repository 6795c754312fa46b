"""The session in the process of the command: every action is checked, written down, and only then passed on
to the engine, which is begun again where it was killed.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from threading import Event, Lock, Thread
from time import monotonic
from typing import Any

from ..arrays import Array
from ..errors import InputError
from .engine import APART, serve
from .journal import Journal
from .messages import Message, action, error, event
from .session import Session

SOON = 5.0  # seconds: an engine that ends in less, so often one after the other, is not begun again
MOST_ENDS = 5
GRACE = 5.0  # seconds in which an engine that is told to may end


class Host:
    """A host runs a session and takes its actions. tell: called with every event, one at a time; what it
    takes is quick.

    last: vertices (n, 3) of the estimate when the session ended, once `ended` is set; tip: where the
    catheter's tip is now, in the map's frame, where a source knows.
    """

    def __init__(self, journal: Journal, session: Session, tell: Callable[[Message], None]) -> None:
        self.journal, self.session = journal, session
        self.ended, self.ending, self.closing = Event(), False, False
        self.last: Array | None = None
        self.tip: list[float] | None = None
        self._tip_told = -SOON
        self.source = "none: points come from the page"
        self._tell, self._seq = tell, 0
        self._acting, self._telling = Lock(), Lock()
        self._state: Message = {}
        self._engine: Connection | None = None
        self._begun = 0.0
        self._short_lives = 0  # engines in a row that ended within SOON

    def begin(self) -> None:
        """Tell what is known so far, and begin the engine."""
        with self._acting:  # page and stdin may send actions already
            for point in self.session.points.values():
                self.tell(event("point", **point.record(), weight=None, distance=None))
            self._begin_engine()

    def act(self, given: Any) -> Message:
        """Do an action: {"ok": True, "id": the point's number, if it is about one}, or {"error": why not}.

        Once this has answered, the action is on the disk.
        """
        try:
            with self._acting:
                return self._do_action(given)
        except InputError as refused:
            self.tell(error(str(refused)))
            return {"error": str(refused)}

    def say_source(self, text: str) -> None:
        """Say how the source of the points is."""
        if text != self.source:
            self.source = text
            self._tell_state()

    def say_tip(self, xyz: list[float] | None) -> None:
        """Say where the catheter's tip is, not too often; None where nobody knows."""
        self.tip = xyz
        if xyz is None or monotonic() - self._tip_told >= APART:
            self._tip_told = monotonic()
            self.tell(event("tip", xyz=xyz))

    def tell(self, message: Message) -> None:
        """Give an event its number, and tell it."""
        with self._telling:
            self._seq += 1
            self._tell({"seq": self._seq, **message})

    def close(self) -> None:
        """End the engine, and close the journal."""
        with self._acting:
            self.closing = True
            if self._engine is not None:
                with suppress(OSError):
                    self._engine.send(None)
            self.journal.close()

    def _do_action(self, given: Any) -> Message:
        checked = action(given)
        if self.ending or self.closing:
            raise InputError(f"{checked['do']}: the session has ended")
        self.session.check(checked)
        self.journal.append(checked)
        number = self.session.apply(checked)
        if number is not None:
            self.tell(event("point", **self.session.points[number].record(), weight=None, distance=None))
        self._pass_on(checked)
        return {"ok": True} | ({} if number is None else {"id": number})

    def _pass_on(self, checked: Message) -> None:
        self.ending = checked["do"] == "end"
        if self._engine is None:
            if self.ending:
                self.ended.set()
            return
        with suppress(OSError):  # it was killed: the next one begins with the whole session
            self._engine.send(checked)

    def _begin_engine(self) -> None:
        spawn = get_context("spawn")  # fork hangs once numba has used its threads
        ours, theirs = spawn.Pipe()
        process = spawn.Process(target=serve, args=(theirs, self.session))
        process.start()
        theirs.close()
        self._engine = ours
        self._begun = monotonic()
        if self.ending:
            ours.send({"do": "end"})
        Thread(target=self._follow_engine, args=(ours, process), daemon=True).start()

    def _follow_engine(self, engine: Connection, process: Any) -> None:
        """Tell what the engine says, until it ends."""
        try:
            while True:
                self._take_event(engine.recv())
        except (EOFError, OSError):
            process.join(GRACE)
            self._replace_engine(engine)
            engine.close()

    def _take_event(self, message: Message) -> None:
        if message["event"] == "last":
            self.last = message["vertices"]
            self.ended.set()
        elif message["event"] == "state":
            self._state = message
            self._tell_state()
        else:
            self.tell(message)

    def _tell_state(self) -> None:
        if self._state:
            self.tell({**self._state, "source": self.source, "tip": self.tip})

    def _replace_engine(self, engine: Connection) -> None:
        """Begin another engine after one has ended, unless this was asked for."""
        with self._acting:
            if self.closing or self.ended.is_set() or engine is not self._engine:
                return
            self._short_lives = self._short_lives + 1 if monotonic() - self._begun < SOON else 0
            if self._short_lives >= MOST_ENDS:
                self._engine = None
                if self.ending:
                    self.ended.set()
                self.tell(
                    error("the engine ends again and again: points are kept, but fitted only at the end")
                )
                return
            self.tell(error("the engine was killed and is begun again; no point is lost"))
            self._begin_engine()
