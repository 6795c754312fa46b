"""Arrays as text inside the page: 16 bits per number, base64; read by static/decode.js."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from ...arrays import Array

LAST = 65535
Json = dict[str, Any]


class Packed(str):
    """A packed array is base64 that stands once on the page however often it is used."""


def once(data: Any, arrays: list[str]) -> Any:
    """Return the data with the place in `arrays` of every packed array instead of its text; equal arrays
    share a place.
    """
    places = {text: k for k, text in enumerate(arrays)}

    def placed(part: Any) -> Any:
        if isinstance(part, Packed):
            if part not in places:
                places[part] = len(arrays)
                arrays.append(str(part))
            return places[part]
        if isinstance(part, dict):
            return {key: placed(value) for key, value in part.items()}
        return [placed(value) for value in part] if isinstance(part, list) else part

    return placed(data)


def coded(array: Any) -> Packed:
    """Encode an array's little-endian bytes as base64."""
    raw = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")).tobytes()
    return Packed(base64.b64encode(raw).decode("ascii"))


def packed(values: Array) -> Json:
    """Pack numbers in 16 bits with their ends; the largest code stands for a missing value."""
    known = np.isfinite(values)
    low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 1.0)
    high = high if high > low else low + 1.0
    codes = np.full(len(values), LAST, dtype=np.uint16)
    codes[known] = np.round((values[known] - low) / (high - low) * (LAST - 1)).astype(np.uint16)
    return {"data": coded(codes), "low": low, "high": high}


def grid(points: Array, low: Array, size: Array) -> Packed:
    """Pack points (n, 3) in 16 bits per coordinate inside the box of the scene."""
    return coded(np.round((points - low) / size * LAST).astype(np.uint16))
