"""The engine of a session: a process that owns the estimate. Actions come in, events go out."""

from __future__ import annotations

import signal
from functools import cached_property
from multiprocessing.connection import Connection
from queue import Empty, SimpleQueue
from threading import Thread
from time import monotonic
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import O3dlsError
from ..estimate import Estimate
from .background import Background
from .display import Display, landmarks
from .fitting import Current, FullFit, can_be_fitted, current, prepare
from .messages import Message, error, event, number
from .session import Session
from .standing import Advisor, Standing

APART = 0.08  # seconds between two events `surface` in the mean; after a pause two may come together
TICK = 1.0  # seconds between two events `state` while a fit runs
CLOSED = "closed"


def serve(connection: Connection, session: Session) -> None:
    """Run the engine in this process: actions are received, events sent, until the other end closes."""
    # Ctrl-C reaches all processes of a terminal; only the command answers it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    inbox: SimpleQueue[tuple[str, Any]] = SimpleQueue()
    Thread(target=_receive_actions, args=(connection, inbox), daemon=True).start()
    try:
        with Background(lambda fit: inbox.put(("fit", fit))) as background:
            Engine(session, connection.send, inbox, background).run()
    except (BrokenPipeError, ConnectionResetError):
        pass  # the command was killed; its journal has every point


def _receive_actions(connection: Connection, inbox: SimpleQueue[tuple[str, Any]]) -> None:
    try:
        while (received := connection.recv()) is not None:
            inbox.put(("action", received))
    except (EOFError, OSError):
        pass  # the command was killed
    inbox.put((CLOSED, None))


class Engine:
    """The engine keeps the estimate of a session, and says what becomes of it. send: takes an event; inbox:
    actions, ended fits, advice.
    """

    def __init__(self, session: Session, send: Any, inbox: SimpleQueue[Any], background: Background) -> None:
        self.session, self.send, self.inbox, self.background = session, send, inbox, background
        self.display = Display(session.prior.prior)
        self.standing = Standing()
        self.fit: FullFit | None = None
        self.now: Current | None = None
        self.changed, self.ending = True, False
        self.wanted = False  # whether a full fit was asked for that is not begun
        self.refused: Session | None = None  # the session of the last fit, if that was refused
        self.lost: Session | None = None  # the session of a fit whose process was lost: tried once more
        self.posed: Array | None = None  # the pose shown before there is a fit
        self.unseen, self.next_draw = False, 0.0  # whether pages lack the surface; when it may be sent
        self.unjudged, self.unadvised, self.advising = False, False, False
        self.known = -1.0  # when the state was last sent

    def run(self) -> None:
        """Answer until the other end closes, or the session has ended."""
        self.send(self.display.scene(self.session.case(), None))  # first: all else takes seconds to import
        self.background.start()
        prepare()
        while self.step():
            pass
        if self.ending:
            shown = None if self.now is None else self.now.estimate.surface.vertices
            self.send(event("last", vertices=shown))

    @cached_property
    def advisor(self) -> Advisor:
        """The advisor is made when it is first asked, since nobody waits for it."""
        return Advisor(self.session.prior.prior)

    def step(self) -> bool:
        """Take in what has come, and do what is due; return False once there is no more to do."""
        if not self._take_messages(self._seconds_to_wait()):
            return False
        if self.background.held_until is not None and monotonic() >= self.background.held_until:
            self.background.go_on()
        if self.changed:
            self._update_estimate()
        self._draw_surface()
        if self.inbox.empty():
            self._begin_fit()
            self._choose_places()
        if self.background.seconds is not None and monotonic() - self.known > TICK:
            self._send_state()
        return not self.ending

    def _seconds_to_wait(self) -> float | None:
        """Return seconds until something is due; None where only a message can make a difference."""
        if self.changed or self.unjudged:
            return 0.0
        due = [] if self.background.held_until is None else [self.background.held_until]
        if self.unseen:
            due.append(self.next_draw)
        if self.background.seconds is not None:
            due.append(self.known + TICK)
        return max(0.0, min(due) - monotonic()) if due else None

    def _take_messages(self, seconds: float | None) -> bool:
        """Take in what has come, and wait for it for so many seconds; return False where the other end has
        closed.
        """
        try:
            kind, what = self.inbox.get(timeout=seconds) if seconds != 0.0 else self.inbox.get_nowait()
            while True:
                if kind == CLOSED:
                    return False
                self._take_message(kind, what)
                kind, what = self.inbox.get_nowait()
        except Empty:
            return True

    def _take_message(self, kind: str, what: Any) -> None:
        if kind == "action":
            self.background.make_way()
            self.ending = what["do"] == "end"
            self.wanted = self.wanted or what["do"] == "fit"
            self.session.apply(what)
            self.changed = True
        elif kind == "fit":
            self._take_fit(what)
        else:
            self.advising = False
            self.standing.advice = what
            self._send_state()

    def _take_fit(self, fit: FullFit) -> None:
        """Take over a full fit that has ended: what came meanwhile is put in by the next update."""
        self.background.taken()
        self.changed = True
        if fit.lost and self.lost != fit.session:
            self.lost = fit.session
        elif fit.estimate is None:
            self.refused, self.standing.refusal = fit.session, f"the full fit was refused: {fit.refused}"
        else:
            self.fit, self.refused, self.standing.refusal = fit, None, ""
            self.standing.known = len(fit.session.kept)

    def _update_estimate(self) -> None:
        self.changed = False
        self.standing.points = len(self.session.kept)
        if self.fit is not None:
            first = self.now is None
            try:
                self.now = current(self.fit, self.session)
            except O3dlsError as failed:
                self.send(error(f"the estimate stays as it was: {failed}"))
            if first and self.now is not None:
                self.send(self.display.scene(self.now.case, self.now.estimate))
        else:
            self._show_pose()
        self.unseen = self.now is not None
        if self.now is None:
            self._send_state()

    def _show_pose(self) -> None:
        """Show the prior in the pose that landmarks or the case give, if it is new, before there is a fit."""
        start = _place_prior(self.session)
        if start is None or (self.posed is not None and np.array_equal(start.T_map_prior, self.posed)):
            return
        self.posed, self.standing.status = start.T_map_prior, start.status
        self.standing.judge_landmarks(self.session.case())
        self.send(self.display.scene(self.session.case(), start))

    def _draw_surface(self) -> None:
        """Send the surface, not too often; where no point waits, what is known of the points, and where it
        stands.
        """
        now = self.now
        if now is None:
            return
        if self.unseen and monotonic() >= self.next_draw:
            self.unseen, self.unjudged = False, True
            self.next_draw = max(self.next_draw + APART, monotonic())
            last = max(self.session.points, default=0)
            marks = landmarks(self.session.case(), now.estimate)  # also those that no fit knows yet
            self.send(self.display.surface(now.case, now.estimate, last) | {"landmarks": marks})
        if self.unjudged and self.inbox.empty():
            self.unjudged, self.unadvised = False, True
            self.send(_weights_event(now))
            self.standing.judge(now.case, now.estimate, len(now.fitted))
            self.standing.judge_landmarks(self.session.case())
            self._send_state()

    def _begin_fit(self) -> None:
        """Begin a full fit where one is due, none runs, and the last was not refused of the same points."""
        due = self.now is None or self.now.outdated or self.wanted
        same = self.refused is not None and self.refused == self.session and not self.wanted
        if due and not same and self.background.seconds is None and can_be_fitted(self.session):
            self.wanted = False
            self.background.begin(self.session)
            self._send_state()

    def _choose_places(self) -> None:
        """Choose the places to touch next, beside what else is done."""
        if not self.unadvised or self.advising or self.now is None:
            return
        self.unadvised, self.advising = False, True
        now = self.now
        Thread(
            target=lambda: self.inbox.put(("advice", self.advisor(now.case, now.estimate))), daemon=True
        ).start()

    def _send_state(self) -> None:
        self.known = monotonic()
        seconds = self.background.seconds
        self.standing.fit = "idle" if seconds is None else "running" if seconds < 1 else f"{seconds:.0f} s"
        self.send(event("state", **self.standing.record()))


def _place_prior(session: Session) -> Estimate | None:
    """Place the prior in the pose that landmarks or the case give; None where they give none."""
    from ..pipeline.start import start_estimate
    from ..registration.landmarks import fix_a_pose

    case = session.case()
    known = case.init is not None or fix_a_pose(*case.landmark_pairs()[1:])
    return start_estimate(case) if known else None


def _weights_event(now: Current) -> Message:
    """Make the event that gives each mapping point's number, probability of contact and distance from the
    surface.
    """
    eam = now.case.points.of("eam")
    fit = now.estimate.fit
    if fit is None or now.estimate.weights is None or not len(eam):
        return event("weights", ids=[], weights=[], distances=[])
    distances = np.sqrt(fit.problem.tree.at(now.estimate.surface.vertices).query(eam.xyz)[0])
    return event(
        "weights",
        ids=[int(one) for one in eam.columns["id"].tolist()],
        weights=[number(round(one, 3)) for one in now.estimate.weights.tolist()],
        distances=[round(one, 3) for one in distances.tolist()],
    )
