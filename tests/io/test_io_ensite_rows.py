"""DxL exports of EnSite Velocity and Precision: a row for each quantity, a column for each point."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from o3dls.errors import InputError
from o3dls.io.mapping.ensite_rows import read_part
from o3dls.io.mapping.study import read_study

XYZ = np.array([[1.5, 2, 3], [4, 5, 6], [7, 8, -9.25], [10, 11, 12], [13, 14, 15]])
TAIL = "Seg data len:,1.0\nSample rate:,1000\nrov trace:,A,B\n,0.1,0.2\n\nFFT spectrum\nEOF\n"


def rows(
    xyz: np.ndarray,
    part: str = "1 of 1",
    name: str = "LA SR",
    used: Sequence[object] | None = None,
    numbers: Sequence[object] | None = None,
) -> str:
    """One file of a map, as it is exported, with 1.2 mV and 50 ms at each point."""
    n = len(xyz)
    table = {
        "pt number": range(1, n + 1) if numbers is None else numbers,
        "rov trace": ["HD 1-2"] * n,
        "ref LAT": [100.5] * n,
        "rov LAT": [100.55] * n,
        "peak2peak": [1.2] * n,
        **{f"roving {axis}": column for axis, column in zip("xyz", xyz.T, strict=True)},
        "surfPt x": [99.0] * n,
        "utilized": [1] * n if used is None else used,
    }
    head = (
        f"St. Jude Medical. File Revision : 5.2.0\nTotal number of data points (columns):,{n}\n"
        f"This is file {part} for map,{name}\nBegin data\n"
    )
    return head + "".join(f"{key}:,{','.join(map(str, cells))}\n" for key, cells in table.items()) + TAIL


def test_a_map_over_several_files_is_one(tmp_path: Path) -> None:
    (tmp_path / "DxL_2.csv").write_text(rows(XYZ[3:], "2 of 2"))
    (tmp_path / "DxL_1.csv").write_text(rows(XYZ[:3], "1 of 2"))
    found = read_study(tmp_path)
    np.testing.assert_array_equal(found.points.xyz, XYZ)
    assert found.name == "LA SR"
    np.testing.assert_allclose(found.points.columns["bipolar"], 1.2)
    np.testing.assert_allclose(found.points.columns["lat"], 50.0)
    assert set(found.points.columns) == {"bipolar", "lat"}


@pytest.mark.parametrize(
    ("parts", "sentence"),
    [
        (("1 of 3", "3 of 3"), r"is of map 'LA SR', which is in 3 files: .* there are 1, 3; name the folder"),
        (("1 of 2", "1 of 2"), "there are 1, 1;"),
        (("2 of 2",), "there are 2;"),
    ],
)
def test_a_map_without_all_of_its_files_is_refused(
    parts: Sequence[str], sentence: str, tmp_path: Path
) -> None:
    for k, part in enumerate(parts):
        (tmp_path / f"DxL_{k}.csv").write_text(rows(XYZ, part))
    with pytest.raises(InputError, match=sentence):
        read_study(tmp_path)


def test_points_that_are_not_used_are_left_and_need_no_place(tmp_path: Path) -> None:
    xyz = XYZ.astype(object)
    xyz[1, 2] = "1.#QNAN"
    (tmp_path / "DxL_1.csv").write_text(rows(xyz, used=[1, 0, 1, 0, 1]))
    np.testing.assert_array_equal(read_study(tmp_path).points.xyz, XYZ[::2])
    (tmp_path / "DxL_1.csv").write_text(rows(xyz))
    with pytest.raises(InputError, match=r"DxL_1\.csv: column 3: position .* is not finite"):
        read_study(tmp_path)


def test_each_map_of_a_study_has_a_folder_and_its_own_shell(tmp_path: Path) -> None:
    for folder, name, shift in (("a", "LA SR", 0.0), ("b", "RA", 500.0)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "DxL_1.csv").write_text(rows(XYZ + shift, name=name))
    for called in ("RA", "b"):
        np.testing.assert_array_equal(read_study(tmp_path, called).points.xyz, XYZ + 500.0)
    assert "a/DxL_1.csv" in read_study(tmp_path, "RA").left
    with pytest.raises(InputError, match=r"say which .* LA SR \(a/DxL_1\.csv, 5 points\), RA"):
        read_study(tmp_path)
    with pytest.raises(InputError, match="no map 'x': there are LA SR"):
        read_study(tmp_path, "x")


@pytest.mark.parametrize("comma", [";", "\t", ","])
def test_the_tables_that_spreadsheets_save_again_are_the_same(comma: str) -> None:
    text = rows(XYZ)
    other = text.replace(",", comma)
    if comma == ";":
        other = other.replace(".", ",").replace("Medical,", "Medical.")
    part = read_part(Path("DxL_1.csv"), other.replace("\n", f"{comma}\r\n").encode("utf-16"))
    np.testing.assert_array_equal(part.points.xyz, XYZ)
    np.testing.assert_allclose(part.points.columns["bipolar"], 1.2)
    assert (part.map_name, part.part, part.parts) == ("LA SR", 1, 1)


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (lambda text: text[: text.index("utilized")], "ends within the rows of points"),
        (lambda text: text[: text.index("Seg data")], "ends within the rows of points"),
        (lambda text: text.replace(",5\nThis", ",6\nThis"), "states 6 points and holds 5"),
        (lambda text: text.replace("roving z:", "roving w:"), "has no line 'roving z:'"),
        (lambda text: text.replace("1.5,", "1.5,1,"), r"'roving x' has 6 cells: the points are 5"),
        (lambda text: text.replace("roving x:,1.5,", "roving x:,"), r"'roving x' has 4 cells"),
        (lambda text: text.replace("1.5,", "1.5x,"), r"line 10, 'roving x': cell 2 '1\.5x' is not a number"),
        (lambda text: text.replace("utilized:,1", "utilized:,"), "'utilized' is blank, in 1 of 5"),
    ],
)
def test_what_does_not_fit_is_named(damage, sentence: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=sentence):
        read_part(Path("DxL_1.csv"), damage(rows(XYZ)).encode())


def test_points_that_share_a_number_are_told_apart_by_their_place(tmp_path: Path) -> None:
    """One number is that of a moment, at which each pair of electrodes of a catheter gives a point."""
    head = "Export File Version: 11\nMap name:,lab\nMap type:,{}\n(Point #),roving x,roving y,roving z,{}\n"
    voltage = ("7,1,2,3,0.1", "7,4,5,6,0.2", "8,1,2,3,0.3", "7,1,2,3,0.1")
    times = ("8,1,2,3,-30", "7,4,5,6,-20", "7,1,2,3,-10", "9,0,0,0,-40")
    for file, kind, column, lines in (("a", "PP_bi", "P-P", voltage), ("b", "LAT_bi", "LAT", times)):
        (tmp_path / f"{file}.csv").write_text(head.format(kind, column) + "\n".join((*lines, "EOF\n")))
    points = read_study(tmp_path).points
    found = np.column_stack([points.xyz, points.columns["bipolar"], points.columns["lat"]])
    nan = np.nan
    wanted = [
        [1, 2, 3, 0.1, -10],
        [4, 5, 6, 0.2, -20],
        [1, 2, 3, 0.1, nan],
        [1, 2, 3, 0.3, -30],
        [0, 0, 0, nan, -40],
    ]
    np.testing.assert_array_equal(found, wanted)


def test_the_files_may_lie_in_a_zip_in_a_zip(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "inner.zip", "w") as inner:
        inner.writestr("map/DxL_1.csv", rows(XYZ))
    with zipfile.ZipFile(tmp_path / "outer.zip", "w") as outer:
        outer.write(tmp_path / "inner.zip", "Export.zip")
        outer.writestr("readme.zip", "no zip at all")
    np.testing.assert_array_equal(read_study(tmp_path / "outer.zip").points.xyz, XYZ)
    (tmp_path / "inner.zip").rename(tmp_path / "Export.zip")
    (tmp_path / "outer.zip").unlink()
    np.testing.assert_array_equal(read_study(tmp_path).points.xyz, XYZ)  # a folder that holds the zip


def test_the_reported_export_of_precision_is_read(shared_data: Path) -> None:
    found = read_study(shared_data / "reports/05-ensite-dxl-precision/study")
    assert found.points.xyz.shape == (90, 3)
    np.testing.assert_allclose(found.points.xyz[0], [26.51, -10.119, 27.098])
    np.testing.assert_allclose(found.points.columns["lat"], 50.0)
