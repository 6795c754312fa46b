"""An earlier map as a source: its points come as they did, at an even rate or by their column `time`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from threading import Event
from time import monotonic

import numpy as np

from ...arrays import Array
from ...columns import TIME
from ...errors import InputError
from ...io.points import read_points
from ..messages import Message
from ..session import taken
from .source import Desk, identity


class Replay:
    """This source replays the points of a file, without those that were taken before. rate: points a second;
    None: by the column `time`, in seconds.

    Raises InputError where the file cannot be read, or has neither.
    """

    def __init__(self, path: Path, rate: float | None, before: Sequence[str] = ()) -> None:
        points = read_points(path)
        times = points.numbers(TIME) if TIME in points.columns else None
        if rate is None and times is None:
            raise InputError(f"{path}: has no column '{TIME}': say --rate, in points a second")
        if times is not None:
            if not np.isfinite(times).all():
                raise InputError(f"{path}: a point has no {TIME}: each must have one, in seconds")
            order = np.argsort(times, kind="stable")
            points, times = points.select(order), times[order]
        there = Counter(before)
        self.path = path
        self.left: list[tuple[float, Message]] = []
        for k, one in enumerate(taken(points)):
            name = identity(one)
            if there[name]:
                there[name] -= 1
            else:
                self.left.append((_due_time(k, rate, times), one))

    def follow(self, desk: Desk, stop: Event) -> None:
        """Give each point when it is due; the first at once."""
        desk.say_source("connected")
        begin = monotonic() - (self.left[0][0] if self.left else 0.0)
        while self.left and not stop.wait(max(0.0, begin + self.left[0][0] - monotonic())):
            desk.act(self.left.pop(0)[1])
        desk.say_source(f"ended: all points of {self.path.name} have come")


def _due_time(k: int, rate: float | None, times: Array | None) -> float:
    if rate is not None:
        return k / rate
    return float(times[k]) if times is not None else 0.0
