"""Study exports become case folders: a synthetic study in every form, and the genuine CARTO export where it
is.
"""

from __future__ import annotations

import io
import struct
import unicodedata
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from formats import car_file, marker, write_as
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from o3dls.case import Points
from o3dls.cli.commands import cli
from o3dls.errors import InputError
from o3dls.geometry.similarity import apply, similarity
from o3dls.geometry.surface import Surface
from o3dls.io.case_reader import read_case
from o3dls.io.mapping import carto_points, ensite
from o3dls.io.mapping.carto_study import vendor_pose
from o3dls.io.mapping.imported import Imported
from o3dls.io.mapping.study import read_study
from o3dls.io.mapping.study_import import _registered_shell, _write_registered, import_study
from o3dls.io.markups import Markups, write_markups
from o3dls.io.matlab import openep
from o3dls.io.meshes import dif
from o3dls.io.meshes.carto import encoder, mesh_file, parser
from o3dls.io.meshes.carto.mesh import CartoMesh
from o3dls.io.meshes.surface_file import SurfaceFile
from o3dls.io.points import read_points
from o3dls.io.surfaces import read_surface, read_surface_file
from o3dls.io.table import read_table

SEED = 5_102_933
EXPORT = "formats/carto_export"
VOLUME_TOLERANCE = 2e-4  # relative: the study's XML prints six digits
CARTO_XML = """<Study name="S"><Units Distance="mm" Angle="radian" /><Maps Count="2">
<TagsTable Count="2"><Tag ID="101" Short_Name="LSPV" /><Tag ID="9" Short_Name="ABL" /></TagsTable>
<Map Name="1-Map" FileNames="1-Map.mesh" Volume="{volume:.6g}"><CartoPoints Count="3">
<Point Id="1" Position3D="1 2 3"><Tags Count="1">101</Tags></Point>
<Point Id="2"><Tags Count="2">101 9</Tags></Point><Point Id="3" />
</CartoPoints></Map>
<Map Name="2 empty µ" FileNames="2-Map.mesh" Volume="0"><CartoPoints Count="0" /></Map></Maps>
<Meshes><Mesh FileName="CT.mesh"><RegistrationMatrix>1 0 0 0 0 1 0 0 0 0 1 0 4 5 6 1</RegistrationMatrix>
</Mesh></Meshes></Study>"""
SITES = (
    "  Session ChannelID SiteIndex X Y Z DurationTime AverageForce \r\n 1 0 1 2.5 3.4 10.5 10.4 3.068 \r\n"
)
DXL = """Export File Version: 11
Export from Study: s
Field Scaling: off
Data starts in row,9

Map name:,lab
Map type:,PP_bi
***
Rov trace,roving x,roving y,roving z,surface x,utilized, P-P,P-P valid,force (g),Rov Tick 1,...
A,1,2,3,9,1,0.5,1,invalid,1,2,3
B,4,5,6,9,0,0.7,1,4,1
C,7,8,9,9,1,0.9,0,5,1
EOF
"""


def carto_folder(folder: Path) -> Path:
    folder.mkdir(parents=True)
    shell = mesh_file.write(SurfaceFile(marker()))
    for name in ("1-Map.mesh", "2-Map.mesh", "CT.mesh"):
        (folder / name).write_bytes(shell)
    points = Points(
        np.arange(9.0).reshape(3, 3),
        np.full(3, "eam"),
        {"bipolar": np.array([0.5, np.nan, 1.5]), "lat": np.array([-20.0, 10, np.nan])},
    )
    (folder / "1-Map_car.txt").write_bytes(car_file("1-Map", points))
    (folder / "VisiTagExport").mkdir()
    (folder / "VisiTagExport/Sites.txt").write_text(SITES, newline="")
    (folder / "Study 1.xml").write_text(CARTO_XML.format(volume=marker().volume / 1000), encoding="cp1252")
    return folder


def zipped(folder: Path, target: Path) -> Path:
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as file:
        for path in sorted(folder.rglob("*")):
            file.write(path, Path("top") / path.relative_to(folder))
    return target


@pytest.mark.parametrize("form", ["folder", "zip", "zip in zip"])
def test_carto_study_becomes_a_case(form: str, tmp_path: Path) -> None:
    study = carto_folder(tmp_path / "Export Study")
    if form != "folder":
        study = zipped(study, tmp_path / "Export_Study_1.zip")
    if form == "zip in zip":
        (tmp_path / "outer").mkdir()
        study = zipped((study.rename(tmp_path / "outer" / study.name)).parent, tmp_path / "all.zip")
    found = import_study(study, "1-Map", tmp_path / "case", prior=write_as("stl", tmp_path))
    points = read_points(tmp_path / "case/points.csv")
    np.testing.assert_array_equal(points.type, ["eam", "ablation", "eam", "ablation", "landmark"])
    np.testing.assert_allclose(points.xyz[3], [2.5, 3.4, 10.5])
    np.testing.assert_allclose(points.xyz[4], [1.5, 2.5, 3.5])  # the mean of the two points tagged LSPV
    np.testing.assert_array_equal(points.columns["bipolar"], [0.5, np.nan, 1.5, np.nan, np.nan])
    np.testing.assert_array_equal(points.columns["lat"][:3], [-20, 10, np.nan])
    assert points.columns["name"][4] == "LSPV"
    assert read_surface(tmp_path / "case/prior.ply").volume == pytest.approx(marker().volume, rel=1e-5)
    assert read_surface(tmp_path / "case/map.ply").volume == pytest.approx(marker().volume, rel=1e-4)
    assert (tmp_path / "case/CT_vendor_registration.txt").read_text().splitlines()[3] == "4.0 5.0 6.0 1.0"
    assert "not applied" in " ".join(found.left)
    assert any("study: " in line and "NOT" not in line for line in found.took)
    assert "2 empty µ" in " ".join(found.left)


def test_the_direction_of_a_vendor_registration_is_told_by_the_points() -> None:
    shell = marker().vertices
    pose = similarity(np.eye(3), np.array([40.0, -25.0, 60.0]))
    points = apply(pose, shell)[::3]
    for printed in (pose, pose.T, np.linalg.inv(pose), np.linalg.inv(pose).T):
        np.testing.assert_allclose(vendor_pose(shell, tuple(printed.ravel()), points), pose, atol=1e-9)
    assert vendor_pose(shell, tuple(np.eye(4).ravel()), points) is None  # the identity has no direction
    assert vendor_pose(shell, tuple(np.zeros(16)), points) is None


def test_a_shell_that_the_system_registered_is_the_prior_where_none_is_given(tmp_path: Path) -> None:
    shift = np.array([4.0, 5.0, 6.0])
    rows = apply(similarity(np.eye(3), shift), marker().vertices)
    found = Imported(Points(rows, np.full(len(rows), "eam")), vendor="CARTO 3")
    found.shells["CT.mesh"] = SurfaceFile(marker())
    found.registrations["CT.mesh"] = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, *shift, 1.0)
    name, pose = _registered_shell(found) or ("", np.eye(4))
    assert name == "CT.mesh"
    _write_registered(tmp_path, name, pose, found)
    np.testing.assert_allclose(np.loadtxt(tmp_path / "init.csv", delimiter=",")[:3, 3], shift)
    assert read_surface(tmp_path / "prior.ply").volume == pytest.approx(marker().volume, rel=1e-5)


def test_maps_are_named_where_the_name_does_not_fit(tmp_path: Path) -> None:
    folder = carto_folder(tmp_path / "s")
    with pytest.raises(InputError, match=r"no map 'x': there are 1-Map \(3 points\), 2 empty µ \(0 points\)"):
        import_study(folder, "x", tmp_path / "case")
    assert not (tmp_path / "case").exists()
    assert read_study(folder).name == "1-Map"  # the only one with points
    with pytest.raises(InputError, match=r"holds no 2-Map_car\.txt, and its XML no points"):
        read_study(folder, "2 empty µ")
    (folder / "Study 1.xml").unlink()
    with pytest.raises(InputError, match="holds no CARTO 3 study"):
        read_study(folder)


def test_archives_that_cannot_be_opened_say_why(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(b"7z\xbc\xaf\x27\x1c....")
    with pytest.raises(InputError, match="is a 7-Zip archive"):
        read_study(tmp_path / "a.zip")
    whole = zipped(carto_folder(tmp_path / "s"), tmp_path / "b.zip").read_bytes()
    (tmp_path / "b.zip").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="not a readable zip"):
        read_study(tmp_path / "b.zip")
    for at, bits, sentence in (
        (6, 1, "password"),
        (8, 9, "method is not supported; unpack it with another program"),
    ):
        (tmp_path / "c.zip").write_bytes(with_header_bits(whole, at, bits))
        with pytest.raises(InputError, match=sentence):
            read_study(tmp_path / "c.zip")


def with_header_bits(data: bytes, at: int, bits: int) -> bytes:
    """A zip whose headers say another thing of every file: 1 at 6 is the flag for encrypted, 9 at 8 the
    method Deflate64.
    """
    out = bytearray(data)
    for mark, offset in ((b"PK\x03\x04", at), (b"PK\x01\x02", at + 2)):
        start = -1
        while (start := out.find(mark, start + 1)) >= 0:
            out[start + offset] |= bits
    return bytes(out)


@pytest.mark.parametrize("beside", ["__MACOSX/._Export.zip", "list.csv"])
def test_a_zip_in_a_zip_is_found_whatever_lies_beside_it(beside: str, tmp_path: Path) -> None:
    inner = zipped(carto_folder(tmp_path / "s"), tmp_path / "Export.zip")
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as file:
        file.write(inner, "Export.zip")
        file.writestr(beside, "a,b\n")
    assert len(read_study(tmp_path / "all.zip").points) == 4


@pytest.mark.parametrize("beside", [b"damaged", None], ids=["damaged", "a copy of itself"])
def test_a_zip_beside_the_study_is_left_alone(beside: bytes | None, tmp_path: Path) -> None:
    whole = zipped(carto_folder(tmp_path / "s"), tmp_path / "a.zip")
    copy = whole.read_bytes()
    with zipfile.ZipFile(whole, "a") as file:
        file.writestr("backup.zip", beside or copy)
    assert len(read_study(whole).points) == 4


def test_an_import_never_replaces_what_it_reads(tmp_path: Path) -> None:
    (tmp_path / "case").mkdir()
    (tmp_path / "case/case.toml").write_text("")
    inside = zipped(carto_folder(tmp_path / "s"), tmp_path / "case/study.zip")
    with pytest.raises(InputError, match=r"case: is or holds .*study\.zip, which is read"):
        import_study(inside, None, tmp_path / "case", force=True)
    assert inside.is_file()


def test_names_are_found_with_accents_written_either_way_and_with_backslashes(tmp_path: Path) -> None:
    folder = carto_folder(tmp_path / "s")
    for path in folder.glob("1-Map*"):
        path.rename(folder / unicodedata.normalize("NFD", path.name.replace("1-Map", "Vorhöfe")))
    xml = folder / "Study 1.xml"
    xml.write_text(xml.read_text(encoding="cp1252").replace("1-Map", "Vorhöfe"), encoding="utf-8")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as file:
        for path in folder.rglob("*.*"):
            file.writestr("top\\" + str(path.relative_to(folder)).replace("/", "\\"), path.read_bytes())
    for study in (folder, tmp_path / "a.zip"):
        assert len(read_study(study, "Vorhöfe").points) == 4


@pytest.mark.parametrize("start", ["", "\ufeff", "<?xml version='1.0'?>\n<!-- one --><!-- two -->\n"])
def test_a_study_is_found_by_its_content_or_by_its_xml(start: str, tmp_path: Path) -> None:
    folder = carto_folder(tmp_path / "top" / "Patient_Export_2021")
    xml = (folder / "Study 1.xml").rename(folder / "LA_Export.xml")
    xml.write_text(start + xml.read_text(encoding="cp1252"), encoding="utf-8")
    (folder / "1-Map_Points_Export.xml").write_text("<Points />")
    for study in (tmp_path / "top", xml):
        found = read_study(study)
        assert (len(found.points), len(found.shells)) == (4, 1)


@pytest.mark.parametrize("name", ["map", "prior.v2", "truth", "points", "case"])
def test_an_imported_shell_takes_no_name_that_a_case_knows(name: str, tmp_path: Path) -> None:
    folder = carto_folder(tmp_path / "s")
    import_study(folder, "1-Map", tmp_path / "before")
    (folder / "CT.mesh").write_bytes(
        mesh_file.write(SurfaceFile(marker().with_vertices(2 * marker().vertices)))
    )
    (folder / "CT.mesh").rename(folder / f"{name}.mesh")
    xml = folder / "Study 1.xml"
    xml.write_text(xml.read_text(encoding="cp1252").replace("CT.mesh", f"{name}.mesh"), encoding="cp1252")
    import_study(folder, "1-Map", tmp_path / "after")
    before, after = (
        {path.name.split(".")[0] for path in (tmp_path / case).iterdir()} for case in ("before", "after")
    )
    assert (tmp_path / "after/map.ply").read_bytes() == (tmp_path / "before/map.ply").read_bytes()
    assert len(after - before) == 2  # the shell and its registration
    assert after.isdisjoint({"prior", "truth", "init"})


def test_points_that_the_study_has_and_the_export_has_not_are_said(tmp_path: Path) -> None:
    folder = carto_folder(tmp_path / "s")
    assert "NOT agree" not in " ".join(read_study(folder).took)
    car = folder / "1-Map_car.txt"
    car.write_bytes(b"".join(car.read_bytes().splitlines(keepends=True)[:-1]))
    assert any(
        line.startswith("2 points") and "3 points, which does NOT agree" in line
        for line in read_study(folder).took
    )


def test_landmarks_are_brought_to_the_frame_of_the_prior_from_either_kind_of_file(tmp_path: Path) -> None:
    # in LPS
    folder = carto_folder(tmp_path / "s")
    prior = write_as("ply", tmp_path)
    write_markups(tmp_path / "a.mrk.json", Markups(("LSPV",), np.array([[1.0, 2, 3]]), "RAS"))
    (tmp_path / "a.csv").write_text("# space=RAS units=cm\nname,x,y,z\nLSPV,0.1,0.2,0.3\n")
    for path in (tmp_path / "a.mrk.json", tmp_path / "a.csv"):
        import_study(folder, "1-Map", tmp_path / "case", prior=prior, landmarks=path, force=True)
        table = read_table(tmp_path / "case/prior_landmarks.csv", "xyz")
        np.testing.assert_allclose([table.numbers(axis)[0] for axis in "xyz"], [-1, -2, 3])
        assert table.notes == {"space": "LPS", "units": "mm"}
    (tmp_path / "a.csv").write_text("# space=RAS units=feet\nname,x,y,z\nLSPV,0.1,0.2,0.3\n")
    with pytest.raises(InputError, match=r"a\.csv: states units 'feet': must be one of mm, cm"):
        import_study(
            folder, "1-Map", tmp_path / "case", prior=prior, landmarks=tmp_path / "a.csv", force=True
        )


def test_an_import_names_the_landmarks_without_a_partner(tmp_path: Path) -> None:
    study = carto_folder(tmp_path / "s")
    xml = study / "Study 1.xml"
    text = xml.read_text(encoding="cp1252")
    text = text.replace(
        '<Tag ID="9"', '<Tag ID="7" Short_Name="LAA" /><Tag ID="8" Short_Name="Roof" /><Tag ID="9"'
    )
    xml.write_text(
        text.replace('<Point Id="3" />', '<Point Id="3"><Tags>7 8</Tags></Point>'), encoding="cp1252"
    )
    prior = write_as("ply", tmp_path)
    marks = ("left upper pulmonary vein", "MA")
    write_markups(tmp_path / "a.mrk.json", Markups(marks, np.array([[1.0, 2, 3], [4, 5, 6]]), "LPS"))
    found = import_study(study, "1-Map", tmp_path / "case", prior=prior, landmarks=tmp_path / "a.mrk.json")
    assert list(found.landmarks) == ["LAA", "LSPV"]
    assert "landmark LSPV of the map is left upper pulmonary vein of the prior" in found.took
    assert [line for line in found.left if line.startswith("landmarks of")] == [
        f"landmarks of the map without a partner: LAA; there are {', '.join(marks)} on the other side",
        "landmarks of the prior without a partner: MA; there are LAA, LSPV on the other side",
    ]
    found = import_study(study, "1-Map", tmp_path / "case", prior=prior, force=True)
    assert any(line.startswith("landmarks LAA, LSPV: have no partners, as no places") for line in found.left)


@pytest.mark.parametrize("name", ["prior.ply", "thesis.docx", "phases/01.ply"])
def test_an_import_replaces_only_what_an_import_wrote(name: str, tmp_path: Path) -> None:
    study, out = carto_folder(tmp_path / "s"), tmp_path / "case"
    import_study(study, "1-Map", out)
    import_study(study, "1-Map", out, force=True)
    (out / name).parent.mkdir(exist_ok=True)
    (out / name).write_text("mine")
    with pytest.raises(InputError, match=f"case: holds {name}, which o3dls did not write and would remove"):
        import_study(study, "1-Map", out, force=True)
    assert (out / name).read_text() == "mine"


def test_an_import_does_not_replace_a_case_made_by_hand(tmp_path: Path) -> None:
    study, out = carto_folder(tmp_path / "s"), tmp_path / "case"
    out.mkdir()
    for name in ("case.toml", "points.csv", "prior.ply"):
        (out / name).write_text("mine")
    with pytest.raises(InputError, match=r"case: holds case\.toml and 2 more, which o3dls did not write"):
        import_study(study, "1-Map", out, force=True)


def test_phase_and_frame_of_a_prior_are_those_that_are_said(tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    values = np.zeros((12, 13, 14, 2), np.uint8)
    values[3:8, 4:9, 5:9, 0] = values[4:9, 4:9, 5:9, 1] = 1
    image = nibabel.Nifti1Image(values, np.eye(4))
    image.set_sform(None)
    nibabel.save(image, tmp_path / "cine.nii")
    folder = carto_folder(tmp_path / "s")
    command = [
        "import",
        str(folder),
        str(tmp_path / "case"),
        "--map",
        "1-Map",
        "--prior",
        str(tmp_path / "cine.nii"),
    ]
    done = CliRunner().invoke(cli, command)
    assert isinstance(done.exception, InputError)
    assert "neither qform nor sform" in str(done.exception)
    done = CliRunner().invoke(cli, [*command, "--frame", "RAS", "--phase", "1"])
    assert done.exit_code == 0, done.output
    prior = read_surface_file(tmp_path / "case/prior.ply")
    assert prior.space == "RAS"
    assert prior.surface.vertices[:, 0].min() == pytest.approx(3.5, abs=0.1)
    for frame, sentence in (
        ("RAS", "states frame LPS, and RAS was given"),
        ("ras", "frame = 'ras': must be one"),
    ):
        with pytest.raises(InputError, match=sentence):
            import_study(
                folder, "1-Map", tmp_path / "case", prior=write_as("ply", tmp_path), frame=frame, force=True
            )


def test_what_is_said_of_a_prior_needs_one(tmp_path: Path) -> None:
    folder = carto_folder(tmp_path / "s")
    with pytest.raises(InputError, match="cap, label: needs a prior"):
        import_study(folder, "1-Map", tmp_path / "case", cap=True, label=0, part=None)
    import_study(folder, "1-Map", tmp_path / "case", cap=False, label=None)


def test_car_files_survive() -> None:
    points = Points(
        np.array([[1.5, -2.25, 3.125]]),
        np.array(["eam"]),
        {name: np.array([1.25]) for name in carto_points.COLUMNS},
    )
    back, ids = carto_points.read_car(Path("a_car.txt"), car_file("a", points))
    np.testing.assert_array_equal(back.xyz, points.xyz)
    assert ids.tolist() == [1]
    assert {name: values[0] for name, values in back.columns.items()} == dict.fromkeys(
        carto_points.COLUMNS, 1.25
    )


def test_carto_mesh_hides_what_carto_hides_and_knows_missing_values() -> None:
    n = 5
    mesh = CartoMesh(
        np.vstack([marker().vertices, [[0.0, 0, 0]]]),
        np.zeros((n, 3)),
        np.zeros(n, dtype=int),
        np.vstack([marker().faces, [[0, 1, 4]], [[1, 2, 4]]]),
        np.zeros((6, 3)),
        np.array([0, 0, 0, 0, -1, -1_000_000]),
        ("Bipolar", "µBi"),
        np.array([[1.0, 2, 3, 4, 5], [-10000.0] * 5, [-10000.0] * 5]).T,
    )
    data = encoder.encode(mesh)
    file = mesh_file.read(Path("a.mesh"), data)
    assert (len(file.surface.vertices), len(file.surface.faces), file.metadata["hidden_triangles"]) == (
        4,
        4,
        2,
    )
    assert list(file.surface.fields) == ["bipolar"]
    assert len(mesh_file.read(Path("a.mesh"), data, hidden=True).surface.faces) == 6
    assert b"\xb5Bi" in data
    assert encoder.encode(parser.parse(Path("a.mesh"), data)) == data
    for loose in (data.replace(b"\r\n", b"\n"), data.decode("cp1252").encode("utf-8")):
        assert len(mesh_file.read(Path("a.mesh"), loose).surface.faces) == 4
    with pytest.raises(InputError, match=r"\[TrianglesSection\] has 5 rows, 6 are declared"):
        mesh_file.read(Path("a.mesh"), data.replace(b"       5 =        1        2        4", b";"))
    with pytest.raises(InputError, match="Matrix is not the identity"):
        mesh_file.read(Path("a.mesh"), data.replace(b"= 1 0 0 0", b"= 2 0 0 0"))


@settings(max_examples=25, deadline=None)
@given(
    vertices=arrays(np.float64, (6, 3), elements=st.integers(-99_999, 99_999).map(lambda k: k / 1000)),
    colours=arrays(
        np.float64,
        (6, 2),
        elements=st.one_of(st.just(-10_000.0), st.integers(0, 9_999).map(lambda k: k / 100)),
    ),
    groups=arrays(np.int64, 3, elements=st.sampled_from([0, 1, -1, -1_000_000])),
)
def test_any_carto_mesh_survives(vertices: np.ndarray, colours: np.ndarray, groups: np.ndarray) -> None:
    groups[0] = 0
    triangles = np.array([[0, 1, 2], [2, 1, 3], [3, 4, 5]])
    mesh = CartoMesh(
        vertices,
        np.zeros((6, 3)),
        np.zeros(6, dtype=int),
        triangles,
        np.zeros((3, 3)),
        groups,
        ("Bipolar", "LAT"),
        np.column_stack([colours, np.full(6, -10_000.0)]),
    )
    data = encoder.encode(mesh)
    assert encoder.encode(parser.parse(Path("a.mesh"), data)) == data
    surface = mesh_file.read(Path("a.mesh"), data).surface
    used = np.unique(triangles[groups >= 0])
    np.testing.assert_allclose(surface.vertices, vertices[used], atol=1e-9)
    assert len(surface.faces) == (groups >= 0).sum()
    expected = np.where(colours[used] == -10_000.0, np.nan, colours[used])
    for k, name in enumerate(("bipolar", "lat")):
        if name in surface.fields:
            np.testing.assert_allclose(surface.fields[name], expected[:, k])
        else:  # a slot without any value is as good as none
            assert not np.nan_to_num(expected[:, k]).any()


def test_dif_says_which_volume_and_what_is_missing() -> None:
    values = np.array([0.5, np.nan, 1.5, 2.5])
    data = dif.encode(
        Surface(marker().vertices, marker().faces, {"P-P Voltage": values}), field="P-P Voltage", name="LA"
    )
    file = dif.read(Path("a.xml"), data)
    np.testing.assert_array_equal(file.surface.fields["P-P Voltage"], values)
    assert (file.space, file.units, file.metadata["name"]) == ("LPS", "mm", "LA")
    for patient in (b"PatientName", b"PatientID", b"PatientBirthDate"):
        assert b"<" + patient + b">NA<" in data
    volume = data[data.index(b"<Volume ") : data.index(b"</Volumes>")]
    two = data.replace(volume, volume + volume.replace(b'"LA"', b'"RA"'))
    with pytest.raises(InputError, match="holds 2 volumes; say which with --part: LA, RA"):
        dif.read(Path("a.xml"), two)
    assert dif.read(Path("a.xml"), two, part="RA").metadata["name"] == "RA"
    with pytest.raises(InputError, match="has no volume 'La'; there are: LA, RA"):
        dif.read(Path("a.xml"), two, part="La")
    assert (
        len(
            dif.read(
                Path("a.xml"), data.replace(b'Polygons number="4"', b'Polygons number="8"')
            ).surface.faces
        )
        == 4
    )


def test_ensite_map_takes_utilised_points_at_the_electrode(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    folder.mkdir()
    (folder / "Map_PP_bi.csv").write_text(DXL)
    (folder / "Map_LAT.csv").write_text(
        DXL.replace("PP_bi", "LAT_detected").replace(" P-P,P-P valid", "LAT,LAT valid")
    )
    (folder / "Lesions.csv").write_text("Text,Type,Surface,x,y,z,Diameter\nL1,a,b,1.5,2.5,3.5,4\nEOF\n")
    (folder / "DxLandmarkGeo.xml").write_bytes(
        dif.encode(marker(), field="bipolar").replace(
            b'number="0">tag', b'number="1"><Label name="LSPV">1 2 3</Label>'
        )
    )
    found = import_study(folder, None, tmp_path / "case")
    points = read_points(tmp_path / "case/points.csv")
    np.testing.assert_array_equal(points.type, ["eam", "eam", "ablation", "landmark"])
    np.testing.assert_array_equal(points.xyz, [[1, 2, 3], [7, 8, 9], [1.5, 2.5, 3.5], [1, 2, 3]])
    np.testing.assert_array_equal(points.columns["bipolar"][:2], [0.5, np.nan])
    np.testing.assert_array_equal(points.columns["lat"][:2], [0.5, np.nan])
    np.testing.assert_array_equal(points.columns["force"][:2], [np.nan, 5])
    assert "field scaling off" in found.vendor
    with pytest.raises(InputError, match="ends without EOF"):
        ensite.read_map(Path("a.csv"), DXL[: DXL.index("C,7")].encode())
    with pytest.raises(InputError, match="line 11, column 'roving y': value '5x'"):
        ensite.read_map(Path("a.csv"), DXL.replace("B,4,5,", "B,4,5x,").encode())


def test_ensite_x_shell_and_labels_are_those_of_the_contact_mapping_model(tmp_path: Path) -> None:
    shell, other = dif.encode(marker()), dif.encode(marker().with_vertices(2 * marker().vertices))
    label = b'number="1"><Label name="LSPV">1 2 3</Label>'
    (tmp_path / "Contact_Mapping").mkdir()
    (tmp_path / "Contact_Mapping/Map_PP_bi.csv").write_text(DXL)
    (tmp_path / "Contact_Mapping_Model.xml").write_bytes(shell.replace(b'number="0">tag', label))
    for name in ("Model_Groups.xml", "dif001.xml"):
        (tmp_path / name).write_bytes(other)
    found = read_study(tmp_path)
    assert found.shell is not None
    np.testing.assert_allclose(found.shell.surface.vertices, marker().vertices, atol=1e-4)
    np.testing.assert_array_equal(found.landmarks["LSPV"], [1, 2, 3])
    assert {"Model_Groups.xml", "dif001.xml"} <= set(found.left)
    (tmp_path / "Contact_Mapping_Model_2.xml").write_bytes(other)
    assert read_study(tmp_path).shell is None  # which of the two is the map's is not known


def test_ensite_points_that_do_not_say_whether_they_are_utilised_are_refused(tmp_path: Path) -> None:
    for change, sentence in (
        (
            DXL.replace("9,1,0.5,", "9,,0.5,"),
            r"line 10: 'utilized' is blank, in 1 of 3 points",
        ),
        (DXL.replace(",9,1,", ",9,0,"), "none of its points is utilised"),
    ):
        (tmp_path / "a.csv").write_text(change)
        with pytest.raises(InputError, match=sentence):
            read_study(tmp_path)
    (tmp_path / "a.csv").write_text(DXL.replace("utilized", "other"))
    assert len(read_study(tmp_path).points) == 3


def test_an_ensite_file_without_eof_is_whole_where_its_count_of_points_says_so() -> None:
    counted = DXL.replace("***\n", "# mapping pts:,3,(sorted in order of acceptance)\n***\n").encode()
    whole = counted.replace(b"EOF\n", b"")
    assert len(ensite.read_map(Path("a.csv"), whole)[0]) == 2
    for cut, sentence in (
        (whole[: whole.index(b"C,7")], "ends without EOF, after 2 of 3 points; the file is truncated"),
        (whole[:-1], "ends without EOF, after 3 of 3 points"),  # its last number may have lost digits
        (DXL.replace("EOF\n", "").encode(), "after 3 of an unknown number of points"),
    ):
        with pytest.raises(InputError, match=sentence):
            ensite.read_map(Path("a.csv"), cut)


def test_an_ensite_case_is_named_after_the_map_else_after_the_file(tmp_path: Path) -> None:
    (tmp_path / "Map_PP_bi.csv").write_text(DXL)
    assert import_study(tmp_path / "Map_PP_bi.csv", None, tmp_path / "case").name == "lab"
    assert 'name = "lab"' in (tmp_path / "case/case.toml").read_text()
    (tmp_path / "Map_PP_bi.csv").write_text(DXL.replace("Map name:,lab", "Map name:,"))
    assert read_study(tmp_path / "Map_PP_bi.csv").name == "Map_PP_bi"


def numbered(kind: str, columns: str, *rows: str) -> str:
    """An export of the map `lab` with rows `number,x,y,z,utilized,value,valid`."""
    head = f"Export File Version: 11\nMap name:,lab\nMap type:,{kind}\n"
    return head + f"(Point #),roving x,roving y,roving z,utilized,{columns}\n" + "\n".join((*rows, "EOF\n"))


def test_ensite_files_of_one_map_are_joined_by_the_number_of_the_point(tmp_path: Path) -> None:
    voltage = ("3,7,8,9,1,0.3,1", "1,1,2,3,1,0.1,1", "2,4,5,6,0,0.2,1")
    times = ("1,1,2,3,0,-10,1", "2,4,5,6,1,-20,1", "3,7,8,9,1,-30,1")
    (tmp_path / "a.csv").write_text(numbered("PP_bi", "P-P,P-P valid", *voltage))
    (tmp_path / "b.csv").write_text(numbered("LAT_bi", "LAT,LAT valid", *times))
    points = read_study(tmp_path).points
    np.testing.assert_array_equal(points.xyz, [[1, 2, 3], [4, 5, 6], [7, 8, 9]])
    np.testing.assert_array_equal(points.columns["bipolar"], [0.1, np.nan, 0.3])
    np.testing.assert_array_equal(points.columns["lat"], [np.nan, -20, -30])
    assert set(points.columns) == {"bipolar", "lat"}
    other_map = numbered("LAT_bi", "LAT,LAT valid", *times).replace("lab", "other")
    moved = numbered("LAT_bi", "LAT,LAT valid", *times[:2], "3,7,8,9.5,1,-30,1")
    apart = numbered("LAT_bi", "LAT,LAT valid", *times[:2])  # no point is in both
    for doubtful in (other_map, moved, apart):
        (tmp_path / "b.csv").write_text(doubtful)
        with pytest.raises(InputError, match="several maps fit; say which file with --map"):
            read_study(tmp_path)


def test_points_of_one_freeze_are_a_group(tmp_path: Path) -> None:
    heads = "Freeze Grp #,P-P,P-P valid"
    rows = ("1,1,2,3,1,4,0.3,1", "2,4,5,6,1,4,0.1,1", "3,7,8,9,1,5,0.2,1")
    (tmp_path / "a.csv").write_text(numbered("PP_bi", heads, *rows))
    found = read_study(tmp_path)
    np.testing.assert_array_equal(found.points.columns["group"], [4.0, 4.0, 5.0])
    assert found.columns["a.csv, Freeze Grp #"] == "taken as group"


def test_ensite_files_of_one_map_must_agree(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(DXL)
    (tmp_path / "b.csv").write_text(DXL.replace("9,1,0.5,1", "9,1,0.6,1"))
    with pytest.raises(InputError, match="several maps fit; say which file with --map"):
        read_study(tmp_path)
    assert read_study(tmp_path, "b").points.columns["bipolar"][0] == 0.6


def test_ensite_tables_with_semicolons_are_the_same() -> None:
    points, preamble = ensite.read_map(Path("a.csv"), DXL.encode())
    other, same = ensite.read_map(Path("a.csv"), DXL.replace(",", ";").encode())
    np.testing.assert_array_equal(other.xyz, points.xyz)
    np.testing.assert_array_equal(other.columns["bipolar"], points.columns["bipolar"])
    assert same == preamble
    with pytest.raises(InputError, match="line 10, column 'roving y': value '2,5' has a decimal comma"):
        ensite.read_map(Path("a.csv"), DXL.replace(",", ";").replace("A;1;2;", "A;1;2,5;").encode())


def test_an_infinite_value_is_none() -> None:
    points, _ = ensite.read_map(Path("a.csv"), DXL.replace("9,1,0.5,1", "9,1,inf,1").encode())
    assert np.isnan(points.columns["bipolar"][0])
    tree = openep_tree()
    tree["electric"]["voltages"]["bipolar"][0] = np.inf
    assert np.isnan(openep.read_points(Path("s.mat"), openep.save(tree)).columns["bipolar"][0])


def test_ensite_cloud_lies_inside() -> None:
    cloud = ensite.read_cloud(Path("Model_Point_Cloud.csv"), b"trn_x,trn_y,trn_z,raw_x\n1,2,3,4\n5,6,7,8\n")
    assert cloud.type.tolist() == ["inside", "inside"]
    np.testing.assert_array_equal(cloud.xyz, [[1, 2, 3], [5, 6, 7]])


def openep_tree() -> dict[str, Any]:
    electric = {
        "egmX": np.arange(9.0).reshape(3, 3),
        "include": np.array([1.0, 0, 1]),
        "voltages": {"bipolar": np.array([0.1, 0.2, 0.3])},
        "annotations": {"mapAnnot": np.array([2010.0, 2000, 1990]), "referenceAnnot": np.full(3, 2000.0)},
        "sampleFrequency": 2000.0,
    }
    shell = {
        "triRep": {"X": marker().vertices, "Triangulation": marker().faces + 1.0},
        "act_bip": np.ones((4, 2)),
    }
    return {
        "surface": shell,
        "electric": electric,
        "rfindex": {"tag": {"X": np.array([[1.0, 1, 1], [2, 2, 2]])}},
    }


def test_openep_points_and_reference(tmp_path: Path) -> None:
    path = tmp_path / "s.mat"
    path.write_bytes(openep.save(openep_tree()))
    import_study(path, None, tmp_path / "case")
    points = read_points(tmp_path / "case/points.csv")
    np.testing.assert_array_equal(points.type, ["eam", "eam", "ablation", "ablation"])
    np.testing.assert_allclose(points.columns["lat"][:2], [5.0, -5.0])
    np.testing.assert_allclose(points.columns["bipolar"][:2], [0.1, 0.3])


def test_one_openep_reference_counts_for_all_points(tmp_path: Path) -> None:
    tree = openep_tree()
    tree["electric"]["annotations"]["referenceAnnot"] = np.array([2000.0])
    (tmp_path / "s.mat").write_bytes(openep.save(tree))
    np.testing.assert_allclose(read_study(tmp_path / "s.mat").points.columns["lat"][:2], [5.0, -5.0])


@pytest.mark.parametrize(
    "where",
    ["electric.include", "electric.voltages.bipolar", "electric.annotations.mapAnnot"],
)
def test_an_openep_column_that_is_too_short_is_named(where: str, tmp_path: Path) -> None:
    tree = openep_tree()
    *groups, last = where.split(".")
    branch = tree
    for name in groups:
        branch = branch[name]
    branch[last] = branch[last][:-1]
    (tmp_path / "s.mat").write_bytes(openep.save(tree))
    with pytest.raises(InputError, match=rf"s\.mat: {where} has \d rows: must be \d, one for each position"):
        read_study(tmp_path / "s.mat")


def mat5_element(kind: int, body: bytes) -> bytes:
    return struct.pack("<II", kind, len(body)) + body + b"\0" * (-len(body) % 8)


def with_object(tree: dict[str, Any], group: str, name: str, of: str) -> bytes:
    """The .mat file of a tree, in which the text at group.name became a MATLAB object of a class."""
    from scipy.io import savemat

    buffer = io.BytesIO()
    savemat(buffer, {"userdata": tree | {group: tree.get(group, {}) | {name: "PUTHERE"}}})
    data = buffer.getvalue()
    text = [
        mat5_element(4, np.array(list(map(ord, "PUTHERE")), "<u2").tobytes()),
        mat5_element(16, b"PUTHERE"),
    ]
    mark = next(part for part in text if part in data)
    end = data.index(mark) + len(mark)
    start = data.rindex(struct.pack("<I", 14), 0, end - len(mark))
    flags = mat5_element(6, struct.pack("<II", 17, 0))
    texts = b"".join(mat5_element(1, part) for part in (b"", b"MCOS", of.encode()))
    plain = (
        flags[:8]
        + struct.pack("<II", 13, 0)
        + mat5_element(5, struct.pack("<ii", 1, 1))
        + mat5_element(1, b"")
    )
    put = mat5_element(14, flags + texts + mat5_element(14, plain + mat5_element(6, b"\1\0\0\xdd")))
    longer = len(put) - (end - start)
    whole = bytearray(data[:start] + put + data[end:])
    for at in range(128, start, 4):  # the arrays around it grew by so much
        kind, size = struct.unpack_from("<II", data, at)
        if kind == 14 and at + 8 + size >= end:
            struct.pack_into("<I", whole, at + 4, size + longer)
    return bytes(whole)


def test_a_matlab_object_beside_the_points_is_passed_over(tmp_path: Path) -> None:
    from scipy.io import loadmat

    path = tmp_path / "s.mat"
    path.write_bytes(with_object(openep_tree(), "info", "date", "datetime"))
    assert "datetime" in str(loadmat(path)["userdata"]["info"][0, 0]["date"])
    (tmp_path / "plain.mat").write_bytes(openep.save(openep_tree()))
    want = read_study(tmp_path / "plain.mat").points
    np.testing.assert_array_equal(read_study(path).points.xyz, want.xyz)


@pytest.mark.parametrize(
    ("group", "name", "where", "read"),
    [
        ("surface", "triRep", "surface.triRep.X", read_surface),
        ("electric", "egmX", "electric.egmX", read_study),
    ],
)
def test_a_matlab_object_that_is_needed_is_named(
    group: str, name: str, where: str, read: Any, tmp_path: Path
) -> None:
    path = tmp_path / "s.mat"
    path.write_bytes(with_object(openep_tree(), group, name, "TriRep"))
    with pytest.raises(InputError, match=rf"s\.mat: {where} is, or .* class TriRep, .* as a struct of plain"):
        read(path)


def test_openep_points_are_taken_without_a_shell_that_is_an_object(tmp_path: Path) -> None:
    path = tmp_path / "s.mat"
    path.write_bytes(with_object(openep_tree(), "surface", "triRep", "TriRep"))
    found = import_study(path, None, tmp_path / "case")
    points = read_points(tmp_path / "case/points.csv")
    np.testing.assert_array_equal(points.type, ["eam", "eam", "ablation", "ablation"])
    np.testing.assert_array_equal(points.xyz[:2], [[0, 1, 2], [6, 7, 8]])
    assert any(
        line.startswith("the shell: surface.triRep is a MATLAB object of class TriRep") for line in found.left
    )
    assert not (tmp_path / "case/map.ply").exists()


def test_matlab_73_is_read_too(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "s.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["userdata/surface/triRep/X"] = marker().vertices.T
        file["userdata/surface/triRep/Triangulation"] = marker().faces.T + 1.0
        file["userdata/surface/act_bip"] = np.vstack([np.full(4, np.nan), marker().fields["bipolar"]])
    data = b"MATLAB 7.3 MAT-file".ljust(512, b"\0") + path.read_bytes()[512:]
    path.write_bytes(data)
    surface = read_surface(path)
    np.testing.assert_array_equal(surface.vertices, marker().vertices)
    np.testing.assert_array_equal(surface.fields["bipolar"], marker().fields["bipolar"])


def test_a_matlab_73_object_is_no_array_of_numbers(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "s.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        points = file.create_dataset("userdata/electric/egmX", data=np.arange(1, 7, dtype="u4").reshape(3, 2))
        points.attrs["MATLAB_class"] = np.bytes_("table")
        points.attrs["MATLAB_object_decode"] = np.int32(3)
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512, b"\0") + path.read_bytes()[512:])
    with pytest.raises(InputError, match=r"electric\.egmX is, or lies in, a MATLAB object of class table"):
        openep.read_points(path, path.read_bytes())


def test_an_imported_case_runs_as_one(tmp_path: Path) -> None:
    folder = carto_folder(tmp_path / "s")
    rng = np.random.default_rng(SEED)
    many = Points(rng.normal(size=(30, 3)) * 30, np.full(30, "eam"), {"bipolar": np.abs(rng.normal(size=30))})
    (folder / "1-Map_car.txt").write_bytes(car_file("1-Map", many))
    (tmp_path / "marks.csv").write_text("name,x,y,z\nLSPV,1,2,3\n")
    import_study(
        folder, "1-Map", tmp_path / "case", prior=write_as("ply", tmp_path), landmarks=tmp_path / "marks.csv"
    )
    case = read_case(tmp_path / "case")
    assert (len(case.points.of("eam")), case.landmark_pairs()[0], case.name) == (29, ["LSPV"], "1-Map")


def test_genuine_meshes_are_rewritten_byte_for_byte(shared_data: Path) -> None:
    meshes = sorted((shared_data / EXPORT).rglob("*.mesh"))
    assert len(meshes) == 4
    for path in meshes:
        data = path.read_bytes()
        assert encoder.encode(parser.parse(path, data)) == data, path


def test_genuine_carto_export_is_imported(shared_data: Path, tmp_path: Path) -> None:
    for name, volume, sites in (
        ("1-Map", 79.9473, 13),
        ("1-1-ReMap", 79.9473, 13),
        ("2-Map", 32.5028, 15),
        ("3-Map", 20.6055, 4),
    ):
        found = read_study(shared_data / EXPORT, name)
        assert found.shell is not None
        assert found.shell.surface.volume / 1000 == pytest.approx(volume, rel=VOLUME_TOLERANCE)
        assert (found.points.type == "ablation").sum() == sites, name
        assert f"VisiTag: {22 - sites} of 22 ablation sites" in "\n".join(found.left)
    found = import_study(shared_data / EXPORT, None, tmp_path / "case")
    points = read_points(tmp_path / "case/points.csv")
    assert (len(points.of("eam")), len(points.of("ablation"))) == (2, 15)
    np.testing.assert_allclose(points.xyz[0], [13.5681, 20.6895, 12.563])
    assert (points.columns["unipolar"][0], points.columns["bipolar"][0]) == (1.902, 0.024)
    assert np.isnan(points.columns["lat"][:2]).all()
    assert points.columns["force"][2] == 7.03  # of the first site that lies on this map
    assert found.name == "2-Map"


def test_samples_of_study_formats(shared_data: Path, tmp_path: Path) -> None:
    samples = shared_data / "formats/samples"
    assert len(read_study(samples / "dif/Map_PP_bi.csv").points) == 19
    assert len(read_study(samples / "openep_mat/synth_full.mat").points) == 12
    for path in (
        *samples.glob("carto_mesh/*.mesh"),
        samples / "dif/synth_sphere_v5.xml",
        *samples.glob("openep_mat/*.mat"),
        samples / "opencarp/synth.elem",
    ):
        surface = read_surface(path)
        np.testing.assert_allclose(surface.vertices.mean(axis=0), [10, -20, 30], atol=0.5)
        assert np.linalg.norm(surface.vertices - [10, -20, 30], axis=1) == pytest.approx(25.0, abs=1e-3)
