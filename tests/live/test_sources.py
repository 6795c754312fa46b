"""Sources of points: each point once, in the order in which it came, whatever a source does."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from time import monotonic

import numpy as np
import pytest
from said import said_by

from o3dls.arrays import Array
from o3dls.case import Points
from o3dls.errors import InputError
from o3dls.io.mapping import igtl as sent
from o3dls.io.mapping.igtl_received import BadMessage, points_of, receive, transform_of
from o3dls.io.points import write_points
from o3dls.live.messages import Message
from o3dls.live.sources.igtl import Igtl
from o3dls.live.sources.replay import Replay
from o3dls.live.sources.source import Source, begin, identities
from o3dls.live.sources.watch import STILL, Watch
from tests.finished import finished
from tests.live.desk import Desk, until

HEADER = "x,y,z,bipolar\n"


@contextmanager
def followed(source: Source) -> Iterator[Desk]:
    """A desk that a source brings its points to."""
    desk, stop = Desk(), Event()
    thread = begin(source, desk, stop, Event())
    try:
        yield desk
    finally:
        stop.set()
        thread.join(10.0)
        assert not thread.is_alive()


def test_a_file_that_grows_gives_each_point_once(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(HEADER, encoding="utf-8")
    with followed(Watch(path, "unknown")) as desk:
        until(lambda: desk.said == ["connected"])
        with path.open("a", encoding="utf-8") as file:
            file.write("1,0,0,0.5\n2,0,0,\n")
            file.flush()
            until(lambda: desk.xs == [1, 2])
        path.write_text(HEADER + "3,0,0,1\n2,0,0,\n1,0,0,0.5\n", encoding="utf-8")  # in another order
        until(lambda: desk.xs == [1, 2, 3])
    assert desk.actions[0]["values"] == {"bipolar": 0.5}
    assert desk.actions[1]["values"] == {}


def test_a_line_that_is_half_written_waits_for_its_end(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(HEADER + "1,0,0,1\n12", encoding="utf-8")
    watch = Watch(path, "unknown")
    desk = Desk()
    assert watch._whole_part(path.read_bytes(), 0.0) == (HEADER + "1,0,0,1\n").encode()
    watch._give_points(watch._read_points(watch._whole_part(path.read_bytes(), 0.0) or b""), desk)
    path.write_text(HEADER + "1,0,0,1\n12.5,0,0,1", encoding="utf-8")
    watch._give_points(
        watch._read_points(watch._whole_part(path.read_bytes(), STILL) or b""), desk
    )  # it stands still
    assert desk.xs == [1, 12.5]


def test_a_row_that_is_there_twice_is_taken_once_and_said(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(HEADER + "1,0,0,1\n2,0,0,1\n1,0,0,1\n", encoding="utf-8")
    with followed(Watch(path, "unknown")) as desk:
        until(lambda: len(desk.errors) == 1)
    assert desk.xs == [1, 2]
    assert "there twice" in desk.errors[0]


def test_garbage_in_a_file_is_said_and_points_go_on_once_it_is_mended(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(HEADER + "1,0,0,1\nnan,0,0,1\n", encoding="utf-8")
    with followed(Watch(path, "unknown")) as desk:
        until(lambda: desk.errors)
        assert "line 3, column 'x': 'nan' is not finite" in desk.errors[0]
        assert desk.said[-1].startswith("hung up")
        assert not desk.actions
        path.write_text(HEADER + "1,0,0,1\n2,0,0,1\n", encoding="utf-8")
        until(lambda: desk.xs == [1, 2])
        until(lambda: desk.said[-1] == "connected")


def test_a_watched_file_in_another_frame_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("# space=RAS\n" + HEADER + "1,0,0,1\n", encoding="utf-8")
    with followed(Watch(path, "LPS")) as desk:
        until(lambda: desk.errors)
    assert "states frame RAS, and the case is in LPS" in desk.errors[0]


def test_an_export_that_grows_is_read_once_it_stands_still(tmp_path: Path) -> None:
    """An EnSite export of one map: what was there is not taken again."""
    from tests.io.test_io_study import DXL

    folder = tmp_path / "export"
    folder.mkdir()
    lines = DXL.splitlines(keepends=True)
    (folder / "map.csv").write_text("".join(lines[:-2] + lines[-1:]), encoding="utf-8")
    with followed(Watch(folder, "unknown")) as desk:
        until(lambda: desk.xs == [1])
        (folder / "map.csv").write_text(DXL, encoding="utf-8")
        until(lambda: desk.xs == [1, 7])
    assert not desk.errors


def test_what_an_earlier_part_of_the_session_took_does_not_come_again(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(HEADER + "1,0,0,1\n2,0,0,1\n", encoding="utf-8")
    first = Desk()
    watch = Watch(path, "unknown")
    watch._give_points(watch._read_points(path.read_bytes()), first)
    journal = [{"seq": k, "time": 0.5, **one} for k, one in enumerate(first.actions, 1)]
    path.write_text(HEADER + "1,0,0,1\n2,0,0,1\n3,0,0,1\n", encoding="utf-8")
    for source in (Watch(path, "unknown", identities(journal)), Replay(path, 500.0, identities(journal))):
        with followed(source) as desk:
            until(lambda desk=desk: desk.xs == [3])


def test_a_replay_is_in_order_and_by_time(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    xyz = np.array([[1.0, 0, 0], [2, 0, 0], [3, 0, 0], [9, 9, 9]])
    columns = {"time": np.array([0.2, 0.0, 0.1, 0.3]), "name": np.array(["", "", "", "LSPV"])}
    write_points(path, Points(xyz, np.array(["eam"] * 3 + ["landmark"]), columns))
    with followed(Replay(path, None)) as desk:
        until(lambda: len(desk.actions) == 4)
    assert desk.xs == [2, 3, 1, 9]
    assert desk.actions[3] == {"do": "landmark", "name": "LSPV", "xyz": [9.0, 9.0, 9.0]}
    assert desk.said[-1].startswith("ended")


def test_a_replay_needs_a_rate_or_a_time(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(HEADER + "1,0,0,1\n", encoding="utf-8")
    with pytest.raises(InputError, match="say --rate"):
        Replay(path, None)


def extended(message: bytes, number: int, meta: bytes = b"") -> bytes:
    """A message of version 1 as one of version 2, with its number and metadata."""
    kind, name = (field.rstrip(b"\0").decode() for field in struct.unpack(">12s20s", message[2:34]))
    heads = struct.pack(">H", 0)
    body = struct.pack(">HHII", 12, len(heads), len(meta), number) + message[58:] + heads + meta
    whole = sent.message(kind, name, body)
    return struct.pack(">H", 2) + whole[2:]


def read_of(data: bytes) -> bytes:
    """What a message holds, as received."""
    left = bytearray(data)

    def read(count: int) -> bytes:
        part = bytes(left[:count])
        del left[:count]
        return part

    return receive(read).content


@pytest.mark.parametrize("meta", [b"", b"some metadata"])
def test_messages_of_both_versions_are_unpacked(meta: bytes) -> None:
    point = sent.points(["LSPV"], np.array([[1.0, 2.0, 3.0]]))
    assert read_of(point) == read_of(extended(point, 7, meta)) == point[58:]


class Server:
    """A navigation system that sends what it is told to, to one client after the other."""

    def __init__(self) -> None:
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.listening.settimeout(20.0)
        self.port = self.listening.getsockname()[1]
        self.client: socket.socket | None = None

    def accept(self) -> None:
        self.client, _ = self.listening.accept()

    def send(self, *messages: bytes) -> None:
        assert self.client is not None
        for one in messages:
            self.client.sendall(one)

    def hang_up(self) -> None:
        assert self.client is not None
        self.client.close()


@pytest.fixture
def server() -> Iterator[Server]:
    found = Server()
    yield found
    found.listening.close()
    if found.client:
        found.client.close()


def one(x: float, name: str = "p", group: str = "o3dls") -> bytes:
    return sent.points([name], np.array([[x, 2.0, 3.0]]), group=group)


def test_points_and_the_tip_come_by_openigtlink(server: Server) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 4.0, 5.0, 6.0
    with followed(Igtl("127.0.0.1", server.port, "LPS")) as desk:
        server.accept()
        server.send(one(1.0), sent.transform(pose), one(2.0, group="inside"))
        until(lambda: len(desk.actions) == 2)
        server.hang_up()
        until(lambda: desk.tips[-1:] == [None])
    assert desk.actions[0]["xyz"] == [-1.0, -2.0, 3.0]  # from RAS
    assert [a["type"] for a in desk.actions] == ["eam", "inside"]
    assert desk.tips[0] == [-4.0, -5.0, 6.0]


def test_what_is_damaged_is_said_and_the_next_message_counts(server: Server) -> None:
    bad = bytearray(one(1.0))
    bad[-1] ^= 1
    image = sent.message("IMAGE", "x", b"abc")
    nan = sent.points(["p"], np.array([[np.nan, 0.0, 0.0]]))
    short = sent.message("POINT", "x", b"abc")
    with followed(Igtl("127.0.0.1", server.port, "unknown")) as desk:
        server.accept()
        server.send(bytes(bad), image, nan, short, one(5.0))
        until(lambda: desk.xs == [5.0])
    words = ["checksum is wrong", "IMAGE is no POINT", "not finite", "3 bytes: must be 136"]
    assert all(word in said for word, said in zip(words, desk.errors, strict=True))


def test_a_sender_that_hangs_up_is_found_again(server: Server) -> None:
    with followed(Igtl("127.0.0.1", server.port, "unknown")) as desk:
        server.accept()
        server.send(one(1.0), one(2.0)[:70])  # half a message
        until(lambda: desk.xs == [1.0])
        server.hang_up()
        until(lambda: any("in the middle of a message" in said for said in desk.errors))
        assert desk.said[-1].startswith("hung up")
        server.accept()
        server.send(one(2.0))
        until(lambda: desk.xs == [1.0, 2.0])
        server.send(b"GET / HTTP/1.1\r\n" + b"\r\n" * 60)
        until(lambda: any("no OpenIGTLink message" in said for said in desk.errors))


def test_a_point_that_a_message_repeats_is_taken_once(server: Server) -> None:
    with followed(Igtl("127.0.0.1", server.port, "unknown")) as desk:
        server.accept()
        twice = sent.points(["a", "a"], np.array([[1.0, 0, 0], [1.0, 0, 0]]))
        server.send(twice, extended(one(2.0), 9), extended(one(2.0), 9), extended(one(2.0), 10))
        until(lambda: len(desk.actions) == 3)
    assert desk.xs == [1.0, 2.0, 2.0]  # another number is another touch
    assert len(desk.errors) == 2


def test_an_extended_header_that_does_not_fit_is_refused() -> None:
    damaged = sent.message("POINT", "x", struct.pack(">HHII", 12, 0, 500, 1) + one(1.0)[58:])
    with pytest.raises(BadMessage, match="does not fit"):
        read_of(struct.pack(">H", 2) + damaged[2:])


def test_pyigtl_plays_the_navigation_system() -> None:
    """An independent writer of OpenIGTLink: its points and poses arrive as it sent them."""
    pyigtl = pytest.importorskip("pyigtl")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = pyigtl.OpenIGTLinkServer(port=port, local_server=True)
    pose = np.eye(4)
    pose[:3, 3] = 7.0, 8.0, 9.0
    stop = Event()
    try:
        with followed(Igtl("127.0.0.1", port, "RAS")) as desk:
            until(server.is_connected)

            def play() -> None:  # what it is given before a client is ready it drops
                k = 0
                while not stop.wait(0.05):
                    k += 1
                    server.send_message(pyigtl.TransformMessage(pose, device_name="tip"))
                    server.send_message(
                        pyigtl.PointMessage(np.array([[1.5, 2.5, 3.5 + k]]), device_name="points")
                    )

            thread = Thread(target=play)
            thread.start()
            until(lambda: len(desk.actions) > 2 and desk.tips)
            stop.set()
            thread.join()
        assert desk.actions[0]["xyz"][:2] == [1.5, 2.5]
        assert desk.tips[0] == [7.0, 8.0, 9.0]
        assert not desk.errors
    finally:
        stop.set()
        server.stop()


def test_a_pose_is_read_as_it_was_sent() -> None:
    pose: Array = np.eye(4)
    pose[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    pose[:3, 3] = 1.0, 2.0, 3.0
    left = bytearray(sent.transform(pose))

    def read(count: int) -> bytes:
        part = bytes(left[:count])
        del left[:count]
        return part

    message = receive(read)
    assert np.array_equal(transform_of(message), pose)
    with pytest.raises(BadMessage):
        points_of(message)


def test_an_address_that_cannot_be_is_said_and_the_source_goes_on() -> None:
    source = Igtl("a" * 70 + ".org", 18944, "LPS")
    desk, stop, done = Desk(), Event(), Event()
    thread = begin(source, desk, stop, done)
    until(lambda: desk.said)
    stop.set()
    thread.join(10.0)
    assert "at most 63 letters" in desk.errors[0]
    assert desk.said[0].startswith("hung up")


@pytest.mark.parametrize("host", ["a" * 70 + ".org", "a..b", "é" * 70])
def test_a_host_that_cannot_be_is_no_address_to_send_to_either(host: str, tmp_path: Path) -> None:
    code, said = said_by("send", finished(tmp_path / "run"), "--host", host)
    assert code == 2, said
    assert "cannot be an address: the parts of a host's name have at most 63 letters" in said
    assert "internal" not in said


def test_a_source_that_breaks_is_said_and_followed_again() -> None:
    class Breaks:
        follows = 0

        def follow(self, desk: object, stop: Event) -> None:
            self.follows += 1
            raise ZeroDivisionError("inside")

    source, desk, stop = Breaks(), Desk(), Event()
    thread = begin(source, desk, stop, Event())
    until(lambda: source.follows > 1)
    stop.set()
    thread.join(10.0)
    assert "ZeroDivisionError: inside" in desk.errors[0]


@pytest.mark.parametrize("rows", [60_000, 6_000_000])
def test_a_file_of_more_points_than_a_session_takes_is_said_at_once(rows: int, tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    path.write_text("x,y,z\n" + "1,2,3\n" * rows)
    desk, stop = Desk(), Event()
    begin = monotonic()
    with pytest.raises(InputError, match=r"p\.csv: has \d+ (lines|bytes): .*at most"):
        Watch(path, "LPS").follow(desk, stop)
    assert monotonic() - begin < 5.0
    assert desk.actions == []


def test_what_is_watched_is_left_at_once_when_told(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    path.write_text("x,y,z\n" + "".join(f"{k},0,0\n" for k in range(5000)))
    stop = Event()

    class Slow(Desk):
        def act(self, given: Message) -> Message:
            stop.set()
            return super().act(given)

    desk = Slow()
    Watch(path, "LPS").follow(desk, stop)
    assert desk.xs == [0.0]
