"""Packed data have a checksum: with some bytes of it changed a file gives the same values, or is refused.

A changed byte may make the stream longer or shorter, so that the checksum is not where the values end.
"""

from __future__ import annotations

import base64
import gzip
import lzma
import re
import time
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from formats import lattice, write_as
from test_io_fuzz import SLOWEST, body

from o3dls.case import Points
from o3dls.errors import InputError
from o3dls.io.images.registry import read_image
from o3dls.io.images.volumes import write_volume
from o3dls.io.images.voxels import inflate
from o3dls.io.mapping.study import read_study
from o3dls.io.matlab import openep
from o3dls.io.surfaces import read_surface_file

FEW, MANY = 150, 2000  # damaged files of a format
MOST_FLIPS = 4


@dataclass(frozen=True)
class Target:
    """A whole file to read, the file that holds the packed data, and where they are in it."""

    read: Path
    holds: Path
    first: int
    last: int


def labels() -> np.ndarray:
    """A chamber of label 1 with a rough wall, and label 2 beside it (x, y, z)."""
    rng = np.random.default_rng(83_551)
    index = np.stack(np.indices((24, 22, 20)), axis=-1) - [11.0, 10.0, 9.5]
    wall = np.linalg.norm(index, axis=-1) + rng.normal(0.0, 0.6, index.shape[:-1])
    return np.where(wall < 7.0, 1, np.where(index[..., 0] > 8.0, 2, 0)).astype(np.uint8)


RAW = labels().tobytes(order="F")


def zipped(raw: bytes, level: int = 6) -> bytes:
    return gzip.compress(raw, level, mtime=0)


def behind(head: bytes, packed: bytes, path: Path) -> Target:
    path.write_bytes(head + packed)
    return Target(path, path, len(head), len(head) + len(packed))


def nrrd(folder: Path, packed: bytes, more: str = "") -> Target:
    head = (
        "NRRD0004\ntype: uchar\ndimension: 3\nspace: LPS\nsizes: 24 22 20\nencoding: gzip\n"
        "space directions: (1,0,0) (0,1,0) (0,0,2)\nspace origin: (0,0,0)\n"
    )
    return behind((head + more + "\n").encode(), packed, folder / "a.nrrd")


def nrrd_beside(folder: Path) -> Target:
    whole = nrrd(folder, b"", "data file: a.raw.gz\n")
    voxels = behind(b"", zipped(RAW), folder / "a.raw.gz")
    return Target(whole.read, voxels.holds, voxels.first, voxels.last)


def nifti(folder: Path, level: int) -> Target:
    write_volume(folder / "plain.nii", labels(), lattice(1.5, np.zeros(3)), space="LPS")
    return behind(b"", zipped((folder / "plain.nii").read_bytes(), level), folder / "a.nii.gz")


def pair(folder: Path, which: str) -> Target:
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.Nifti1Pair(labels(), np.eye(4)), folder / "plain.hdr")
    files = {
        end: behind(b"", zipped((folder / f"plain.{end}").read_bytes()), folder / f"a.{end}.gz")
        for end in ("hdr", "img")
    }
    return Target(files["hdr"].read, files[which].holds, 0, files[which].last)


def meta(folder: Path) -> Target:
    head = (
        b"ObjectType = Image\nNDims = 3\nBinaryData = True\nCompressedData = True\nDimSize = 24 22 20\n"
        b"ElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    )
    return behind(head, zlib.compress(RAW), folder / "a.mha")


def vtp(folder: Path, pack: Callable[[bytes], bytes], name: str) -> Target:
    """The array of points, as base64 behind a head of sizes."""
    path = write_as("vtp", folder, body())
    declared, _, appended = path.read_bytes().partition(b'<AppendedData encoding="raw">\n_')

    def again(found: re.Match[str]) -> str:
        begin = int(found[1])
        size = int(np.frombuffer(appended, "<u8", 4, begin)[3])
        raw = zlib.decompress(appended[begin + 32 : begin + 32 + size])
        packed = pack(raw)
        head = np.array([1, len(raw), 0, len(packed)], dtype="<u8").tobytes()
        both = base64.b64encode(head).decode() + base64.b64encode(packed).decode()
        return f'format="binary">{both}</DataArray>'

    text = declared.decode().replace("vtkZLibDataCompressor", name) + "</VTKFile>\n"
    text = re.sub(r'format="appended" offset="(\d+)"/>', again, text)
    path.write_text(text)
    first = text.index('format="binary">', text.index('Name="Points"')) + len('format="binary">')
    return Target(path, path, first, text.index("<", first))


def vtu(folder: Path, pack: Callable[[bytes], bytes], name: str) -> Target:
    """The same surface as cells of an unstructured grid."""
    found = vtp(folder, pack, name)
    text = found.read.read_text()
    types = np.full(len(body().faces), 5, dtype="u1").tobytes()
    packed = pack(types)
    head = np.array([1, len(types), 0, len(packed)], dtype="<u8").tobytes()
    array = base64.b64encode(head).decode() + base64.b64encode(packed).decode()
    cells = f'<DataArray type="UInt8" Name="types" format="binary">{array}</DataArray></Cells>'
    for old, new in (
        ("PolyData", "UnstructuredGrid"),
        ("<Polys>", "<Cells>"),
        ("</Polys>", cells),
        ("NumberOfPolys", "NumberOfCells"),
    ):
        text = text.replace(old, new)
    path = folder / "a.vtu"
    path.write_text(text)
    first = text.index('format="binary">', text.index('Name="connectivity"')) + len('format="binary">')
    return Target(path, path, first, text.index("<", first))


def study(folder: Path, member: str, method: int) -> Target:
    """A CARTO study in a zip, and the bytes of one file of it."""
    from test_io_study import carto_folder

    source = carto_folder(folder / "study")
    path = folder / "study.zip"
    with zipfile.ZipFile(path, "w", method) as file:
        for one in sorted(source.rglob("*")):
            file.write(one, one.relative_to(source).as_posix())
        info = file.getinfo(member)
    first = info.header_offset + 30 + len(info.filename.encode())
    return Target(path, path, first, first + info.compress_size)


def mat(folder: Path) -> Target:
    rng = np.random.default_rng(20_117)
    points = Points(rng.normal(size=(40, 3)), np.full(40, "eam"), {"bipolar": rng.uniform(0.0, 5.0, 40)})
    path = folder / "a.mat"
    path.write_bytes(openep.encode(body(), points))
    return Target(path, path, 136, path.stat().st_size)  # behind the head and the tag of the element


FORMATS: dict[str, Callable[[Path], Target]] = {
    "nrrd": lambda folder: nrrd(folder, zipped(RAW)),
    "nrrd stored": lambda folder: nrrd(folder, zipped(RAW, 0)),  # no syntax, that a changed byte could spoil
    "nrrd zlib": lambda folder: nrrd(folder, zlib.compress(RAW)),
    "nrrd parts": lambda folder: nrrd(
        folder, b"".join(zipped(RAW[k : k + 2640]) for k in range(0, 10560, 2640))
    ),
    "nrrd filled": lambda folder: nrrd(folder, zipped(RAW) + bytes(300)),
    "nrrd skip": lambda folder: nrrd(folder, zipped(b"comment" + RAW), "byte skip: 7\n"),
    "nrrd beside": nrrd_beside,
    "nii.gz": lambda folder: nifti(folder, 6),
    "nii.gz stored": lambda folder: nifti(folder, 0),
    "voxels of a pair": lambda folder: pair(folder, "img"),
    "header of a pair": lambda folder: pair(folder, "hdr"),
    "mha": meta,
    "vtp": lambda folder: vtp(folder, zlib.compress, "vtkZLibDataCompressor"),
    "vtp lzma": lambda folder: vtp(folder, lzma.compress, "vtkLZMADataCompressor"),
    "vtu": lambda folder: vtu(folder, zlib.compress, "vtkZLibDataCompressor"),
    "vtu lzma": lambda folder: vtu(folder, lzma.compress, "vtkLZMADataCompressor"),
    "mat": mat,
    "zip points": lambda folder: study(folder, "1-Map_car.txt", zipfile.ZIP_DEFLATED),
    "zip shell": lambda folder: study(folder, "1-Map.mesh", zipfile.ZIP_DEFLATED),
    "zip stored": lambda folder: study(folder, "1-Map.mesh", zipfile.ZIP_STORED),
    "zip bzip2": lambda folder: study(folder, "1-Map_car.txt", zipfile.ZIP_BZIP2),
    "zip lzma": lambda folder: study(folder, "1-Map_car.txt", zipfile.ZIP_LZMA),
}


def values(path: Path) -> list[Any]:
    """All that a file holds."""
    if path.suffix == ".mat":
        points = openep.read_points(path, path.read_bytes())
        return [points.xyz, *points.columns, *points.columns.values(), *surface(path)]
    if path.suffix in (".vtp", ".vtu"):
        return surface(path)
    if path.suffix == ".zip":
        found = read_study(path)
        columns = {name: column.tolist() for name, column in found.points.columns.items()}
        if found.shell is None:  # the points are taken, and the import says why the shell is not
            raise InputError("; ".join(found.left))
        shell = found.shell.surface
        return [found.points.xyz, repr(columns), shell.vertices, shell.faces, *found.landmarks.values()]
    image = read_image(path, path.read_bytes())
    return [image.values, image.affine, image.space]


def surface(path: Path) -> list[Any]:
    file = read_surface_file(path)
    return [file.surface.vertices, file.surface.faces, *file.surface.fields, *file.surface.fields.values()]


def equal(some: list[Any], others: list[Any]) -> bool:
    return len(some) == len(others) and all(map(np.array_equal, some, others))


def flipped(data: bytes, target: Target, rng: np.random.Generator) -> bytes:
    """One to four bytes of the packed data changed to others."""
    out = np.frombuffer(data, np.uint8).copy()
    count = min(rng.integers(1, MOST_FLIPS + 1), target.last - target.first)
    at = target.first + rng.choice(target.last - target.first, count, replace=False)
    out[at] ^= rng.integers(1, 256, count, dtype=np.uint8)
    return out.tobytes()


def damage(name: str, folder: Path, files: int) -> None:
    """Read so many damaged files of a format: each is refused or gives what the whole one does."""
    target = FORMATS[name](folder)
    known, data = values(target.read), target.holds.read_bytes()
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    for k in range(files):
        damaged = flipped(data, target, rng)
        target.holds.write_bytes(damaged)
        begun = time.process_time()
        try:
            same = equal(values(target.read), known)
        except InputError as error:
            same = str(target.read) in str(error) and "\n" not in str(error)
        assert same, f"{name}, file {k}: {damaged.hex() if len(damaged) < 2000 else len(damaged)}"
        assert time.process_time() - begun < SLOWEST


@pytest.mark.parametrize("name", FORMATS)
def test_packed_data_with_changed_bytes_are_refused_or_equal(name: str, tmp_path: Path) -> None:
    damage(name, tmp_path, FEW)


@pytest.mark.parametrize("name", FORMATS)
def test_two_thousand_files_of_each_format(name: str, tmp_path: Path) -> None:
    damage(name, tmp_path, MANY)


@pytest.mark.parametrize("more", [b"\1", bytes(1000), b"\1" * (1 << 20)])
def test_packed_voxels_that_go_on_are_refused(more: bytes, tmp_path: Path) -> None:
    for packed in (zipped(RAW + more), zipped(RAW) + zipped(more), zlib.compress(RAW + more)):
        with pytest.raises(InputError, match=r"a\.nrrd: its packed data unpack to more than the 10560 bytes"):
            values(nrrd(tmp_path, packed).read)


def test_packed_voxels_end_with_their_checksum(tmp_path: Path) -> None:
    packed = zipped(RAW)
    for short in (1, 4, 5, 8):
        with pytest.raises(InputError, match="have no end: the file is truncated"):
            values(nrrd(tmp_path, packed[:-short]).read)
    with pytest.raises(InputError, match=r"byte .* and those behind are no part of them"):
        values(nrrd(tmp_path, packed + bytes(9) + b"x").read)
    assert equal(
        values(nrrd(tmp_path, packed + zipped(b"") + bytes(9)).read), values(nrrd(tmp_path, packed).read)
    )


def test_what_unpacks_in_too_many_parts_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="are no part of them"):
        inflate(tmp_path, zipped(b"") * ((1 << 17) + 1), 100)


def test_a_vtp_file_holds_its_packed_arrays_raw_without_a_third_for_base64(tmp_path: Path) -> None:
    surface = body()
    path = write_as("vtp", tmp_path, surface)
    xyz, faces = surface.vertices.astype("<f8"), surface.faces.ravel().astype("<i4")
    needed = sum(len(zlib.compress(values.tobytes(), 1)) for values in (xyz, faces, *surface.fields.values()))
    head = path.read_bytes().index(b"<AppendedData")
    assert needed < path.stat().st_size - head < 1.1 * needed + 1000
