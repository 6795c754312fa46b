"""A CARTO 3 `.mesh` file (TriangulatedMeshVersion2.0) read section by section."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import numpy as np

from ....arrays import Array, Ints
from ....errors import InputError
from ...text import decode, integers, is_count, number_rows
from .mesh import ATTRIBUTE_HEADINGS, CartoMesh

SECTIONS = (
    "GeneralAttributes",
    "VerticesSection",
    "TrianglesSection",
    "VerticesColorsSection",
    "VerticesAttributesSection",
)


def parse(path: Path, data: bytes) -> CartoMesh:
    """Parse everything in the file. Raises InputError naming the line that does not fit."""
    sections = _split_sections(path, decode(data, path))
    lines = sections["GeneralAttributes"].text.splitlines()
    general = {key.strip(): value for key, _, value in (line.partition("=") for line in lines)}
    n, m, k = (_read_count(path, general, key) for key in ("NumVertex", "NumTriangle", "NumVertexColors"))
    vertices = _read_rows(path, sections, "VerticesSection", n, 8)
    triangles = _read_rows(path, sections, "TrianglesSection", m, 8)
    names = tuple(general.get("ColorsNames", "").split())
    if len(names) != k:
        raise InputError(f"{path}: NumVertexColors = {k}, but ColorsNames has {len(names)} names")
    colours = _read_rows(path, sections, "VerticesColorsSection", n, 1 + k)[:, 1:] if k else np.zeros((n, 0))
    attributes, headings = _read_attributes(path, sections, n)
    return CartoMesh(
        vertices[:, 1:4],
        vertices[:, 4:7],
        integers(vertices[:, 7], f"{path}: GroupID"),
        integers(triangles[:, 1:4], f"{path}: [TrianglesSection]"),
        triangles[:, 4:7],
        integers(triangles[:, 7], f"{path}: GroupID"),
        names,
        colours,
        headings,
        attributes,
        general.get("MeshID", "-1").strip(),
        general.get("MeshName", "").strip(),
        general.get("TopologyStatus", "0").strip(),
        _read_floats(path, general, "MeshColor", 4, (0.0, 1.0, 0.0, 1.0)),
        _read_floats(path, general, "Matrix", 16, tuple(np.eye(4).ravel())),
    )


@dataclass(frozen=True)
class Section:
    """A section has the text below its heading, and the number of the line where that begins."""

    text: str
    line: int


def _split_sections(path: Path, text: str) -> dict[str, Section]:
    sections: dict[str, Section] = {}
    headings = list(re.finditer(r"^\[([^\]\n]*)\][^\n]*\n?", text, re.MULTILINE))
    for heading, after in zip_longest(headings, headings[1:]):
        line = text.count("\n", 0, heading.end()) + 1
        if heading[1] in sections:
            raise InputError(f"{path}: line {line - 1}: section [{heading[1]}] appears twice")
        sections[heading[1]] = Section(text[heading.end() : after.start() if after else len(text)], line)
    for name in SECTIONS[:3]:
        if name not in sections:
            raise InputError(f"{path}: has no section [{name}]; the file is truncated or of another version")
    return sections


def _read_count(path: Path, general: dict[str, str], key: str) -> int:
    text = general.get(key, "0" if key == "NumVertexColors" else "").strip()
    if not is_count(text):
        raise InputError(f"{path}: {key} = '{text[:20]}' must be a count")
    return int(text)


def _read_floats(
    path: Path, general: dict[str, str], key: str, n: int, default: tuple[float, ...]
) -> tuple[float, ...]:
    if key not in general:
        return default
    return tuple(number_rows([general[key]], n, path, [0], key)[0].tolist())


def _read_rows(path: Path, sections: dict[str, Section], name: str, n: int, least: int) -> Array:
    """Read the rows `index = numbers` of a section, (n, 1 + columns), with nothing left out.

    There must be at least `least` columns.
    """
    section = sections.get(name, Section("", 0))
    first = re.search(r"^[ \t]*[^;\s]", section.text, re.MULTILINE)
    start = first.start() if first else len(section.text)
    lines = section.text[start:].replace("=", " ").splitlines()
    lines = [
        line
        for line in lines
        if line and not line.isspace() and not (line[0] == ";" or line.lstrip()[0] == ";")
    ]
    at = section.line + section.text.count("\n", 0, start)
    if len(lines) != n:
        raise InputError(
            f"{path}: line {at}: [{name}] has {len(lines)} rows, {n} are declared; the file is truncated "
            "or damaged"
        )
    if not lines:
        return np.zeros((0, least))
    width = len(lines[0].split())
    if width < least:
        raise InputError(f"{path}: line {at}: [{name}] row has {width} numbers: must be {least}")
    rows = number_rows(lines, width, path, range(at, at + n), f"[{name}] row")
    wrong = np.flatnonzero(rows[:, 0] != np.arange(n))
    if len(wrong):
        raise InputError(
            f"{path}: line {at + wrong[0]}: row is numbered {rows[wrong[0], 0]:g}: must be {wrong[0]}"
        )
    return rows


def _read_attributes(path: Path, sections: dict[str, Section], n: int) -> tuple[Ints, tuple[str, ...]]:
    """Read flags per vertex and the comment lines above them, of which the first names the columns."""
    text = sections.get("VerticesAttributesSection", Section("", 0)).text
    headings = (
        tuple(line.rstrip("\r") for line in re.findall(r"^[ \t]*;[^\n]*", text, re.MULTILINE))
        or ATTRIBUTE_HEADINGS
    )
    if not re.search(r"^[ \t]*\d+[ \t]*=", text, re.MULTILINE):
        return np.zeros((0, 2), dtype=np.int64), headings
    return integers(
        _read_rows(path, sections, "VerticesAttributesSection", n, 2)[:, 1:],
        f"{path}: [VerticesAttributesSection]",
    ), headings
