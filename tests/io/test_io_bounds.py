"""Files that would keep a reader busy without end are refused at once: in a process of its own, within a
second of reading and half a gigabyte of memory.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from o3dls.errors import InputError
from o3dls.io.documents import parse_toml
from o3dls.io.mapping.ensite import parse
from o3dls.io.markups import read_markups
from o3dls.io.points import read_points

# seconds of reading, and bytes of the whole process with its libraries: what is refused costs no more
SLOWEST, MOST_MEMORY = 1.0, 500e6
READ = """
import resource, sys, time
from pathlib import Path
from o3dls.errors import O3dlsError
{imports}
begun = time.perf_counter()
try:
    {call}
except O3dlsError as error:
    print(time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
    print(error)
"""
PIPELINE = ("from o3dls.pipeline.file import read_pipeline", "read_pipeline(sys.argv[1])")
POINTS = ("from o3dls.io.points import read_points", "read_points(sys.argv[1])")


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
    with pytest.raises(InputError, match=r"marks\.fcsv: line 3: is no line of cells: field larger"):
        read_markups(marks)
    for text in (f"roving x,y\n1,{long}\n", f"roving x,{long}\n"):
        with pytest.raises(InputError, match=r"map\.csv: line \d: is no line of cells: field larger"):
            parse(tmp_path / "map.csv", text.encode(), ["roving x"])


def test_a_table_of_many_columns_is_read(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    extra = [f"c{k}" for k in range(900)]
    path.write_text(",".join(["x", "y", "z", *extra]) + "\n" + ",".join(["1"] * 903) + "\n")
    assert len(read_points(path).columns) == 900
