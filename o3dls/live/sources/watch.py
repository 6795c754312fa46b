"""A file of points or a folder of an export that grows while a navigation system writes it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from threading import Event

import numpy as np

from ...case import MILLIMETRES, Points
from ...errors import InputError
from ...io.points import points_of, points_table_of, scaled
from ...io.text import read_bytes
from ..messages import error
from ..session import taken
from .source import Desk, identity

POLL = 0.2  # seconds between two looks
MOST_ROWS = 50_000  # a dense map has some thousand; each is looked at whenever the file has changed
LARGEST = 1 << 25  # bytes
STILL = 1.0  # seconds without a change, after which a last line without an end is whole
Seen = bytes | tuple[tuple[str, int, int], ...]


class Watch:
    """This source watches a CSV file, or the one map of an export folder, and takes each point once, whatever
    is written anew or in another order. frame: of the session's case; before: what was taken in an earlier
    session.

    Raises InputError where there is no such file or folder.
    """

    def __init__(self, path: Path, frame: str, before: Iterable[str] = ()) -> None:
        if not path.exists():
            raise InputError(f"{path}: no such file or folder: name the points.csv or the export to watch")
        self.path, self.frame = path, frame
        self.known = set(before)
        self.seen: Seen | None = None
        self.repeats: set[str] = set()

    def follow(self, desk: Desk, stop: Event) -> None:
        """Look again and again until `stop` is set. Raises InputError for what cannot be read: once the file
        has changed it may be.
        """
        before: Seen | None = None
        still = 0.0
        while not stop.is_set():
            now = self._look_at_path()
            still = still + POLL if now == before else 0.0
            before = now
            if now != self.seen and (whole := self._whole_part(now, still)):
                points = self._read_points(whole)
                self.seen = now if whole is now else self.seen
                self._give_points(points, desk, stop)
                desk.say_source("connected")
            elif now == self.seen:
                desk.say_source("connected")
            stop.wait(POLL)

    def _look_at_path(self) -> Seen:
        """Read what is there: the bytes of a file, the names, sizes and times of a folder."""
        try:
            if self.path.is_file():
                return read_bytes(self.path, LARGEST) if self.path.stat().st_size else b""
            files = [(file, file.stat()) for file in sorted(self.path.rglob("*")) if file.is_file()]
            return tuple((str(file), at.st_size, at.st_mtime_ns) for file, at in files)
        except OSError as lost:
            raise InputError(f"{self.path}: cannot be read: {lost.strerror}") from None

    def _whole_part(self, now: Seen, still: float) -> Seen | None:
        """Return the part that is written whole: lines with an end, a folder once it stands still."""
        if isinstance(now, bytes) and not now.endswith(b"\n") and still < STILL:
            return now[: now.rfind(b"\n") + 1]
        return now if isinstance(now, bytes) or still >= STILL else None

    def _read_points(self, whole: Seen) -> Points:
        if not isinstance(whole, bytes):
            return self._read_export()
        if (rows := whole.count(b"\n")) > MOST_ROWS:
            raise InputError(
                f"{self.path}: has {rows} lines: a session takes at most {MOST_ROWS} points; give the points "
                "of one map, or run the case by o3dls run"
            )
        table = points_table_of(whole, self.path)
        self._check_frame(table.notes.get("space", "unknown"))
        unit = table.notes.get("units", "mm")
        if unit not in MILLIMETRES:
            raise InputError(f"{self.path}: states units '{unit}': must be one of {', '.join(MILLIMETRES)}")
        none = Points(np.zeros((0, 3)), np.zeros(0, dtype=str))
        return scaled(points_of(table, 3), MILLIMETRES[unit]) if len(table) else none

    def _read_export(self) -> Points:
        from ...io.mapping.imported import joined
        from ...io.mapping.study import read_study

        found = read_study(self.path)
        self._check_frame(found.space)
        marks = np.array(list(found.landmarks.values())).reshape(-1, 3)
        names = {"name": np.array(list(found.landmarks), dtype=str)}
        named = Points(marks, np.full(len(marks), "landmark"), names)
        return joined(found.points, named) if len(marks) else found.points

    def _check_frame(self, stated: str) -> None:
        if "unknown" not in (stated, self.frame) and stated != self.frame:
            raise InputError(f"{self.path}: states frame {stated}, and the case is in {self.frame}")

    def _give_points(self, points: Points, desk: Desk, stop: Event | None = None) -> None:
        """Give the points that were not given before; a row that is there twice is said once."""
        rows: set[str] = set()
        for one in taken(points):
            if stop is not None and stop.is_set():
                return
            name = identity(one)
            if name in rows and name not in self.repeats:
                self.repeats.add(name)
                desk.tell(error(f"{self.path}: the point {one['xyz']} is there twice: taken once"))
            rows.add(name)
            if name not in self.known:
                desk.act(one)
                self.known.add(name)
