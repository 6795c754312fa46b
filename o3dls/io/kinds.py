"""Files that people have and that are not read: how each begins, what it is, and what to do."""

from __future__ import annotations

import re
import zlib
from contextlib import suppress

SURFACE = "save it as PLY, VTP or STL"
VOLUME = "save it as NIfTI or NRRD"
ARRAYS = "give its arrays in Python: o3dls.surface_of and o3dls.points_of"
# files that people have and that are not read: how each begins, what it is, what to do
KINDS = (
    (rb"\s*(<\?xml.{0,200}?)?(<!DOCTYPE.{0,200}?)?<GIFTI\b", "a GIFTI surface (.gii)", SURFACE),
    (rb"\xff\xff[\xfe\xff]", "a surface of FreeSurfer", SURFACE),
    (rb"\x00\x00\x00\x01(\x00\x00..){3}", "a volume of FreeSurfer (.mgh, .mgz)", VOLUME),
    (rb"glTF", "a glTF binary (.glb)", SURFACE),
    (rb"\s*\{.{0,2000}?\"asset\"\s*:", "glTF (.gltf)", SURFACE),
    (rb"\x93NUMPY", "an array of numpy (.npy)", ARRAYS),
    (rb"PK\x03\x04.{26}[\w./-]+\.npy", "arrays of numpy (.npz)", ARRAYS),
    (rb"PK\x03\x04.{26}(3D/|_rels|\[Content)", "a document in a zip (.3mf, .xlsx, .docx)", SURFACE),
    (rb"PK\x03\x04", "a zip", "unpack it and name the file"),
    (
        rb"\x89HDF\r\n\x1a\n",
        "HDF5 (.h5, MINC .mnc or another)",
        "export the surface as PLY, a volume as NIfTI",
    ),
    (rb"CDF[\x01\x02\x05]", "netCDF, such as a MINC volume (.mnc)", VOLUME),
    (rb"Kaydara FBX Binary", "FBX", SURFACE),
    (rb"\s*MeshVersionFormatted", "a mesh of Medit or Gmsh (.mesh)", SURFACE),
    (rb"\$MeshFormat", "a mesh of Gmsh (.msh)", SURFACE),
    (
        rb"#TriangulatedMeshVersion(?!2\.0)",
        "a CARTO mesh of another version than 2.0",
        "export it from CARTO 3 again",
    ),
    (rb"7z\xbc\xaf|Rar!", "a packed archive", "unpack it and name the file"),
    (rb"%PDF", "a PDF", "give the data themselves"),
    (rb"\x80[\x02-\x05].{0,20}", "a pickle of Python", ARRAYS),
)


def kind_of(data: bytes) -> str:
    """Return what a file of a kind that is not read is, with what to do about it; empty where it is not
    known.
    """
    begin = data[:4000]
    if begin[:2] == b"\x1f\x8b":
        with suppress(zlib.error):
            begin = zlib.decompressobj(wbits=31).decompress(begin, 2000)
    return next((f"{kind}; {remedy}" for sign, kind, remedy in KINDS if re.match(sign, begin, re.DOTALL)), "")
