"""What a shape, its pieces and its amount are called in two dimensions and in three."""

from __future__ import annotations

from dataclasses import dataclass

from .subject import Subject


@dataclass(frozen=True)
class ShapeWords:
    shape: str
    pieces: str
    amount: str


FLAT = ShapeWords("outline", "lines", "area")
SOLID = ShapeWords("surface", "faces", "volume")


def words_of(subject: Subject) -> ShapeWords:
    """Return the words for the dimension of the subject's case."""
    return FLAT if subject.case.dimension == 2 else SOLID
