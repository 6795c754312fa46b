"""A desk that keeps what sources bring it."""

from __future__ import annotations

import time
from collections.abc import Callable

from o3dls.live.messages import Message, action


class Desk:
    """Keeps actions, what was said of the source, errors and tips."""

    def __init__(self) -> None:
        self.actions: list[Message] = []
        self.said: list[str] = []
        self.errors: list[str] = []
        self.tips: list[list[float] | None] = []

    def act(self, given: Message) -> Message:
        self.actions.append(action(given))
        return {"ok": True, "id": len(self.actions)}

    def say_source(self, text: str) -> None:
        if self.said[-1:] != [text]:
            self.said.append(text)

    def say_tip(self, xyz: list[float] | None) -> None:
        self.tips.append(xyz)

    def tell(self, message: Message) -> None:
        self.errors.append(message["text"])

    @property
    def xs(self) -> list[float]:
        return [one["xyz"][0] for one in self.actions]


def until(true: Callable[[], object], seconds: float = 20.0, told: Callable[[], object] = str) -> None:
    """Wait until something is true; fail with what is `told` where it does not become so."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, f"it did not happen in time: {told()}"
        time.sleep(0.01)
