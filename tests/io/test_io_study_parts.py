"""What a case does not need must not spoil the import of a study: it is named under `left`. And the names of
files and the encodings of texts, as programs write them.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from formats import car_file, marker

from o3dls.case import Points
from o3dls.errors import InputError
from o3dls.io.mapping.archive import Archive
from o3dls.io.mapping.study import read_study
from o3dls.io.mapping.study_import import import_study
from o3dls.io.matlab import openep
from o3dls.io.meshes import dif
from o3dls.io.meshes.carto import mesh_file
from o3dls.io.meshes.surface_file import SurfaceFile

XYZ = np.arange(9.0).reshape(3, 3)
SITES = "Session ChannelID SiteIndex X Y Z\r\n1 0 1 2.5 3.4 5.5\r\n"
XML = """<Study name="S"><Units Distance="mm" /><Maps>
<Map Name="LA" FileNames="{file}.mesh"><CartoPoints>
<Point Id="1" Position3D="0 1 2" /><Point Id="2" Position3D="3 4 5" /><Point Id="3" Position3D="6 7 8" />
</CartoPoints></Map></Maps><Meshes><Mesh FileName="CT.mesh" /></Meshes></Study>"""
DXL = (
    "Export File Version: 11\nMap name:,lab\nMap type:,PP_bi\n"
    "(Point #),roving x,roving y,roving z,utilized,P-P\n"
    "1,0,1,2,1,0.5\n2,3,4,5,1,0.6\n3,6,7,8,1,0.7\nEOF\n"
)


def carto(folder: Path, file: str = "LA", xml: str = XML) -> Path:
    """A study of one map whose files are all in order."""
    (folder / "VisiTagExport").mkdir(parents=True)
    for name in (file, "CT"):
        (folder / f"{name}.mesh").write_bytes(mesh_file.write(SurfaceFile(marker())))
    points = Points(XYZ, np.full(3, "eam"), {"bipolar": np.array([0.5, 1.0, 1.5])})
    (folder / f"{file}_car.txt").write_bytes(car_file(file, points))
    (folder / "VisiTagExport/Sites.txt").write_text(SITES)
    (folder / "Study.xml").write_text(xml.format(file=file), encoding="utf-8")
    return folder


def ensite(folder: Path) -> Path:
    folder.mkdir()
    (folder / "Map_PP_bi.csv").write_text(DXL)
    (folder / "DxLandmarkGeo.xml").write_bytes(dif.write(SurfaceFile(marker(), "LPS", "mm")))
    (folder / "Lesions.csv").write_text("Text,x,y,z\na,0,1,2\n")
    (folder / "Model_Point_Cloud.csv").write_text("trn_x,trn_y,trn_z\n1,2,3\n")
    return folder


def damaged(old: str, new: str) -> Callable[[Path], None]:
    def change(path: Path) -> None:
        text = path.read_text(encoding="cp1252")
        assert old in text
        path.write_text(text.replace(old, new), encoding="cp1252")

    return change


@pytest.mark.parametrize(
    ("make", "file", "spoil", "named"),
    [
        (carto, "LA.mesh", Path.unlink, "shell LA.mesh: .*which is not there"),
        (carto, "LA.mesh", damaged("[TrianglesSection]", "[Triangles]"), "shell LA.mesh: "),
        (
            carto,
            "LA.mesh",
            damaged("Matrix                 = 1 0", "Matrix = 1 7"),
            "shell LA.mesh: .*Matr",
        ),
        (carto, "CT.mesh", Path.unlink, "imported shell CT.mesh: .*which is not there"),
        (carto, "CT.mesh", lambda path: path.write_bytes(b"\0\1"), "imported shell CT.mesh: "),
        (
            carto,
            "VisiTagExport/Sites.txt",
            damaged("X Y", "A B"),
            "ablation sites of VisiTag: .*no column 'X'",
        ),
        (
            carto,
            "VisiTagExport/Sites.txt",
            damaged("2.5", "2,5"),
            "ablation sites of VisiTag: .*decimal comma",
        ),
        (ensite, "DxLandmarkGeo.xml", damaged("</DIF>", ""), "shell DxLandmarkGeo.xml: .*well-formed"),
        (ensite, "Lesions.csv", damaged("Text,x,y,z", "Text,u,v,w"), "Lesions.csv: .*no columns x, y, z"),
        (ensite, "Lesions.csv", damaged(",2", ",two"), "Lesions.csv: .*line 2, column 'z'"),
        (ensite, "Model_Point_Cloud.csv", damaged("3", "?"), "Model_Point_Cloud.csv: .*'trn_z'"),
    ],
)
def test_an_odd_part_that_is_not_needed_is_left(
    make: Callable[[Path], Path], file: str, spoil: Callable[[Path], object], named: str, tmp_path: Path
) -> None:
    whole = import_study(make(tmp_path / "whole"), None, tmp_path / "case 1")
    folder = make(tmp_path / "odd")
    spoil(folder / file)
    found = import_study(folder, None, tmp_path / "case 2")
    np.testing.assert_array_equal(found.points.of("eam").xyz, whole.points.of("eam").xyz)
    np.testing.assert_array_equal(found.points.of("eam").xyz, XYZ)
    (line,) = [line for line in found.left if re.match(named, line)]
    assert not [other for other in whole.left if other == line]


def test_a_point_that_the_map_does_not_use_needs_no_place(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(DXL.replace("2,3,4,5,1,", "2,,invalid,-nan(ind),0,"))
    np.testing.assert_array_equal(read_study(tmp_path).points.xyz, XYZ[::2])


def test_another_map_that_is_damaged_does_not_spoil_the_one(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(DXL)
    (tmp_path / "b.csv").write_text(DXL.replace("lab", "other").replace("EOF\n", ""))
    found = read_study(tmp_path)
    assert found.name == "lab"
    assert [line for line in found.left if line.startswith("b.csv: ") and "truncated" in line]
    with pytest.raises(InputError, match=r"b\.csv: line \d+: ends without EOF"):
        read_study(tmp_path, "b")
    (tmp_path / "a.csv").unlink()
    with pytest.raises(InputError, match=r"b\.csv: line \d+: ends without EOF"):
        read_study(tmp_path)


def test_the_shell_of_an_openep_data_set_is_not_needed(tmp_path: Path) -> None:
    tree = {
        "userdata": {
            "electric": {"egmX": XYZ, "voltages": {"bipolar": np.ones(3)}},
            "surface": {"triRep": {"X": XYZ, "Triangulation": np.array([[1.0, 2, 9]])}},
        }
    }
    (tmp_path / "s.mat").write_bytes(openep.save(tree["userdata"]))
    found = read_study(tmp_path / "s.mat")
    np.testing.assert_array_equal(found.points.xyz, XYZ)
    assert [line for line in found.left if line.startswith("the shell: ")]


def test_files_are_found_by_the_names_that_the_study_gives_them(tmp_path: Path) -> None:
    """People rename a map, and its files keep the name."""
    found = read_study(carto(tmp_path / "s", "1-1-ReLA"), "LA")
    np.testing.assert_array_equal(found.points.of("eam").columns["bipolar"], [0.5, 1.0, 1.5])
    assert found.shell is not None


def test_maps_of_one_name_are_told_apart_by_their_files(tmp_path: Path) -> None:
    again = XML.replace("{file}", "9-LA").replace('"0 1 2"', '"9 9 9"')
    second = again[again.index("<Map ") : again.index("</Maps>")]
    folder = carto(tmp_path / "s", "1-LA", XML.replace("</Maps>", second + "</Maps>"))
    moved = Points(XYZ + 100, np.full(3, "eam"), {"bipolar": np.ones(3)})
    (folder / "9-LA_car.txt").write_bytes(car_file("9-LA", moved))
    for name, xyz in (("9-LA", XYZ + 100), ("9-LA.mesh", XYZ + 100), ("1-LA", XYZ)):
        found = read_study(folder, name)
        np.testing.assert_allclose(found.points.of("eam").xyz, xyz)
        assert "map LA (3 points)" in found.left
    with pytest.raises(InputError, match=r"2 maps of that name; .* by the name of its file: .*9-LA\.mesh"):
        read_study(folder, "LA")


def test_positions_come_from_the_xml_where_the_table_is_missing(tmp_path: Path) -> None:
    folder = carto(tmp_path / "s")
    (folder / "LA_car.txt").unlink()
    found = read_study(folder)
    np.testing.assert_array_equal(found.points.of("eam").xyz, XYZ)
    assert [line for line in found.left if line.startswith("voltages and times: there is no LA_car.txt")]
    (folder / "Study.xml").write_text(XML.format(file="LA").replace("3 4 5", "3 4"))
    with pytest.raises(InputError, match="Position3D that is not three finite numbers"):
        read_study(folder)


def test_the_tables_of_a_study_may_be_in_a_zip_beside_its_xml(tmp_path: Path) -> None:
    folder = carto(tmp_path / "s")
    with zipfile.ZipFile(folder / "Points.zip", "w") as file:
        file.write(folder / "LA_car.txt", "deep/LA_car.txt")
    (folder / "LA_car.txt").unlink()
    np.testing.assert_array_equal(read_study(folder).points.of("eam").columns["bipolar"], [0.5, 1.0, 1.5])
    with zipfile.ZipFile(tmp_path / "s.zip", "w") as file:
        for path in folder.rglob("*.*"):
            file.write(path, path.relative_to(folder))
    np.testing.assert_array_equal(
        read_study(tmp_path / "s.zip").points.of("eam").columns["bipolar"], [0.5, 1.0, 1.5]
    )


@pytest.mark.parametrize("encoding", ["utf-8", "cp437", "cp850", "cp1252"])
@pytest.mark.parametrize("name", ["1-LA réentrée", "Vorhof größer", "1-Fläche é"])
def test_names_in_a_zip_are_found_in_every_encoding(encoding: str, name: str, tmp_path: Path) -> None:
    folder = carto(tmp_path / "s", name)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        for path in folder.rglob("*.*"):
            # zipfile would set the flag of UTF-8: a name that is ASCII, as long as this one will be
            plain = str(path.relative_to(folder)).encode(encoding)
            file.writestr("".join(chr(b) if b < 128 else "~" for b in plain), path.read_bytes())
    data = buffer.getvalue()
    for path in folder.rglob("*.*"):
        plain = str(path.relative_to(folder)).encode(encoding)
        data = data.replace(bytes(b if b < 128 else ord("~") for b in plain), plain)
    (tmp_path / "s.zip").write_bytes(data)
    assert any(not one.isascii() for one in Archive.open(tmp_path / "s.zip").names)
    found = read_study(tmp_path / "s.zip")
    assert found.shell is not None
    np.testing.assert_array_equal(found.points.of("eam").columns["bipolar"], [0.5, 1.0, 1.5])


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be", "utf-32", "utf-8-sig", "cp1252"])
def test_texts_of_a_study_are_read_in_the_encoding_that_they_state(encoding: str, tmp_path: Path) -> None:
    folder = carto(tmp_path / "s", "1-LA é", '<?xml version="1.0" encoding="UTF-16"?>' + XML)
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    for path in (*folder.glob("*.*"), folder / "VisiTagExport/Sites.txt"):
        text = path.read_bytes().decode("utf-8" if path.suffix == ".xml" else "cp1252")
        if not encoding.startswith("utf-16"):
            text = text.replace(' encoding="UTF-16"', "")
        path.write_bytes((mark + text).encode(encoding))
    found = read_study(folder)
    assert found.name == "LA"
    assert not [line for line in found.left if "shell" in line]
    np.testing.assert_array_equal(found.points.of("eam").columns["bipolar"], [0.5, 1.0, 1.5])


@pytest.mark.parametrize(
    "word",
    ["nan", "-nan", "NaN", "nan(ind)", "-nan(ind)", "1.#QNAN", "-1.#IND0", "1.#R", "NaNQ", "NULL", "NA"],
)
def test_what_c_libraries_print_for_no_number_is_missing(word: str, tmp_path: Path) -> None:
    folder = carto(tmp_path / "s")
    text = (folder / "LA.mesh").read_text(encoding="cp1252")
    assert "2.50000" in text
    (folder / "LA.mesh").write_text(text.replace("2.50000", word), encoding="cp1252")
    shell = read_study(folder).shell
    assert shell is not None
    np.testing.assert_array_equal(shell.surface.fields["bipolar"], [0.125, np.nan, np.nan, 1.25])


REPORTS = [
    *(
        f"09-one-optional-part-spoils-the-import/{name}"
        for name in [
            "ct_not_exported",
            "ensite_lesions",
            "ensite_two_volumes",
            "ensite_unused_row",
            "shell_hidden",
            "shell_matrix",
            "shell_missing",
            "shell_qnan",
        ]
    ),
    "12-zip-names-in-utf8-without-the-flag/study.zip",
    "15-utf16/study",
]


@pytest.mark.parametrize("report", REPORTS)
def test_the_reported_studies_give_their_points(report: str, shared_data: Path, tmp_path: Path) -> None:
    found = import_study(shared_data / "reports" / report, None, tmp_path / "case")
    assert len(found.points.of("eam")) == 90
