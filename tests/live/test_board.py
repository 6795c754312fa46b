"""What a page is told: everything in order, or the newest of everything; and nobody waits for it."""

from __future__ import annotations

import json
import pickle
from typing import Any

import pytest

from o3dls.live.board import KEPT, WAITING, Board, Box, Sent


def point(number: int, **more: Any) -> dict[str, Any]:
    content = {"id": number, "xyz": [0.0, 0.0, 0.0], "type": "eam", "values": {}}
    return {"event": "point", **content, "weight": None, "distance": None, **more}


def taken(box: Box) -> list[tuple[str, int]]:
    found, _ = box.take(0.0)
    return [(one.kind, one.seq) for one in found]


def points_of(found: list[Sent]) -> list[dict[str, Any]]:
    (one,) = [sent for sent in found if sent.kind == "points"]
    return list(json.loads(one.text)["points"])


def test_events_are_numbered_one_after_the_other_and_come_in_order() -> None:
    board = Board()
    box = board.join()
    box.take(0.0)
    for k in range(5):
        board.publish(point(k + 1))
    assert taken(box) == [("point", k) for k in range(1, 6)]


def test_of_surfaces_that_wait_the_newest_is_sent_and_points_all() -> None:
    board = Board()
    box = board.join()
    box.take(0.0)
    for k in range(20):
        board.publish(point(k + 1))
        board.publish({"event": "surface", "after": k + 1})
    found = taken(box)
    assert [seq for kind, seq in found if kind == "point"] == list(range(1, 40, 2))
    assert [seq for kind, seq in found if kind == "surface"] == [40]


def test_who_comes_late_gets_the_newest_scene_surface_points_and_state() -> None:
    board = Board()
    for event in ({"event": "scene", "id": "a"}, {"event": "surface", "of": "a"}, point(1), point(2)):
        board.publish(event)
    for event in (
        {"event": "weights", "ids": [1, 2], "weights": [0.9, 0.1], "distances": [0.5, 4.0]},
        point(2, undone=True),
        {"event": "state", "points": 1},
        {"event": "state", "points": 2},
    ):
        board.publish(event)
    found, _ = board.join().take(0.0)
    assert [one.kind for one in found] == ["scene", "surface", "points", "state"]
    assert [(one["id"], one["weight"]) for one in points_of(found)] == [(1, 0.9)]
    assert json.loads(found[-1].text)["points"] == 2


def test_a_new_scene_takes_the_surface_of_the_old_one_away() -> None:
    board = Board()
    for event in (
        {"event": "scene", "id": "a"},
        {"event": "surface", "of": "a"},
        {"event": "scene", "id": "b"},
    ):
        board.publish(event)
    assert [one.kind for one in board.newest()] == ["scene", "points"]


def test_who_comes_back_gets_what_was_missed_and_no_more() -> None:
    board = Board()
    for k in range(6):
        board.publish(point(k + 1))
    assert taken(board.join(f"{board.session}-4")) == [("point", 5), ("point", 6)]
    assert taken(board.join(f"{board.session}-6")) == []


@pytest.mark.parametrize("last", ["another-4", "4", "", "-", "x-²", "{session}-9999", "{session}-0"])
def test_who_names_no_event_that_is_kept_gets_all_that_is_new(last: str) -> None:
    board = Board()
    for k in range(KEPT + 5):
        board.publish(point(k + 1))
    found, _ = board.join(last.format(session=board.session)).take(0.0)
    assert len(points_of(found)) == KEPT + 5


def test_a_long_session_keeps_no_old_surfaces_and_scenes() -> None:
    board = Board()
    for _ in range(50):
        board.publish({"event": "scene", "id": "a"})
        board.publish(point(1))
        board.publish({"event": "surface", "of": "a", "positions": "x" * 1000})
    assert len(pickle.dumps((board._log, board._newest))) < 50_000  # 50 surfaces are more
    back = board.join(f"{board.session}-140")
    assert taken(back) == [("point", 143), ("point", 146), ("scene", 148), ("point", 149), ("surface", 150)]


def test_a_page_that_does_not_read_is_told_that_it_fell_behind_and_costs_no_more() -> None:
    board = Board()
    box = board.join()
    for k in range(10 * WAITING):
        board.publish(point(k + 1))
    assert len(box.waiting) <= WAITING
    assert box.take(0.0)[1]
    assert len(points_of(board.newest())) == 10 * WAITING


def test_a_number_that_no_browser_reads_is_an_error_at_once() -> None:
    with pytest.raises(ValueError, match="JSON"):
        Board().publish({"event": "state", "mapped_mm": float("nan")})
