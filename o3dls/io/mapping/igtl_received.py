"""OpenIGTLink messages as they are received, of version 1, and of 2 and 3 with their extended header."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...arrays import Array
from ...errors import InputError
from .igtl import HEADER, crc64

EXTENDED = struct.Struct(">HHII")  # sizes of itself, of the metadata's header and of the metadata; number
POINT = struct.Struct(">64s32s4B4f20s")
LARGEST = 1 << 26  # bytes of a body: no point or pose has as many, and images are not asked for
VERSIONS = (1, 2, 3)


@dataclass(frozen=True)
class Received:
    """A received message has a type, the name of its device, its content, and its number, 0 where it has
    none.
    """

    kind: str
    name: str
    content: bytes
    number: int = 0


@dataclass(frozen=True)
class ReceivedPoint:
    """This is one point of a message POINT, with xyz as it was sent."""

    name: str
    group: str
    xyz: tuple[float, float, float]


class BadMessage(InputError):
    """A message cannot be used; the next one can be."""


def receive(read: Callable[[int], bytes]) -> Received:
    """Read the next message of a stream; read(n) gives n bytes, or fewer at its end.

    Raises BadMessage for a body that is damaged, InputError where the stream has ended or is not one of
    OpenIGTLink, so that no next message can be found.
    """
    head = read(HEADER.size)
    if not head:
        raise InputError("the sender closed the connection")
    if len(head) < HEADER.size:
        raise InputError("the sender closed the connection in the middle of a message")
    version, kind, name, _, size, crc = HEADER.unpack(head)
    if version not in VERSIONS or size > LARGEST or not _decode_text(kind).isprintable():
        raise InputError(f"what was received is no OpenIGTLink message (version {version}, {size} bytes)")
    body = read(size)
    if len(body) < size:
        raise InputError("the sender closed the connection in the middle of a message")
    word = _decode_text(kind)
    if crc64(body) != crc:
        raise BadMessage(f"a message {word} was damaged on its way (its checksum is wrong) and is left out")
    return (
        Received(word, _decode_text(name), body)
        if version == 1
        else _read_extended(word, _decode_text(name), body)
    )


def _read_extended(kind: str, name: str, body: bytes) -> Received:
    """Read the content and number of a message from version 2 on; its metadata is passed over."""
    if len(body) < EXTENDED.size:
        raise BadMessage(f"a message {kind} is too short for its extended header and is left out")
    own, heads, data, number = EXTENDED.unpack_from(body)
    end = len(body) - heads - data
    if own < EXTENDED.size or end < own:
        raise BadMessage(f"a message {kind} has an extended header that does not fit and is left out")
    return Received(kind, name, body[own:end], number)


def points_of(message: Received) -> list[ReceivedPoint]:
    """Return the points of a message POINT. Raises BadMessage where it holds something else."""
    if not message.content or len(message.content) % POINT.size:
        raise BadMessage(f"a message POINT has {len(message.content)} bytes: must be {POINT.size} for each")
    found = []
    for name, group, *_, x, y, z, _, _ in POINT.iter_unpack(message.content):
        if not np.isfinite((x, y, z)).all():
            raise BadMessage(f"a message POINT holds a place that is not finite: {[x, y, z]}; it is left out")
        found.append(ReceivedPoint(_decode_text(name), _decode_text(group), (x, y, z)))
    return found


def transform_of(message: Received) -> Array:
    """Return the pose (4, 4) of a message TRANSFORM. Raises BadMessage where it holds something else."""
    if len(message.content) != 48:
        raise BadMessage(f"a message TRANSFORM has {len(message.content)} bytes: must be 48")
    numbers = np.frombuffer(message.content, dtype=">f4").astype(np.float64)
    if not np.isfinite(numbers).all():
        raise BadMessage("a message TRANSFORM holds a number that is not finite; it is left out")
    matrix = np.eye(4)
    matrix[:3] = numbers.reshape(4, 3).T
    return matrix


def _decode_text(field: bytes) -> str:
    return field.split(b"\0", 1)[0].decode("utf-8", "replace").strip()
