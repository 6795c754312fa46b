"""CARTO 3 `.mesh` files (TriangulatedMeshVersion2.0): a map's shell with its colours; real files are
rewritten byte for byte.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path

import numpy as np

from ...arrays import Array, Ints
from ...errors import InputError
from ..text import integers, is_count, join_rows, number_rows
from .surface_file import SurfaceFile

MISSING = -10_000.0
MAGIC = b"#TriangulatedMeshVersion2.0"
COLOURS = (
    "Unipolar",
    "Bipolar",
    "LAT",
    "Impedance",
    "A1",
    "A2",
    "A2-A1",
    "SCI",
    "ICL",
    "ACL",
    "Force",
    "Paso",
    "µBi",
)
OUR_NAMES = {
    "Unipolar": "unipolar",
    "Bipolar": "bipolar",
    "LAT": "lat",
    "Force": "force",
    "Impedance": "impedance",
}
RIGHTS = (
    "#TriangulatedMeshVersion2.0",
    "; Biosense Webster Triangulated Mesh file format, 2008",
    "; Rights Biosense Webster, LTD",
    "; http://www.biosensewebster.com",
)
ATTRIBUTE_HEADINGS = (
    ";            Scar   EML",
    "; Scar=0: Vertex is regular vertex (not scar)",
    ";     =1: Vertex has a scar attribute",
    "; EML =0: Vertex is regular vertex (not EML)",
    ";     =1: Vertex has a EML attribute",
)
SECTIONS = (
    "GeneralAttributes",
    "VerticesSection",
    "TrianglesSection",
    "VerticesColorsSection",
    "VerticesAttributesSection",
)


@dataclass(frozen=True, eq=False)
class CartoMesh:
    """All that a .mesh file says, as it says it: hidden triangles have groups below 0; colours (n, k) hold
    CARTO's own missing values.

    Colours have one column more than names, which has no name and is kept. Attribute headings are the comment
    lines of their section.
    """

    vertices: Array
    vertex_normals: Array
    vertex_groups: Ints
    triangles: Ints
    triangle_normals: Array
    triangle_groups: Ints
    colour_names: tuple[str, ...] = ()
    colours: Array = field(default_factory=lambda: np.zeros((0, 0)))
    attribute_headings: tuple[str, ...] = ATTRIBUTE_HEADINGS
    attributes: Ints = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    mesh_id: str = "-1"
    mesh_name: str = ""
    topology: str = "0"
    mesh_colour: tuple[float, ...] = (0.0, 1.0, 0.0, 1.0)
    matrix: tuple[float, ...] = tuple(np.eye(4).ravel())


def knows(data: bytes) -> bool:
    return data.lstrip(b"\xef\xbb\xbf")[: len(MAGIC)] == MAGIC


def read(path: Path, data: bytes, *, hidden: bool = False) -> SurfaceFile:
    """The visible shell in mm; `hidden` keeps triangles of negative groups too. Vertices without a triangle
    are left out.
    """
    mesh = parse(path, data)
    if not np.allclose(mesh.matrix, np.eye(4).ravel()):
        raise InputError(
            f"{path}: its Matrix is not the identity, which o3dls has never seen proven; apply it with "
            "the system's own tools"
        )
    triangles = mesh.triangles if hidden else mesh.triangles[mesh.triangle_groups >= 0]
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    used = np.unique(triangles)
    if len(used) and (used[0] < 0 or used[-1] >= len(mesh.vertices)):
        raise InputError(
            f"{path}: triangles name vertices {used[0]} to {used[-1]}: there are {len(mesh.vertices)}, "
            "counted from 0"
        )
    index = np.zeros(len(mesh.vertices), dtype=np.int64)
    index[used] = np.arange(len(used))
    fields = {
        OUR_NAMES.get(name, name): present(mesh.colours[used, k]) for k, name in enumerate(mesh.colour_names)
    }
    flags = mesh.attributes[used].astype(np.float64) if len(mesh.attributes) else np.zeros((len(used), 0))
    fields |= {
        name: flags[:, k]
        for k, name in enumerate(mesh.attribute_headings[0].lstrip(" ;").split()[: flags.shape[1]])
    }
    # slots that CARTO leaves empty
    fields = {name: values for name, values in fields.items() if np.nan_to_num(values).any()}
    facts = {
        "name": mesh.mesh_name,
        "hidden_triangles": len(mesh.triangles) - len(triangles),
        "vertex_rows": used,
    }
    return SurfaceFile.of(path, mesh.vertices[used], index[triangles], fields, units="mm", metadata=facts)


def present(values: Array) -> Array:
    """NaN for the values that mean `none`: -10000, and +10000 in some exports."""
    return np.where(np.abs(values) >= -MISSING, np.nan, values)


def parse(path: Path, data: bytes) -> CartoMesh:
    """Everything in the file. Raises InputError naming the line that does not fit."""
    sections = _sections(path, _decode(data))
    lines = sections["GeneralAttributes"].text.splitlines()
    general = {key.strip(): value for key, _, value in (line.partition("=") for line in lines)}
    n, m, k = (_count(path, general, key) for key in ("NumVertex", "NumTriangle", "NumVertexColors"))
    vertices = _rows(path, sections, "VerticesSection", n, 8)
    triangles = _rows(path, sections, "TrianglesSection", m, 8)
    names = tuple(general.get("ColorsNames", "").split()) if k else ()
    if len(names) != k:
        raise InputError(f"{path}: NumVertexColors = {k}, but ColorsNames has {len(names)} names")
    colours = _rows(path, sections, "VerticesColorsSection", n, 1 + k)[:, 1:] if k else np.zeros((n, 0))
    attributes, headings = _attributes(path, sections, n)
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
        _floats(path, general, "MeshColor", 4, (0.0, 1.0, 0.0, 1.0)),
        _floats(path, general, "Matrix", 16, tuple(np.eye(4).ravel())),
    )


def _decode(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


@dataclass(frozen=True)
class Section:
    """Text of a section below its heading, and the line where that begins."""

    text: str
    line: int


def _sections(path: Path, text: str) -> dict[str, Section]:
    sections: dict[str, Section] = {}
    headings = list(re.finditer(r"^\[([^\]\n]*)\][^\n]*\n?", text, re.MULTILINE))
    for heading, after in zip_longest(headings, headings[1:]):
        line = text.count("\n", 0, heading.end()) + 1
        if heading[1] in sections:
            raise InputError(f"{path}: line {line - 1}: section [{heading[1]}] is there twice")
        sections[heading[1]] = Section(text[heading.end() : after.start() if after else len(text)], line)
    for name in SECTIONS[:3]:
        if name not in sections:
            raise InputError(f"{path}: has no section [{name}]; the file is truncated or of another version")
    return sections


def _count(path: Path, general: dict[str, str], key: str) -> int:
    text = general.get(key, "0" if key == "NumVertexColors" else "").strip()
    if not is_count(text):
        raise InputError(f"{path}: {key} = '{text[:20]}' must be a count")
    return int(text)


def _floats(
    path: Path, general: dict[str, str], key: str, n: int, default: tuple[float, ...]
) -> tuple[float, ...]:
    if key not in general:
        return default
    return tuple(number_rows([general[key]], n, path, [0], key)[0].tolist())


def _rows(path: Path, sections: dict[str, Section], name: str, n: int, least: int) -> Array:
    """The rows `index = numbers` of a section, (n, 1 + columns), with at least `least` columns and nothing
    left out.
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


def _attributes(path: Path, sections: dict[str, Section], n: int) -> tuple[Ints, tuple[str, ...]]:
    """Flags per vertex and the comment lines above them, of which the first names the columns."""
    text = sections.get("VerticesAttributesSection", Section("", 0)).text
    headings = (
        tuple(line.rstrip("\r") for line in re.findall(r"^[ \t]*;[^\n]*", text, re.MULTILINE))
        or ATTRIBUTE_HEADINGS
    )
    if not re.search(r"^[ \t]*\d+[ \t]*=", text, re.MULTILINE):
        return np.zeros((0, 2), dtype=np.int64), headings
    return integers(
        _rows(path, sections, "VerticesAttributesSection", n, 2)[:, 1:],
        f"{path}: [VerticesAttributesSection]",
    ), headings


def encode(mesh: CartoMesh) -> bytes:
    """The file as CARTO prints it: CRLF, cp1252, its blank lines, and its glued colour heading."""
    blocks = [
        "".join(f"{line}\n" for line in RIGHTS),
        "[GeneralAttributes]\n" + "".join(f"{key:<23s}= {value}\n" for key, value in _general(mesh)),
        "[VerticesSection]\n;                   X             Y             Z        NormalX   NormalY   "
        "NormalZ  GroupID\n",
        _numbered(
            " %13.3f %13.3f %13.3f   %9.5f %9.5f %9.5f %8d",
            mesh.vertices,
            mesh.vertex_normals,
            mesh.vertex_groups,
        ),
        "[TrianglesSection]\n;           Vertex0  Vertex1  Vertex2     NormalX   NormalY   NormalZ  "
        "GroupID\n",
        _numbered(
            " %8d %8d %8d   %9.5f %9.5f %9.5f %8d",
            mesh.triangles,
            mesh.triangle_normals,
            mesh.triangle_groups,
        ),
    ]
    if mesh.colour_names:
        names = "".join(f"{name:>14s}" for name in mesh.colour_names)
        heading = (
            "; Color Value= -10000 indicates invalid data for this coloring for this point\n;     "
            f"     {names}[ColorsScaleSection]\n"
        )
        blocks += [
            "[VerticesColorsSection]\n" + heading,
            _numbered(" " + " %13.5f" * mesh.colours.shape[1], mesh.colours),
        ]
    flags = _numbered(" " + "%6d" * mesh.attributes.shape[1], mesh.attributes)
    blocks.append(
        "[VerticesAttributesSection]\n" + "".join(f"{line}\n" for line in mesh.attribute_headings) + flags
    )
    text = "\n".join(blocks).replace("\n", "\r\n")
    return text.encode() if text.isascii() else text.encode("cp1252", errors="replace")


def _numbered(form: str, *columns: Array | Ints) -> str:
    """Rows `index = numbers`, indices counted from 0."""
    table = np.column_stack([np.arange(len(columns[0])), *columns])
    return join_rows(f"%8d ={form}\n", table)


def _general(mesh: CartoMesh) -> list[tuple[str, str]]:
    """The keys of the first section, in CARTO's order."""
    k = len(mesh.colour_names)
    colours = [
        ("ColorsIDs", "".join(f"{i}  " for i in range(k))),
        ("ColorsNames", "".join(f"{name}  " for name in mesh.colour_names)),
    ]
    return [
        ("MeshID", mesh.mesh_id),
        ("MeshName", mesh.mesh_name),
        ("NumVertex", str(len(mesh.vertices))),
        ("NumTriangle", str(len(mesh.triangles))),
        ("TopologyStatus", mesh.topology),
        ("MeshColor", "".join(f"{value:.5f}   " for value in mesh.mesh_colour)),
        ("Matrix", " ".join(f"{value:g}" for value in mesh.matrix)),
        ("NumVertexColors", str(k)),
        *(colours if k else []),
    ]


def write(file: SurfaceFile) -> bytes:
    """Encode a surface; fields that CARTO has a colour or a flag for are kept, missing values become -10000,
    others are lost.
    """
    surface = file.surface
    n = len(file.surface.vertices)
    found = {name: surface.fields.get(OUR_NAMES.get(name, name)) for name in COLOURS}
    columns = [
        np.full(n, MISSING) if v is None or v.ndim > 1 else np.where(np.isfinite(v), v, MISSING)
        for v in found.values()
    ]
    flags = [np.nan_to_num(surface.fields.get(name, np.zeros(n))) for name in ("Scar", "EML")]
    coloured = any(values is not None for values in found.values())
    mesh = CartoMesh(
        surface.vertices,
        surface.vertex_normals,
        np.zeros(n, dtype=np.int64),
        surface.faces,
        surface.face_normals,
        np.zeros(len(surface.faces), dtype=np.int64),
        COLOURS if coloured else (),
        np.column_stack([*columns, np.full(n, MISSING)]),
        attributes=np.column_stack(flags).astype(np.int64) if coloured else np.zeros((0, 2), dtype=np.int64),
    )
    return encode(mesh)
