"""The run that is at work, as every page sees it."""

from __future__ import annotations

from threading import Lock
from time import monotonic
from typing import Any

from .worker import Message

MOST_LINES = 200  # of the log, the newest


class Job:
    """A job is one run of the app: what it makes of which case, how far it is, and how it ended.

    state is running, done, refused or cancelled; version changes with everything that pages should be told.
    """

    def __init__(self, case: str, run: str, command: str) -> None:
        self.case, self.run, self.command = case, run, command
        self.state, self.said, self.version = "running", "", 1
        self._steps, self._done = 0, 0
        self._lines: list[str] = []
        self._begun, self._ended = monotonic(), 0.0
        self._lock = Lock()

    def take(self, message: Message) -> None:
        """Take what the run says of its progress."""
        with self._lock:
            self._steps = message.get("steps", self._steps)
            self._done += bool(message.get("step"))
            if "line" in message:
                self._lines = [*self._lines[1 - MOST_LINES :], message["line"]]
            self.version += 1

    def end(self, found: Message) -> None:
        """Note that the run is whole."""
        faults = found["faults"]
        self._finish(
            "done", f"The result is not valid: {'; '.join(faults)}" if faults else "The run is done."
        )

    def refuse(self, why: str) -> None:
        """Note why there is no run."""
        self._finish("refused", why)

    def cancel(self) -> None:
        """Note that somebody ends the run."""
        self._finish("cancelled", "The run was cancelled; only its log is left.")

    def lose(self) -> None:
        """Note that the process was ended, unless by somebody who cancelled it."""
        if self.state == "running":
            self._finish(
                "refused", "Its process was killed from outside: is there too little memory? Run it again."
            )

    def record(self) -> dict[str, Any]:
        """Return the job as plain values."""
        with self._lock:
            return {
                "case": self.case,
                "run": self.run,
                "command": self.command,
                "state": self.state,
                "said": self.said,
                "steps": self._steps,
                "done": min(self._done, self._steps),
                "lines": list(self._lines),
                "seconds": round((self._ended or monotonic()) - self._begun),
            }

    def _finish(self, state: str, said: str) -> None:
        with self._lock:
            if self.state == "running":
                self.state, self.said, self._ended = state, said, monotonic()
                self.version += 1
