"""OpenIGTLink (version 1): surfaces, points and poses packed and sent live to Slicer or a research system."""

from __future__ import annotations

import socket
import struct
from collections.abc import Sequence
from functools import cache
from time import monotonic

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...geometry.surface import Surface

HEADER = struct.Struct(">H12s20sQQQ")
POLYNOMIAL = 0x42F0E1EBA9EA3693  # ECMA-182
PORT = 18944  # Slicer's default


@cache
def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        value = byte << 56
        for _ in range(8):
            value = ((value << 1) ^ POLYNOMIAL if value >> 63 else value << 1) & 0xFFFFFFFFFFFFFFFF
        table.append(value)
    return tuple(table)


def crc64(data: bytes) -> int:
    """Return the CRC-64 of ECMA-182: start 0, most significant bit first, no final xor."""
    table = _crc_table()
    value = 0
    for byte in data:
        value = table[(value >> 56) ^ byte] ^ (value << 8 & 0xFFFFFFFFFFFFFFFF)
    return value


def message(kind: str, name: str, body: bytes) -> bytes:
    """Pack a whole message; its time stamp is 0, which means none, so that equal content gives equal
    bytes.
    """
    return (
        HEADER.pack(1, kind.encode(), name.encode("ascii", "replace")[:20], 0, len(body), crc64(body)) + body
    )


def polydata(surface: Surface, name: str = "o3dls") -> bytes:
    """Pack a surface with its fields as point data, float32."""
    if surface.dimension != 3:
        raise InputError("OpenIGTLink surfaces are 3D")
    cells = np.column_stack([np.full(len(surface.faces), 3), surface.faces]).astype(">u4").tobytes()
    values = [
        np.asarray(v, dtype=np.float64).reshape(len(surface.vertices), -1) for v in surface.fields.values()
    ]
    counts = struct.pack(
        ">10I", len(surface.vertices), 0, 0, 0, 0, len(surface.faces), len(cells), 0, 0, len(values)
    )
    heads = b"".join(struct.pack(">BBI", _attribute_type(v.shape[1]), v.shape[1], len(v)) for v in values)
    names = b"".join(key.encode("ascii", "replace") + b"\0" for key in surface.fields)
    names += b"\0" * (len(names) % 2)
    data = b"".join(v.astype(">f4").tobytes() for v in values)
    return message(
        "POLYDATA", name, counts + surface.vertices.astype(">f4").tobytes() + cells + heads + names + data
    )


def _attribute_type(width: int) -> int:
    """Return the number of an attribute type: 0 scalar, 1 vector, 3 tensor; other widths go as scalars of
    several components.
    """
    return {3: 1, 9: 3}.get(width, 0)


def points(
    names: Sequence[str], xyz: Array, name: str = "o3dls", *, group: str = "o3dls", diameter: float = 3.0
) -> bytes:
    """Pack named points, such as landmarks or ablation sites."""
    rows = [
        struct.pack(
            ">64s32s4B4f20s",
            label.encode("utf-8")[:64],
            group.encode()[:32],
            255,
            255,
            0,
            255,
            *position,
            diameter,
            b"",
        )
        for label, position in zip(names, np.asarray(xyz).tolist(), strict=True)
    ]
    return message("POINT", name, b"".join(rows))


def transform(matrix: Array, name: str = "o3dls") -> bytes:
    """Pack a 4x4 pose: the columns of its linear part, then the translation."""
    return message(
        "TRANSFORM", name, np.concatenate([matrix[:3, :3].T.ravel(), matrix[:3, 3]]).astype(">f4").tobytes()
    )


def connect(host: str, port: int, timeout: float) -> socket.socket:
    """Return a connection to the server at a host and port. Raises InputError where nobody listens, or the
    host cannot be one.
    """
    try:
        return socket.create_connection((host, port), timeout=timeout)
    except (UnicodeError, OverflowError):  # a part of more than 63 letters, a port beyond 65535
        raise InputError(
            f"{host}:{port}: cannot be an address: the parts of a host's name have at most 63 letters, and a "
            "port is from 1 to 65535"
        ) from None
    except OSError as error:
        raise InputError(
            f"{host}:{port}: nobody answers: {error}; start an OpenIGTLink server there (Slicer: "
            f"OpenIGTLinkIF, port {PORT})"
        ) from None


def send(
    messages: Sequence[bytes], host: str = "localhost", port: int = PORT, *, timeout: float = 5.0
) -> tuple[int, bool]:
    """Send whole messages to a listening system: the number of bytes, and whether it closed in order after
    the last. Raises InputError where nobody listens, or the receiver closed before it had read everything.

    It has `timeout` seconds to close; the receiver takes the frame as RAS (Slicer does): turn LPS data first.
    """
    with connect(host, port, timeout) as connection:
        try:
            for data in messages:
                connection.sendall(data)
            return sum(map(len, messages)), _await_close(connection, timeout)
        except OSError as error:
            raise InputError(
                f"{host}:{port}: the receiver did not read everything: {error}; is it an OpenIGTLink server "
                f"(Slicer: OpenIGTLinkIF, port {PORT})?"
            ) from None


def _await_close(connection: socket.socket, timeout: float) -> bool:
    """Return whether the receiver closes in answer to the end of the data; what it sends meanwhile is passed
    over. Raises OSError where it closed before the end.
    """
    connection.setblocking(False)
    try:
        while connection.recv(65536):
            pass
        raise ConnectionError("it closed before the end")  # a receiver must not close before the data end
    except BlockingIOError:
        connection.shutdown(socket.SHUT_WR)
    end = monotonic() + timeout
    while (left := end - monotonic()) > 0.0:
        connection.settimeout(left)
        try:
            data = connection.recv(65536)
        except TimeoutError:
            return False
        if not data:  # the receiver closed in order, unless its answer was a reset
            if code := connection.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
                raise ConnectionError(code, "it closed before the end")
            return True
    return False
