"""EnSite DIF files: shells that Abbott's mapping systems export and import; one scalar per vertex, polygons
counted from 1.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import Doubt, InputError, choices, did_you_mean
from ...geometry.similarity import TURN
from ...geometry.surface import Surface
from ..text import flat_numbers, join_rows
from .surface_file import SurfaceFile, left_out

# what the importing system takes, as MUSIC's authors found in 2016
LIMITS = {
    "vertices": 100_000,
    "triangles": 200_000,
}
UNSAMPLED = 2
ARRAYS = (
    "Vertices",
    "Map_data",
    "Map_color",
    "Color_high_low",
    "Map_status",
    "Normals",
    "Polygons",
    "Surface_of_origin",
)
PATIENT = (
    "PatientName",
    "PatientID",
    "PatientBirthDate",
    "PatientGender",
    "StudyID",
    "SeriesNumber",
    "StudyDate",
    "StudyTime",
)
OTHERS = (
    "SeriesTime",
    "Modality",
    "RefPhyName",
    "StudyDesc",
    "SeriesDesc",
    "OperatorName",
    "OperatorComments",
    "SegmentationDate",
)
NAMED_BY = "Data values at each vertex of DxL map"
STATUS = " Map_status for each vertex: 0 = good, 1 = scar, 2 = unsampled/interpolated "


def knows(data: bytes) -> bool:
    return b"<DIF" in data[:2000]


def volumes_of(path: Path, data: bytes) -> list[str]:
    """Return the names of the volumes of a file, by which `read` takes one."""
    return list(_name_volumes(parse_xml(path, data)))


def read(path: Path, data: bytes, *, part: str | None = None) -> SurfaceFile:
    """Read one volume of the file, in mm and LPS; its labels are metadata. Raises InputError where `part`
    must say which volume.
    """
    root = parse_xml(path, data)
    volumes = _name_volumes(root)
    if not volumes:
        raise InputError(f"{path}: DIF holds no <Volume>")
    if part is None and len(volumes) > 1:
        advice = f"say which with --part: {', '.join(volumes)}"
        raise Doubt(f"{path}: holds {len(volumes)} volumes", advice, choices("part", list(volumes)))
    if part is not None and part not in volumes:
        raise InputError(f"{path}: has no volume '{part}'" + did_you_mean(part, list(volumes)))
    name = part or next(iter(volumes))
    volume = volumes[name]
    where = f"{path}: volume '{name}'"
    vertices = _parse_rows(volume, "Vertices", 3, where)
    polygons = _parse_rows(volume, "Polygons", 3, where)
    labels = {
        label.get("name", ""): _parse_numbers(label.text, f"{path}: label").tolist()
        for label in root.iterfind("DIFBody/Labels/Label")
    }
    facts = {
        "name": name,
        "labels": {k: v for k, v in labels.items() if len(v) == 3},
        "version": root.findtext("DIFHeader/Version", ""),
    }
    file = SurfaceFile.of(path, vertices, polygons - 1, _read_fields(volume, len(vertices), where))
    return replace(file, space="LPS", units="mm", metadata=facts)


def parse_xml(path: Path, data: bytes) -> ElementTree.Element:
    """Parse the XML tree with its comments, since one of them names the scalar."""
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    try:
        return ElementTree.fromstring(data, parser)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(
            f"{path}: is not well-formed XML: {error}; the file is truncated or damaged"
        ) from None


def _name_volumes(root: ElementTree.Element) -> dict[str, ElementTree.Element]:
    """Return the volumes by name; those that share one are told apart by their number."""
    found = root.findall("DIFBody/Volumes/Volume")
    names = [volume.get("name", f"volume {k}") for k, volume in enumerate(found)]
    return {
        name if names.count(name) == 1 else f"{name} (volume {k})": found[k] for k, name in enumerate(names)
    }


def _parse_numbers(text: str | None, where: str) -> Array:
    text = text or ""
    return flat_numbers(text, len(text.split()), where)


def _parse_rows(volume: ElementTree.Element, tag: str, width: int, where: str) -> Array:
    """Parse all rows of an array; its `number` is not believed, since exports are known to state twice too
    many.
    """
    element = volume.find(tag)
    values = _parse_numbers(element.text if element is not None else None, f"{where}: <{tag}>")
    if len(values) == 0 or len(values) % width:
        raise InputError(f"{where}: <{tag}> holds {len(values)} numbers: must be rows of {width}")
    return values.reshape(-1, width)


def _read_fields(volume: ElementTree.Element, n: int, where: str) -> dict[str, Array]:
    """Read the scalar, named by the comment before it, missing where it was not sampled; and the status
    itself.
    """
    fields: dict[str, Array] = {}
    comment = ""
    for element in volume:
        if element.tag not in ARRAYS:  # a comment: its tag is a function
            comment = element.text or ""
        elif element.tag in ("Map_data", "Map_status"):
            values = _parse_numbers(element.text, f"{where}: <{element.tag}>")
            if len(values) != n:
                raise InputError(
                    f"{where}: <{element.tag}> holds {len(values)} values: there are {n} vertices"
                )
            named = re.search(rf"{NAMED_BY}\s+(.+)", comment)
            fields[
                _field_name(named[1].strip() if named else "map")
                if element.tag == "Map_data"
                else "map_status"
            ] = values
    unsampled = fields.get("map_status", np.zeros(n)) == UNSAMPLED
    return {
        name: values if name == "map_status" else np.where(unsampled, np.nan, values)
        for name, values in fields.items()
    }


def _field_name(text: str) -> str:
    return "lat" if re.match(r"LAT\b", text, re.IGNORECASE) else text  # "LAT Isochronal"


def write(file: SurfaceFile) -> bytes:
    """Encode with the first scalar field (version 5.0), or the bare shell (version 3.0, which the system
    imports).
    """
    return encode(file.surface, field=_first_field(file.surface), space=file.space)


def _first_field(surface: Surface) -> str | None:
    return next((k for k, values in surface.fields.items() if values.ndim == 1 and k != "map_status"), None)


def losses(surface: Surface) -> list[str]:
    """Return sentences on what `write` does not keep; where values are missing the status says so."""
    return left_out(surface, (_first_field(surface), "map_status"))


def encode(surface: Surface, *, field: str | None = None, name: str = "surface", space: str = "LPS") -> bytes:
    """Encode the file, in LPS as DIF is (a surface in RAS is turned), de-identified: header fields that could
    name a patient say NA.

    Raises InputError in 2D.
    """
    if surface.dimension != 3:
        raise InputError("DIF files hold surfaces in 3D")
    surface = surface.transformed(TURN) if space == "RAS" else surface
    header = (
        "".join(f"    <{key}>NA</{key}>\n" for key in ("VendorVersion", *PATIENT, *OTHERS))
        + "    <Inventor>1</Inventor>\n"
    )
    return "".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>\n<DIF>\n  <DIFHeader>\n',
            f"    <Version>SJM_DIF_{'3.0' if field is None else '5.0'}</Version>\n{header}  </DIFHeader>\n  "
            "<DIFBody>\n",
            f'    <Volumes number="1">\n      <Volume name={quoteattr(name)} color="CC0000FF">\n',
            _encode_array("Vertices", "%.4f %.4f %.4f\n", surface.vertices),
            _encode_array("Normals", "", np.zeros(0)) if field is None else _encode_field(surface, field),
            _encode_array("Polygons", "%d %d %d\n", surface.faces + 1),
            "" if field is None else _encode_array("Surface_of_origin", "%d\n", np.zeros(len(surface.faces))),
            '      </Volume>\n    </Volumes>\n    <Labels number="0">tag</Labels>\n    <ObjectMap>\n',
            f"      <Rotation>{' '.join(['0.000000'] * 9)}</Rotation>\n",
            "      <Translation>0 0 0</Translation>\n      <Scaling>1 1 1</Scaling>\n      "
            "<MD5Signature>0</MD5Signature>\n",
            "    </ObjectMap>\n  </DIFBody>\n</DIF>\n",
        ]
    ).encode()


def _encode_array(tag: str, form: str, rows: NDArray[Any]) -> str:
    return f'        <{tag} number="{len(rows)}">\n{join_rows(form, rows)}</{tag}>\n'


def _encode_field(surface: Surface, field: str) -> str:
    """Encode the scalar with its name, 0 where it is missing, and the status that says so."""
    if field not in surface.fields:
        raise InputError(f"the surface has no field '{field}'" + did_you_mean(field, list(surface.fields)))
    values = surface.fields[field]
    known = np.isfinite(values)
    return "".join(
        [
            f"        <!-- {NAMED_BY} {escape(field).replace('--', '- -')} -->\n",
            _encode_array("Map_data", "%.4f\n", np.where(known, values, 0.0)),
            f"        <!--{STATUS}-->\n",
            _encode_array("Map_status", "%d\n", np.where(known, 0, UNSAMPLED)),
            _encode_array("Normals", "%.5f %.5f %.5f\n", surface.vertex_normals),
        ]
    )
