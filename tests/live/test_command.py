"""The command `live` as people run it: killed at any moment and gone on from, nothing that was acknowledged
is lost; its end is the run of the default pipeline.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any

import numpy as np
import pytest

from o3dls.cli.commands import run_command
from o3dls.errors import InputError
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.io.points import write_points
from o3dls.io.surfaces import read_surface
from o3dls.live.journal import read_journal
from o3dls.live.messages import Message, action
from o3dls.live.record import open_record
from o3dls.live.session import actions_of
from o3dls.live.sources.stdin import obey_lines
from o3dls.pipeline.file import default_pipeline
from tests.live.desk import until
from tests.tiny import ball_case

pytest.importorskip("o3dls.live.display")
KILLS = int(os.environ.get("O3DLS_LIVE_KILLS", "2"))  # 20 take some minutes
SEED = 640_917
SLOW = 300.0  # seconds: full fits stand back behind all else on a busy machine
needs_kill = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no kill -9")


class Session:
    """A session of the command without a page: it is told actions and tells events."""

    def __init__(self, arguments: Sequence[str | Path]) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "o3dls", "live", *map(str, arguments), "--headless", "--json"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.events: list[Message] = []
        self.errors: SimpleQueue[str] = SimpleQueue()
        self._thread = Thread(target=self._listen, daemon=True)
        self._thread.start()
        self._aside = Thread(target=self._hear, daemon=True)
        self._aside.start()

    def _listen(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if line.endswith("\n"):
                self.events.append(json.loads(line))

    def _hear(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.errors.put(line)

    def do(self, *actions: Any) -> None:
        assert self.process.stdin is not None
        for one in actions:
            self.process.stdin.write(json.dumps(one) + "\n")
        self.process.stdin.flush()

    def of(self, kind: str) -> list[Message]:
        return [one for one in list(self.events) if one["event"] == kind]

    @property
    def taken(self) -> set[int]:
        """Numbers of the points that were acknowledged."""
        return {one["id"] for one in self.of("point")}

    @property
    def told(self) -> object:
        """What explains a session that does not go on."""
        errors = [self.errors.get() for _ in range(self.errors.qsize())]
        return self.process.poll(), self.of("error"), self.of("state")[-1:], errors

    @property
    def fitted(self) -> int:
        states = self.of("state")
        return int(states[-1]["fitted"]) if states else 0

    def close(self) -> int:
        code = self.process.wait(SLOW)
        self._thread.join(SLOW)
        self._aside.join(SLOW)
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            assert stream is not None
            stream.close()
        return code

    def kill(self) -> None:
        self.process.kill()
        self.close()


@contextmanager
def session(*arguments: str | Path) -> Iterator[Session]:
    found = Session(arguments)
    try:
        yield found
    finally:
        if found.process.poll() is None:
            found.kill()


def engines(command: int) -> list[int]:
    """The processes that a command has begun for its engine."""
    listed = subprocess.run(["ps", "-wweo", "pid,ppid,args"], capture_output=True, text=True, check=True)
    rows = (line.split(None, 2) for line in listed.stdout.splitlines()[1:])
    found = [int(pid) for pid, parent, args in rows if int(parent) == command and "spawn_main" in args]
    assert found
    return found


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Message]]:
    """A case without points, but with landmarks on both sides; and its points as actions."""
    case = ball_case()
    folder = tmp_path_factory.mktemp("live") / "ball"
    write_case(folder, case)
    marks = case.points.select(case.points.type == "landmark")
    write_points(folder / "points.csv", marks)
    for name in ("truth.ply", "held_out.csv", "correspondence.csv", "outliers.csv"):
        (folder / name).unlink(missing_ok=True)
    takes = [one for one in actions_of(case) if one["do"] == "take" and one["type"] == "eam"]
    return folder, takes


def test_a_session_is_killed_gone_on_from_and_ends_as_a_run(
    cases: tuple[Path, list[Message]], tmp_path: Path
) -> None:
    """One session through its life: points, refusals, an engine that dies, the end, and what it left."""
    folder, takes = cases
    record = tmp_path / "record"
    with session(folder, "--record", record) as live:
        live.do(*takes[:20], {"do": "take", "xyz": [1, 2]}, "garbage", {"do": "undo", "point": 99})
        until(lambda: len(live.of("error")) == 3, SLOW)
        until(lambda: live.fitted == 20, SLOW)
        assert "three numbers" in live.of("error")[0]["text"]
        assert 'a key "do"' in live.of("error")[1]["text"]
        assert "no point 99" in live.of("error")[2]["text"]
        if hasattr(signal, "SIGKILL"):
            for one in engines(live.process.pid):
                os.kill(one, signal.SIGKILL)
            live.do(takes[20])
            until(lambda: live.fitted == 21, SLOW)
            assert any("was killed and is begun again" in one["text"] for one in live.of("error"))
        live.kill()
    assert [one["seq"] for one in live.events] == list(range(1, len(live.events) + 1))
    with session("--record", record) as live:
        live.do(
            *takes[21:],
            {"do": "undo", "point": 3},
            {"do": "retype", "point": 4, "type": "inside"},
            {"do": "retype", "point": 5, "type": "outlier"},
            {"do": "label", "point": 6, "values": {"bipolar": 0.25}},
            {"do": "landmark", "name": "north", "next": True},
            {"do": "undo"},
        )
        until(lambda: live.fitted >= len(takes) - 3, SLOW, lambda: live.told)
        live.do({"do": "end"})
        assert live.close() in (0, 1)
    end = live.of("end")[0]
    assert end["from_motion_mm"] < 0.5  # it had no time for a last full fit
    _check_what_is_left(record, takes)


def _check_what_is_left(record: Path, takes: list[Message]) -> None:
    case = read_case(record / "case")
    numbers = case.points.columns["id"]
    eam = case.points.type == "eam"
    assert numbers[eam].astype(int).tolist() == [k for k in range(1, len(takes)) if k not in (3, 4, 5)]
    assert numbers[case.points.type == "inside"].astype(int).tolist() == [4]
    assert case.points.numbers("bipolar")[numbers == 6].tolist() == [0.25]
    for k in (1, 2, 6):
        assert case.points.xyz[numbers == k][0].tolist() == takes[k - 1]["xyz"]
    run = default_pipeline().allowed_by(case).fit(case)
    last = list(run)[-1]
    live = read_surface(record / "run" / "estimates" / last / "surface.ply")
    gap = np.linalg.norm(live.vertices - run[last].surface.vertices, axis=1)
    assert gap.mean() < 0.05


@needs_kill
def test_whenever_it_is_killed_nothing_that_was_acknowledged_is_lost(
    cases: tuple[Path, list[Message]], tmp_path: Path
) -> None:
    folder, takes = cases
    record = tmp_path / "record"
    rng = random.Random(SEED)
    many = [{**one, "values": {"round": float(k)}} for k in range(KILLS) for one in takes]
    done = 0
    for _ in range(KILLS):
        with session(folder, "--record", record) as live:
            until(lambda live=live: live.events, SLOW)
            live.do(*many[done : done + 20])
            wanted = done + rng.randrange(1, 20)
            until(lambda live=live, wanted=wanted: max(live.taken, default=0) >= wanted, SLOW)
            live.kill()
        kept = [one for one in read_journal(record / "journal.jsonl").actions if one["do"] == "take"]
        assert live.taken <= set(range(1, len(kept) + 1))
        assert [one["xyz"] for one in kept] == [one["xyz"] for one in many[: len(kept)]]
        done = len(kept)


@needs_kill
@pytest.mark.skipif(KILLS < 20, reason="O3DLS_LIVE_KILLS=20 kills the engine at 20 moments: some minutes")
def test_an_engine_that_is_killed_at_any_moment_comes_back(
    cases: tuple[Path, list[Message]], tmp_path: Path
) -> None:
    folder, takes = cases
    rng = random.Random(SEED)
    with session(folder, "--record", tmp_path / "record") as live:
        for k in range(KILLS):
            live.do({**takes[k % len(takes)], "values": {"round": float(k)}})
            until(lambda k=k: len(live.taken) == k + 1, SLOW)
            before = len(live.of("state"))
            until(lambda before=before: len(live.of("state")) > before, SLOW)
            time.sleep(12.0 * rng.random())  # more than it takes to begin, so that it is no loop of ends
            for one in engines(live.process.pid):
                os.kill(one, signal.SIGKILL)
        until(lambda: live.of("state") and live.of("state")[-1]["points"] == KILLS, SLOW)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--record", "none"], "name the case folder"),
        ([], "no CASE given"),
        (["CASE", "--watch", "a.csv", "--igtl", "localhost:1"], "one source of points"),
        (["CASE", "--rate", "2"], "is of --replay"),
        (["CASE", "--igtl", "localhost"], "must be HOST:PORT"),
        (["CASE", "--watch", "no.csv"], "no such file"),
    ],
)
def test_what_cannot_be_is_refused_at_once(
    cases: tuple[Path, list[Message]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    reason: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    given = [str(cases[0]) if one == "CASE" else one for one in options]
    assert run_command(["live", *given]) == 2
    assert reason in capsys.readouterr().err
    assert not list(tmp_path.iterdir())  # no record of a session that never was


def test_another_prior_is_not_gone_on_with(cases: tuple[Path, list[Message]], tmp_path: Path) -> None:
    journal, _ = open_record(tmp_path / "record", cases[0])
    journal.close()
    case = ball_case()
    other = replace(case, prior=case.prior.with_vertices(1.01 * case.prior.vertices))
    write_case(tmp_path / "other", other)
    with pytest.raises(InputError, match="its prior is not that of"):
        open_record(tmp_path / "record", tmp_path / "other")


@pytest.mark.parametrize(
    "bad",
    [
        b"[" * 20_000,
        b'{"do": "take", "xyz": [1, 2, 3], "values": {"name": "\\ud800"}}',
        b'{"do": "take", "xyz": [' + b"9" * 400 + b", 1, 2]}",
        b'{"do": "take", "xyz": [' + b"9" * 5000 + b", 1, 2]}",
        b'{"do": "undo", "point": ' + b"9" * 400 + b"}",
        b'{"do": [1], "xyz": {}}',
        b"\xff\xfe not UTF-8",
        b"x" * 5_000_000,
        b'{"do": "take", "xyz": [NaN, 1, 2]}',
    ],
    ids=["deep", "half", "400", "5000", "point", "list", "bytes", "long", "nan"],
)
def test_a_line_that_is_no_action_is_refused_and_the_next_is_heard(bad: bytes) -> None:
    told: list[Message] = []
    done: list[Any] = []

    class Host:
        ending = False

        def act(self, given: object) -> Message:
            done.append(action(given))
            self.ending = done[-1]["do"] == "end"
            return {"ok": True}

        def tell(self, message: Message) -> None:
            told.append(message)

    lines = BytesIO(bad + b'\n\n{"do": "take", "xyz": [1, 2, 3]}\n{"do": "end"}')
    obey_lines(Host(), lines, alone=True)  # type: ignore[arg-type]
    assert [one["event"] for one in told] == ["error"]
    assert "internal" not in told[0]["text"]
    assert len(told[0]["text"]) < 400
    assert [one["do"] for one in done] == ["take", "end"]


def test_the_end_of_stdin_ends_a_session_that_nothing_else_gives_points(tmp_path: Path) -> None:
    write_case(tmp_path / "case", ball_case(0))
    command = [sys.executable, "-m", "o3dls", "live", "case", "--headless", "--record", "rec"]
    given = '{"do": "take", "xyz": [1, 2, 3]}'  # a last line without its end counts
    done = subprocess.run(command, input=given, cwd=tmp_path, capture_output=True, text=True, timeout=SLOW)
    assert done.returncode in (0, 1, 2)
    assert "Traceback" not in done.stderr
    assert [one["do"] for one in read_journal(tmp_path / "rec/journal.jsonl").actions][-2:] == ["take", "end"]
