"""The journal of a live session and the case that it stands for: nothing that was acknowledged is lost."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.errors import InputError
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.live.journal import begin_journal, read_journal, resume_journal
from o3dls.live.messages import Message, action
from o3dls.live.session import Session, actions_of, empty
from tests.tiny import ball_case

HEAD = {"case": "/cases/ball", "prior": "abc"}
TAKE = {"do": "take", "xyz": [1, 2, 3]}


def session_of(*actions: Message) -> Session:
    session = Session(empty(ball_case()))
    for one in map(action, actions):
        session.check(one)
        session.apply(one)
    return session


def taken(x: float, **values: float | str) -> Message:
    return {"do": "take", "xyz": [x, 0, 0], "values": values}


def test_the_actions_of_a_case_fold_into_the_same_case(tmp_path: Path) -> None:
    case = ball_case()
    session = session_of(*actions_of(case))
    found = session.case()
    old, new = (one.points.select(np.lexsort(one.points.xyz.T)) for one in (case, found))
    assert np.array_equal(old.xyz, new.xyz)
    assert np.array_equal(old.type, new.type)
    assert found.landmark_pairs()[0] == case.landmark_pairs()[0]
    write_case(tmp_path / "case", found)
    again = read_case(tmp_path / "case")
    assert np.array_equal(again.points.xyz, found.points.xyz)
    assert np.array_equal(again.prior.vertices, case.prior.vertices)


def test_an_undone_point_keeps_its_number_and_leaves_the_case() -> None:
    session = session_of(taken(1), taken(2), taken(3), {"do": "undo", "point": 2}, {"do": "undo"}, taken(4))
    assert session.case().points.columns["id"].tolist() == ["1", "4"]
    assert session.case().points.xyz[:, 0].tolist() == [1, 4]


def test_points_are_retyped_and_labelled() -> None:
    session = session_of(
        taken(1, bipolar=0.2),
        taken(2),
        taken(3),
        {"do": "retype", "point": 2, "type": "inside"},
        {"do": "retype", "point": 3, "type": "outlier"},
        {"do": "label", "point": 1, "values": {"LAT_ms": 12, "tag": "scar"}},
    )
    points = session.case().points
    assert points.type.tolist() == ["eam", "inside"]
    assert points.numbers("bipolar")[0] == 0.2
    assert points.numbers("lat")[0] == 12
    assert np.isnan(points.numbers("lat")[1])
    assert points.columns["tag"].tolist() == ["scar", ""]


def test_landmarks_are_places_or_the_next_point_and_the_last_of_a_name_counts() -> None:
    session = session_of(
        {"do": "prior_landmark", "name": "LSPV", "xyz": [0, 0, 9]},
        {"do": "landmark", "name": "LSPV", "xyz": [1, 1, 1]},
        {"do": "landmark", "name": "LSPV", "next": True},
        taken(5),
        taken(6),
    )
    case = session.case()
    assert case.points.type.tolist() == ["landmark", "eam"]
    assert case.landmark_pairs()[0] == ["LSPV"]
    assert case.landmark_pairs()[2].tolist() == [[5, 0, 0]]


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"do": "undo", "point": 7}, "no point 7: there are 1 to 2"),
        ({"do": "undo", "point": 2}, "point 2 was undone"),
        ({"do": "label", "point": 2, "values": {}}, "point 2 was undone"),
    ],
)
def test_what_the_session_does_not_have_is_refused(given: Message, reason: str) -> None:
    session = session_of(taken(1), taken(2), {"do": "undo"})
    with pytest.raises(InputError, match=reason):
        session.check(action(given))


def test_nothing_is_left_to_undo() -> None:
    with pytest.raises(InputError, match="no point that was not undone"):
        Session(empty(ball_case())).check({"do": "undo"})


def test_a_journal_is_gone_on_from(tmp_path: Path) -> None:
    journal = begin_journal(tmp_path / "record", HEAD, [TAKE])
    journal.append(action({**TAKE, "values": {"tag": "Größe"}}))
    journal.close()
    again = resume_journal(tmp_path / "record")
    again.append(action({"do": "undo"}))
    lines = read_journal(tmp_path / "record" / "journal.jsonl").actions
    assert [(one["seq"], one["do"]) for one in lines] == [(1, "take"), (2, "take"), (3, "undo")]
    assert lines[1]["values"] == {"tag": "Größe"}
    assert again.head["case"] == HEAD["case"]
    again.close()


def test_a_torn_last_line_is_cut_off_and_said(tmp_path: Path) -> None:
    """Wherever a kill cuts the last line, the lines before it are whole, and the next one follows them."""
    begin_journal(tmp_path, HEAD, [TAKE, TAKE]).close()
    path = tmp_path / "journal.jsonl"
    whole = path.read_bytes()
    last = whole[:-1].rfind(b"\n") + 1
    for size in (last + 1, (last + len(whole)) // 2, len(whole) - 1):
        path.write_bytes(whole[:size])
        journal = resume_journal(tmp_path)
        assert "was not written whole" in journal.cut
        assert len(journal.actions) == 1
        journal.append(action(TAKE))
        journal.close()
        assert [one["seq"] for one in read_journal(path).actions] == [1, 2]


class FullDisk:
    """The file of a journal on a disk that has room for so many more bytes."""

    def __init__(self, file: Any, room: int) -> None:
        self.file, self.room = file, room

    def __getattr__(self, name: str) -> Any:
        return getattr(self.file, name)

    def write(self, data: bytes) -> int:
        self.file.write(data[: self.room])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("room", [0, 10])
def test_what_a_full_disk_does_not_keep_is_not_taken(tmp_path: Path, room: int) -> None:
    journal = begin_journal(tmp_path, HEAD, [TAKE])
    file, journal.file = journal.file, FullDisk(journal.file, room)  # type: ignore[assignment]
    with pytest.raises(InputError, match="No space left"):
        journal.append(action(TAKE))
    journal.file = file
    journal.append(action({"do": "undo"}))
    journal.close()
    assert [one["do"] for one in read_journal(tmp_path / "journal.jsonl").actions] == ["take", "undo"]


def test_one_session_writes_a_journal(tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    journal = begin_journal(tmp_path, HEAD, [])
    with pytest.raises(InputError, match="another session writes it"):
        resume_journal(tmp_path)
    journal.close()


@pytest.mark.parametrize(
    ("spoilt", "reason"),
    [
        (lambda lines: [lines[0], lines[2]], "has seq 2, must be 1"),
        (lambda lines: [lines[0], lines[1].replace("take", "tale")], "line 2: no action 'tale'"),
        (lambda lines: [lines[0], lines[1][:20]], "line 2: is not JSON"),
        (lambda lines: lines[1:], "not the beginning of a journal"),
        (lambda lines: ["[" * 20_000, *lines[1:]], "line 1: has tables or lists in each other"),
        (lambda lines: [lines[0], "[" * 20_000], "line 2: has tables or lists in each other"),
        (lambda lines: [lines[0].replace('"case"', '"cave"'), *lines[1:]], "line 1: case must be a text"),
        (lambda lines: [lines[0].replace('"prior": ', '"prior": 1, "p": '), *lines[1:]], "prior must be a"),
        (lambda lines: [lines[0].replace('"begun": ', '"begun": 1e999, "b": '), *lines[1:]], "begun must be"),
        (lambda lines: [lines[0], lines[1].replace("take", "\\ud800")], "line 2: has half of a letter"),
        (lambda lines: [lines[0], lines[1].replace('"seq": 1', '"seq": [[1]]')], r"has seq \[\[1\]\], must"),
        (lambda lines: [lines[0], lines[1].replace('"xyz": [', f'"xyz": [{"9" * 400}, ')], "beyond 64 bits"),
        (lambda lines: [lines[0], f"[{lines[1]}]"], "line 2: must be an object"),
    ],
)
def test_a_journal_that_was_changed_is_refused(tmp_path: Path, spoilt: Any, reason: str) -> None:
    begin_journal(tmp_path, HEAD, [TAKE, TAKE]).close()
    path: Path = tmp_path / "journal.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(spoilt(lines)) + "\n", encoding="utf-8")
    with pytest.raises(InputError, match=reason):
        resume_journal(tmp_path)


def test_same_journal_same_case(tmp_path: Path) -> None:
    journal = begin_journal(tmp_path, HEAD, actions_of(ball_case()))
    journal.append(action({"do": "undo"}))
    journal.close()
    kept = read_journal(journal.path).actions
    first, second = (
        session_of(*({k: v for k, v in a.items() if k not in ("seq", "time")} for a in kept))
        for _ in range(2)
    )
    assert json.dumps(first.case().points.xyz.tolist()) == json.dumps(second.case().points.xyz.tolist())
