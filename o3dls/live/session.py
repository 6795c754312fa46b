"""What a session knows: the actions of its journal, folded into a case. Same journal, same case."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..case import Case, Points, no_points
from ..errors import InputError
from .messages import Message

LANDMARK = "landmark"


@dataclass(frozen=True)
class Point:
    """A point was taken in the session; undone points keep their number. name: of the landmark that it is."""

    id: int
    xyz: tuple[float, float, float]
    type: str
    values: Mapping[str, float | str]
    name: str = ""
    undone: bool = False

    def record(self) -> Message:
        """Return the point as events show it."""
        values = dict(self.values) | ({"name": self.name} if self.name else {})
        undone = {"undone": True} if self.undone else {}
        return {"id": self.id, "xyz": list(self.xyz), "type": self.type, "values": values, **undone}


@dataclass
class Session:
    """A session is a case that grows. prior: the case without points, landmarks and pose; points by number;
    landmarks of the map and of the prior by name; waiting: the landmark that the next point is.
    """

    prior: Case
    points: dict[int, Point] = field(default_factory=dict)
    landmarks: dict[str, list[float]] = field(default_factory=dict)
    prior_landmarks: dict[str, list[float]] = field(default_factory=dict)
    pose: list[list[float]] | None = None
    waiting: str = ""

    def check(self, action: Message) -> None:
        """Raise InputError for an action that cannot be done now: what, and why."""
        kind = action["do"]
        if kind == "undo" and "point" not in action and self._last_point() is None:
            raise InputError("undo: there is no point that was not undone")
        if kind == "take" and action.get("type") == LANDMARK:
            raise InputError("take: a landmark is placed by the action 'landmark'")
        if "point" not in action:
            return
        point = self.points.get(action["point"])
        if point is None:
            raise InputError(f"{kind}: no point {action['point']}: there are 1 to {len(self.points)}")
        if point.undone:
            raise InputError(f"{kind}: point {point.id} was undone")
        if kind == "label" and point.type == LANDMARK and "name" in action["values"]:
            raise InputError(f"label: point {point.id} is the landmark {point.name}: retype it first")

    def apply(self, action: Message) -> int | None:
        """Take in a checked action, and return the number of the point that it is about, if any."""
        kind = action["do"]
        if kind == "take":
            return self._take_point(action)
        if kind in ("undo", "retype", "label"):
            return self._change_point(action)
        if kind == "landmark" and "xyz" in action:
            self._forget_landmark(action["name"])
            self.landmarks[action["name"]] = action["xyz"]
        elif kind == "landmark":
            self.waiting = action["name"]
        elif kind == "prior_landmark":
            self.prior_landmarks[action["name"]] = action["xyz"]
        elif kind == "pose":
            self.pose = action["matrix"]
        return None

    def _take_point(self, action: Message) -> int:
        number, name = len(self.points) + 1, self.waiting
        if name:
            self._forget_landmark(name)
        kind, self.waiting = (LANDMARK if name else action["type"]), ""
        self.points[number] = Point(number, tuple(action["xyz"]), kind, action["values"], name)
        return number

    def _change_point(self, action: Message) -> int:
        last = action["point"] if "point" in action else self._last_point()
        point = self.points[last or 0]
        if action["do"] == "undo":
            point = replace(point, undone=True)
        elif action["do"] == "retype":
            point = replace(point, type=action["type"], name="")
        else:
            point = replace(point, values={**point.values, **action["values"]})
        self.points[point.id] = point
        return point.id

    def _last_point(self) -> int | None:
        return next((number for number in reversed(self.points) if not self.points[number].undone), None)

    def _forget_landmark(self, name: str) -> None:
        """Undo the earlier place of a landmark of the map, which is placed anew."""
        self.landmarks.pop(name, None)
        for number, point in self.points.items():
            if point.type == LANDMARK and point.name == name and not point.undone:
                self.points[number] = replace(point, undone=True)

    @property
    def kept(self) -> list[Point]:
        """The points that count, in the order in which they came."""
        return [point for point in self.points.values() if not point.undone and point.type != "outlier"]

    def copy(self) -> Session:
        """Return the session as it is now, which further actions do not change."""
        return replace(
            self,
            points=dict(self.points),
            landmarks=dict(self.landmarks),
            prior_landmarks=dict(self.prior_landmarks),
        )

    def case(self) -> Case:
        """Return the case as it stands, with a column `id` of the points' numbers. Outliers are in the
        journal alone.
        """
        return replace(
            self.prior,
            points=self._make_points(),
            prior_landmarks={name: np.array(at) for name, at in self.prior_landmarks.items()},
            init=None if self.pose is None else np.array(self.pose),
        )

    def _make_points(self) -> Points:
        kept = self.kept
        marks = list(self.landmarks.items())
        xyz = np.array([*(point.xyz for point in kept), *(at for _, at in marks)]).reshape(-1, 3)
        kinds = np.array([point.type for point in kept] + [LANDMARK] * len(marks), dtype=str)
        names = [str(point.name or point.values.get("name", "")) for point in kept]
        rest: list[Mapping[str, Any]] = [{}] * len(marks)
        values = [*(point.values for point in kept), *rest]
        columns: dict[str, NDArray[Any]] = {
            "id": np.array([str(point.id) for point in kept] + [""] * len(marks), dtype=str)
        }
        names += [name for name, _ in marks]
        columns |= {"name": np.array(names, dtype=str)} if any(names) else {}
        keys = dict.fromkeys(key for one in values for key in one if key != "name")
        columns |= {key: _make_column([one.get(key) for one in values]) for key in keys}
        order = np.array([float(point.id) for point in kept] + [0.0] * len(marks))
        return Points(xyz, kinds, columns, order)


def _make_column(values: list[float | str | None]) -> NDArray[Any]:
    """Make a column of numbers, NaN where there is none; of texts where one is a text."""
    if any(isinstance(value, str) for value in values):
        return np.array(["" if value is None else str(value) for value in values], dtype=str)
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def empty(case: Case) -> Case:
    """Return the case without what a session's journal holds of it: points, landmarks, pose; and without
    truth, whose rows are of other points.
    """
    none = no_points(case.dimension)
    return replace(case, points=none, prior_landmarks={}, init=None, truth=None, files={})


def actions_of(case: Case) -> Iterator[Message]:
    """Yield the actions that the files of a case stand for, in their order."""
    if case.init is not None:
        yield {"do": "pose", "matrix": case.init.tolist()}
    for name, at in case.prior_landmarks.items():
        yield {"do": "prior_landmark", "name": str(name), "xyz": np.asarray(at).tolist()}
    yield from taken(case.points)


def taken(points: Points) -> Iterator[Message]:
    """Yield the actions by which points come, in their order: those of type landmark as landmarks."""
    for k, (xyz, kind) in enumerate(zip(points.xyz.tolist(), points.type.tolist(), strict=True)):
        values = {
            "source_id" if name == "id" else name: column[k].item()
            for name, column in points.columns.items()
            if _is_known(column[k])
        }
        if kind == LANDMARK:
            yield {"do": "landmark", "name": str(values.get("name", "")), "xyz": xyz}
        else:
            yield {"do": "take", "xyz": xyz, "type": kind, "values": values}


def _is_known(value: Any) -> bool:
    return bool(value == value) and value != ""
