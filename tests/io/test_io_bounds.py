"""Files that would keep a reader busy without end are refused at once: in a process of its own, within a
second of reading and half a gigabyte of memory.
"""

from __future__ import annotations

import gzip
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest

from o3dls.errors import InputError
from o3dls.io.documents import parse_toml
from o3dls.io.images.volumes import NIFTI
from o3dls.io.images.voxels import inflate
from o3dls.io.mapping.archive import Archive
from o3dls.io.mapping.ensite import parse
from o3dls.io.markups import read_markups
from o3dls.io.points import read_points

# seconds of the processor, and bytes of the whole process with its libraries: what is refused costs no more
SLOWEST, MOST_MEMORY = 1.0, 500e6
READ = """
import resource, sys, time
from pathlib import Path
from o3dls.errors import O3dlsError
{imports}
begun = time.process_time()
try:
    {call}
except O3dlsError as error:
    seconds, peak = time.process_time() - begun, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    status = Path("/proc/self/status")  # where there is none, the peak may be that of the calling process
    lines = status.read_text().splitlines() if status.is_file() else []
    print(seconds, next((int(line.split()[1]) for line in lines if line.startswith("VmHWM")), peak) * 1024)
    print(error)
"""
PIPELINE = ("from o3dls.pipeline.file import read_pipeline", "read_pipeline(sys.argv[1])")
POINTS = ("from o3dls.io.points import read_points", "read_points(sys.argv[1])")
SURFACE = ("from o3dls.io.surfaces import read_surface", "read_surface(sys.argv[1])")
STUDY = ("from o3dls.io.mapping.study import read_study", "read_study(sys.argv[1], None)")


def refusal(reader: tuple[str, str], path: Path) -> str:
    """The sentence with which a file is refused."""
    code = READ.format(imports=reader[0], call=reader[1])
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, timeout=60, check=True
    )
    first, sentence = done.stdout.split("\n", 1)
    seconds, memory = map(float, first.split())
    assert seconds < SLOWEST
    assert memory < MOST_MEMORY
    return sentence


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("x = " + "[" * 5000 + "]" * 5000, "in each other more than 20 deep"),
        ("x = " + "{a = " * 300 + "1" + "}" * 300, "in each other more than 20 deep"),
        ("x = " + "[" * 50 + "]" * 50, "in each other more than 20 deep"),
        (".".join(["a"] * 30_000) + " = 1", "has a dotted key of more than 100 parts"),
        (f"[{'.'.join(['a'] * 30_000)}]", "has a dotted key of more than 100 parts"),
        (".".join(["a"] * 50_000) + " = 1", "has 100003 bytes: must be at most 65536"),
        ("folds = " + "9" * 5000, "has a whole number beyond 64 bits"),
        ("folds = 9223372036854775808", "has a whole number beyond 64 bits"),
        ('[[stage]]\nuse = "icp"\niterations = 1' + "0" * 30, "has a whole number beyond 64 bits"),
    ],
)
def test_pipelines(text: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "pipe.toml"
    path.write_text(text)
    assert sentence in refusal(PIPELINE, path)


def test_what_people_write_is_within_the_bounds() -> None:
    numbers = ", ".join(f"{k}.5" for k in range(500))
    text = f'out = "{"../" * 40}runs"\nlist = [{numbers}]\nwhole = -9223372036854775808\n'
    assert len(parse_toml(text, "pipe.toml")["list"]) == 500


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("x,y,z,name\n1,2,3," + "a" * 200_000, "line 2 has 200006 letters: must have at most 65536"),
        ("x,y,z\n1,2,3\n" + "1," * 10_000_000, "line 3 has 20000000 letters"),
        (
            ",".join(["x", "y", "z", *map(str, range(9_000))]) + "\n1,2,3\n",
            "line 1: names 9003 columns: at most 1000",
        ),
        (",".join(map(str, range(100_000))) + "\n", "line 1 has 588889 letters"),
    ],
)
def test_points(text: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(text)
    assert sentence in refusal(POINTS, path)


def test_files_of_many_gigabytes(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    with path.open("wb") as file:
        file.truncate(1 << 33)  # takes no room on the disk
    assert "has 8589934592 bytes: must be at most 67108864" in refusal(POINTS, path)


def test_cells_too_long_for_the_reader(tmp_path: Path) -> None:
    long = "a" * 200_000
    marks = tmp_path / "marks.fcsv"
    marks.write_text(f"# CoordinateSystem = LPS\n# columns = id,x,y,z,label\n1,2,3,4,{long}\n")
    with pytest.raises(InputError, match=r"marks\.fcsv: line 3: is not a line of cells: field larger"):
        read_markups(marks)
    for text in (f"roving x,y\n1,{long}\n", f"roving x,{long}\n"):
        with pytest.raises(InputError, match=r"map\.csv: line \d: is not a line of cells: field larger"):
            parse(tmp_path / "map.csv", text.encode(), ["roving x"])


def test_a_table_of_many_columns_is_read(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    extra = [f"c{k}" for k in range(900)]
    path.write_text(",".join(["x", "y", "z", *extra]) + "\n" + ",".join(["1"] * 903) + "\n")
    assert len(read_points(path).columns) == 900


def packed_zeros(gigabytes: int) -> bytes:
    """Gzip data that unpack to so many zeros; the same part over and over."""
    return gzip.compress(bytes(1 << 26), mtime=0) * (16 * gigabytes)


def nifti(shape: tuple[int, int, int], code: int) -> bytes:
    header = np.zeros(1, dtype=NIFTI)
    fields = {"sizeof_hdr": 348, "dim": [3, *shape, 1, 1, 1, 1], "datatype": code, "pixdim": np.ones(8)}
    for name, value in {**fields, "vox_offset": 352, "sform_code": 1, "magic": b"n+1"}.items():
        header[name] = value
    header["srow"] = np.eye(4)[:3]
    return header.tobytes() + bytes(4)


@pytest.mark.parametrize(
    ("shape", "code", "sentence"),
    [
        ((1024, 1024, 1024), 64, "has size [1024, 1024, 1024]: must be positive, at most 268435456 values"),
        ((512, 512, 1024), 64, "values of float64 take 2147483648 bytes: at most 1073741824; save labels as"),
        ((100, 100, 100), 2, "unpack to more than the 1000352 bytes that its header says: it is damaged"),
    ],
)
def test_a_nifti_that_unpacks_to_eight_gigabytes(
    shape: tuple[int, int, int], code: int, sentence: str, tmp_path: Path
) -> None:
    path = tmp_path / "la.nii.gz"
    path.write_bytes(gzip.compress(nifti(shape, code)) + packed_zeros(8))
    assert sentence in refusal(SURFACE, path)


@pytest.mark.parametrize("more", ["", "byte skip: 999999999999\n"])
@pytest.mark.parametrize("sizes", ["1000 1000 1000", "10 10 10"])
def test_an_nrrd_that_unpacks_to_gigabytes(more: str, sizes: str, tmp_path: Path) -> None:
    path = tmp_path / "la.nrrd"
    head = (
        f"NRRD0004\ntype: uchar\ndimension: 3\nspace: LPS\nsizes: {sizes}\nencoding: gzip\n{more}"
        "space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\n\n"
    )
    path.write_bytes(head.encode() + packed_zeros(8))
    said = refusal(SURFACE, path)
    large = "at most 268435456 values together; cut larger volumes to the heart"
    longer = "its packed data unpack to more than the"
    assert (large if sizes != "10 10 10" else longer) in said


def test_packed_data_in_very_many_parts(tmp_path: Path) -> None:
    data = gzip.compress(b"", mtime=0) * 50_000 + gzip.compress(b"wall")
    assert inflate(tmp_path, data, 100) == b"wall"


@pytest.mark.parametrize(
    ("announced", "sentence"),
    [
        (64, "packed data do not end after the 64 bytes that they say"),
        ((1 << 30) + 8, "a variable unpacks to 1073741832 bytes: at most"),
    ],
)
def test_an_openep_file_that_unpacks_to_gigabytes(announced: int, sentence: str, tmp_path: Path) -> None:
    pack = zlib.compressobj(9)
    tag = (14).to_bytes(4, "little") + announced.to_bytes(4, "little")
    packed = pack.compress(tag + bytes(64)) + b"".join(pack.compress(bytes(1 << 24)) for _ in range(32))
    packed += pack.flush()
    head = b"MATLAB 5.0 MAT-file".ljust(124, b" ") + b"\0\1IM"
    path = tmp_path / "study.mat"
    path.write_bytes(head + (15).to_bytes(4, "little") + len(packed).to_bytes(4, "little") + packed)
    assert sentence in refusal(STUDY, path)


def zipped(path: Path, name: str, content: bytes) -> Path:
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file,
        file.open(name, "w") as out,
    ):
        for k in range(0, len(content), 1 << 24):
            out.write(content[k : k + (1 << 24)])
    return path


@pytest.mark.parametrize("name", ["Study 1.xml", "Export/map.csv", "inner.zip"])
def test_a_zip_of_a_gigabyte_of_line_breaks(name: str, tmp_path: Path) -> None:
    path = zipped(tmp_path / "study.zip", name, b"\n" * 250_000_000)
    assert "to 250000000 bytes, as no file of a study does" in refusal(STUDY, path)


def test_a_large_file_of_a_study_is_read(tmp_path: Path) -> None:
    text = b"".join(b"%d,%d\n" % (k, k * k) for k in range(600_000))
    assert Archive.open(zipped(tmp_path / "study.zip", "waves.csv", text)).read("waves.csv") == text
