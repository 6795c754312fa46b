"""Every format pair keeps the marker object; readers that are not ours agree on what we write."""

from __future__ import annotations

import itertools
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from formats import FIELDS, SPACE, SUFFIX, TOLERANCE, lattice, marker, same_body, write_as

from o3dls.adapters.objects import points_of, surface_of, to_open3d, to_pyvista, to_trimesh
from o3dls.case import MILLIMETRES
from o3dls.errors import InputError
from o3dls.geometry.surface import Surface
from o3dls.io import case_surfaces
from o3dls.io.case_settings import Folder
from o3dls.io.images.registry import read_image
from o3dls.io.images.volumes import write_volume
from o3dls.io.markups import Markups, read_markups, write_markups
from o3dls.io.meshes.opencarp import write_mesh
from o3dls.io.meshes.repair import capped
from o3dls.io.points import read_points_table
from o3dls.io.surfaces import FORMATS, read_surface, read_surface_file, write_surface
from o3dls.io.transforms import read_transform, write_transform
from o3dls.runs.conversion import convert

ROOT = Path(__file__).resolve().parents[2]
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
VTK_FORMATS = ("vtk", "carto_vtk", "vtp")
POSE = np.array([[0.0, -1.2, 0, 30], [1.2, 0, 0, -4.5], [0, 0, 1.2, 5], [0, 0, 0, 1]])


def test_every_writable_format_is_tested_here() -> None:
    assert {f.name for f in FORMATS} - {"labels"} == set(TOLERANCE)


@pytest.mark.parametrize(("first", "second"), list(itertools.product(TOLERANCE, TOLERANCE)))
def test_every_pair_of_formats_keeps_the_marker(first: str, second: str, tmp_path: Path) -> None:
    target = tmp_path / f"out.{SUFFIX.get(second, second)}"
    convert(write_as(first, tmp_path), target, format=second, frame=None if first in SPACE else "LPS")
    file = read_surface_file(target)
    same_body(file.surface.vertices, file.surface.faces, TOLERANCE[first] + TOLERANCE[second])
    assert file.space == SPACE.get(second, "unknown")


@pytest.mark.parametrize("name", list(TOLERANCE))
def test_frames_turn_and_come_back(name: str, tmp_path: Path) -> None:
    stated = None if name in SPACE else "LPS"
    convert(write_as(name, tmp_path), tmp_path / "ras.vtp", frame=stated, to="RAS")
    turned = read_surface_file(tmp_path / "ras.vtp")
    assert turned.space == "RAS"
    expected = marker().transformed(HALF_TURN)
    same_body(turned.surface.vertices, turned.surface.faces, TOLERANCE[name], expected)
    convert(tmp_path / "ras.vtp", tmp_path / "lps.ply", to="LPS")
    same_body(*(lambda s: (s.vertices, s.faces))(read_surface(tmp_path / "lps.ply")), TOLERANCE[name])


@pytest.mark.parametrize(("name", "field"), list(FIELDS.items()))
def test_fields_arrive_where_the_format_has_room(name: str, field: str, tmp_path: Path) -> None:
    found = read_surface(write_as(name, tmp_path)).fields
    for key in ("bipolar", "depth") if field == "any" else (field,):
        np.testing.assert_allclose(found[key], marker().fields[key], rtol=1e-6)


@pytest.mark.parametrize("name", VTK_FORMATS)
def test_vtk_agrees(name: str, tmp_path: Path) -> None:
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkXMLPolyDataReader() if name == "vtp" else vtk.vtkPolyDataReader()
    reader.SetFileName(str(write_as(name, tmp_path)))
    reader.Update()
    mesh = reader.GetOutput()
    same_body(
        vtk_to_numpy(mesh.GetPoints().GetData()),
        vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3),
        TOLERANCE[name],
    )
    if name == "carto_vtk":
        assert reader.GetHeader() == "PatientData Anon Anon 00000000"
        assert mesh.GetPointData().GetScalars().GetLookupTable().GetNumberOfTableValues() == 256
        return
    values = vtk_to_numpy(mesh.GetPointData().GetArray("bipolar"))
    np.testing.assert_array_equal(values, marker().fields["bipolar"])
    if name == "vtp":
        assert mesh.GetFieldData().GetAbstractArray("SPACE").GetValue(0) == "LPS"


@pytest.mark.parametrize("version", [30, 42, 51])
@pytest.mark.parametrize("binary", [True, False])
def test_we_read_what_vtk_writes(version: int, binary: bool, tmp_path: Path) -> None:
    vtk = pytest.importorskip("vtk")
    mesh = to_pyvista_or_skip()
    mesh.point_data["µ name"] = np.arange(4.0)
    writer = vtk.vtkPolyDataWriter()
    writer.SetInputData(mesh)
    writer.SetFileName(str(tmp_path / "a.vtk"))
    if version != 30:
        writer.SetFileVersion(version)
    (writer.SetFileTypeToBinary if binary else writer.SetFileTypeToASCII)()
    writer.Write()
    surface = read_surface(tmp_path / "a.vtk")
    same_body(surface.vertices, surface.faces, 1e-4)
    np.testing.assert_allclose(surface.fields["depth"], marker().fields["depth"])
    np.testing.assert_allclose(surface.fields["µ name"], np.arange(4.0))


@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended", "raw"])
@pytest.mark.parametrize(
    "packer", [None, "vtkZLibDataCompressor", "vtkLZMADataCompressor", "vtkLZ4DataCompressor"]
)
def test_we_read_every_vtp_of_vtk(mode: str, packer: str | None, tmp_path: Path) -> None:
    vtk = pytest.importorskip("vtk")
    writer = vtk.vtkXMLPolyDataWriter()
    writer.SetInputData(to_pyvista_or_skip())
    writer.SetFileName(str(tmp_path / "a.vtp"))
    writer.SetEncodeAppendedData(mode != "raw")
    getattr(writer, f"SetDataModeTo{'Appended' if mode == 'raw' else mode}")()
    writer.SetCompressor(getattr(vtk, packer)() if packer else None)
    writer.SetByteOrderToBigEndian()
    writer.Write()
    if packer == "vtkLZ4DataCompressor":
        pytest.importorskip("lz4")
    surface = read_surface(tmp_path / "a.vtp")
    same_body(surface.vertices, surface.faces, 1e-12 if mode != "Ascii" else 1e-4)
    np.testing.assert_array_equal(surface.fields["bipolar"], marker().fields["bipolar"])


@pytest.mark.parametrize("suffix", ["vtk", "vtp", "object"])
def test_strips_beside_polygons_are_read(suffix: str, tmp_path: Path) -> None:
    vtk = pytest.importorskip("vtk")
    pyvista = pytest.importorskip("pyvista")
    halves = [
        to_pyvista(Surface(marker().vertices, part)) for part in (marker().faces[:2], marker().faces[2:])
    ]
    stripper = vtk.vtkStripper()
    stripper.SetInputData(halves[1])
    stripper.Update()
    mesh = pyvista.PolyData(
        marker().vertices, faces=halves[0].faces, strips=pyvista.wrap(stripper.GetOutput()).strips
    )
    if suffix != "object":
        mesh.save(tmp_path / f"a.{suffix}")
    surface = surface_of(mesh) if suffix == "object" else read_surface(tmp_path / f"a.{suffix}")
    same_body(surface.vertices, surface.faces, 1e-12)


def test_colours_of_vtk_are_the_same_in_text_and_binary(tmp_path: Path) -> None:
    pytest.importorskip("pyvista")
    mesh = to_pyvista(marker())
    mesh.point_data["rgb"] = np.arange(0, 252, 21, dtype=np.uint8).reshape(4, 3)
    mesh.point_data.active_scalars_name = "rgb"
    for binary in (True, False):
        mesh.save(tmp_path / "a.vtk", binary=binary)
        assert b"COLOR_SCALARS" in (tmp_path / "a.vtk").read_bytes()
        np.testing.assert_array_equal(read_surface(tmp_path / "a.vtk").fields["rgb"], mesh.point_data["rgb"])


def test_dif_is_in_lps_whatever_is_written(tmp_path: Path) -> None:
    convert(write_as("ply", tmp_path), tmp_path / "ras.xml", to="RAS")
    file = read_surface_file(tmp_path / "ras.xml")
    assert file.space == "LPS"
    same_body(file.surface.vertices, file.surface.faces, TOLERANCE["dif"])


def test_volumes_of_one_name_are_told_apart(tmp_path: Path) -> None:
    path = write_as("dif", tmp_path)
    volume = path.read_text().partition("<Volume ")[2].partition("</Volume>")[0]
    path.write_text(
        path.read_text().replace(
            "</Volume>", f"</Volume><Volume {volume.replace('10.0000', '12.0000')}</Volume>"
        )
    )
    with pytest.raises(
        InputError, match=r"say which with --part: surface \(volume 0\), surface \(volume 1\)"
    ):
        read_surface(path)
    starts = [read_surface_file(path, part=f"surface (volume {k})").surface.vertices[0, 0] for k in (0, 1)]
    assert starts == [10.0, 12.0]


@pytest.mark.parametrize(
    ("name", "read_as"), [("late_gadolinium", "late_gadolinium"), ("lat", "lat"), ("LAT Isochronal", "lat")]
)
def test_dif_scalars_keep_their_names(name: str, read_as: str, tmp_path: Path) -> None:
    path = write_as("dif", tmp_path, Surface(marker().vertices, marker().faces, {name: np.arange(4.0)}))
    assert read_as in read_surface(path).fields


def to_pyvista_or_skip() -> object:
    pytest.importorskip("pyvista")
    return to_pyvista(marker())


@pytest.mark.parametrize("name", ["ply", "stl", "obj", "off"])
def test_trimesh_open3d_and_pymeshlab_agree(name: str, tmp_path: Path) -> None:
    import open3d as o3d
    import pymeshlab
    import trimesh

    path = write_as(name, tmp_path)
    body = trimesh.load(path, process=False)
    same_body(body.vertices, body.faces, TOLERANCE[name] + 1e-5)
    mesh = o3d.io.read_triangle_mesh(str(path))
    same_body(np.asarray(mesh.vertices), np.asarray(mesh.triangles), TOLERANCE[name] + 1e-4)
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(path))
    same_body(
        meshes.current_mesh().vertex_matrix(), meshes.current_mesh().face_matrix(), TOLERANCE[name] + 1e-4
    )


@pytest.mark.parametrize("name", ["ply", "stl", "obj", "off"])
def test_meshio_agrees(name: str, tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    mesh = meshio.read(write_as(name, tmp_path))
    same_body(mesh.points, mesh.cells_dict["triangle"], TOLERANCE[name] + 1e-5)


@pytest.mark.parametrize(("name", "reader"), [("carto_mesh", "cartoio"), ("dif", "precisionio")])
def test_pyceps_agrees(name: str, reader: str, tmp_path: Path) -> None:
    """GPL, so it runs in an environment of its own and never in ours."""
    python = Path(os.environ.get("O3DLS_PYCEPS", ROOT / ".dev/pyceps/bin/python"))
    if not python.exists():
        pytest.skip(
            f"no pyceps in {python}: python3 -m venv .dev/pyceps && .dev/pyceps/bin/pip install pyceps, "
            "or set O3DLS_PYCEPS"
        )
    path = write_as(name, tmp_path)
    code = (
        f"import sys, numpy as np\nfrom pyceps.fileio.{reader} import read_mesh_file\n"
        "found = read_mesh_file(open(sys.argv[1], 'rb'))\nfound = found[0] if isinstance(found, tuple) "
        "else found\n"
        "np.savez(sys.argv[2], x=found.X, t=found.tris)"
    )
    subprocess.run(
        [python, "-W", "ignore", "-c", code, path, tmp_path / "found.npz"], check=True, capture_output=True
    )
    with np.load(tmp_path / "found.npz") as found:
        same_body(found["x"], found["t"], TOLERANCE[name] + 1e-5)


def test_volumes_lie_where_other_libraries_find_them(tmp_path: Path) -> None:
    nibabel, nrrd, sitk = (pytest.importorskip(name) for name in ("nibabel", "nrrd", "SimpleITK"))
    values = np.zeros((5, 6, 7))
    values[1, 2, 3] = 9.0
    origin = np.array([-10.0, 20.0, 5.0])
    place = origin + 1.5 * np.array([1, 2, 3])
    for name in ("a.nrrd", "a.nii.gz", "a.nii"):
        write_volume(tmp_path / name, values, lattice(1.5, origin), space="LPS")
        image = sitk.ReadImage(str(tmp_path / name))
        np.testing.assert_allclose(image.TransformIndexToPhysicalPoint((1, 2, 3)), place, atol=1e-5)
        assert image[1, 2, 3] == 9.0
    image = nibabel.load(tmp_path / "a.nii.gz")
    np.testing.assert_allclose(image.affine @ [1, 2, 3, 1], [*(place * [-1, -1, 1]), 1], atol=1e-5)
    assert np.asarray(image.dataobj)[1, 2, 3] == 9.0
    data, header = nrrd.read(str(tmp_path / "a.nrrd"))
    assert data[1, 2, 3] == 9.0
    assert header["space"] == "left-posterior-superior"
    np.testing.assert_allclose(header["space origin"] + header["space directions"].T @ [1, 2, 3], place)
    write_volume(tmp_path / "m.nrrd", values > 0, lattice(1.5, origin), space="unknown")
    assert nrrd.read(str(tmp_path / "m.nrrd"))[0].dtype == np.uint8
    assert read_image(tmp_path / "m.nrrd", (tmp_path / "m.nrrd").read_bytes()).space == "unknown"
    with pytest.raises(InputError, match="NIfTI is RAS by definition"):
        write_volume(tmp_path / "u.nii", values, lattice(1.5, origin), space="unknown")


def test_opencarp_word_for_word(tmp_path: Path) -> None:
    base = write_as("opencarp", tmp_path)
    # micrometres
    assert base.read_text().splitlines()[:2] == [
        "4",
        "10000.000000 -20000.000000 30000.000000",
    ]
    assert base.with_suffix(".elem").read_text() == "4\nTr 0 2 1 1\nTr 0 1 3 1\nTr 1 2 3 1\nTr 0 3 2 1\n"
    assert base.with_suffix(".lon").read_text() == "1\n" + "1.000000 0.000000 0.000000\n" * 4
    assert (tmp_path / "opencarp_depth.dat").read_text() == "1\n2\n3\n4.5\n"
    # it has a missing value, for which the format has no word: a mask says where
    assert (tmp_path / "opencarp_bipolar.dat").read_text() == "0.125\n-10000\n2.5\n1.25\n"
    assert (tmp_path / "opencarp_bipolar_known.dat").read_text() == "1\n0\n1\n1\n"
    assert not (tmp_path / "opencarp_depth_known.dat").exists()


def test_fields_of_opencarp_belong_to_their_mesh(tmp_path: Path) -> None:
    surface = Surface(marker().vertices, marker().faces, {"a b": np.arange(4.0), "a_b": np.ones(4)})
    base = tmp_path / "map[1].pts"
    write_surface(base, surface)
    assert list(read_surface(base).fields) == ["a_b", "a_b_"]
    with pytest.raises(InputError, match=r"map\[1\]_a_b.dat: is a field of an earlier mesh of this name"):
        write_surface(base, marker())
    write_surface(
        tmp_path / "map[1]_fine.pts", Surface(marker().vertices[:3], [[0, 1, 2]], {"lat": np.ones(3)})
    )
    assert list(read_surface(base).fields) == ["a_b", "a_b_"]
    assert list(read_surface(tmp_path / "map[1]_fine.elem").fields) == ["lat"]


def test_files_of_opencarp_have_the_base_that_is_named(tmp_path: Path) -> None:
    write_mesh(tmp_path / "la.v2", marker())
    ends = (".pts", ".elem", ".lon", "_depth.dat", "_bipolar.dat", "_bipolar_known.dat")
    assert {p.name for p in tmp_path.iterdir()} == {f"la.v2{end}" for end in ends}
    for suffix in (".pts", ".elem"):
        (tmp_path / f"la.v2{suffix}").rename(tmp_path / f"LA{suffix.upper()}")
    surface = read_surface(tmp_path / "LA.PTS")
    same_body(surface.vertices, surface.faces, TOLERANCE["opencarp"])


def plain_opencarp(folder: Path, unit: float) -> Path:
    """The marker as openCARP's two files, without our writer; `unit` in mm."""
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in marker().vertices / unit)
    (folder / "la.pts").write_text(f"4\n{rows}")
    (folder / "la.elem").write_text("4\n" + "".join(f"Tr {i} {j} {k} 1\n" for i, j, k in marker().faces))
    return folder / "la.pts"


@pytest.mark.parametrize("units", ["um", "mm", "cm", "m"])
def test_units_that_are_said_of_opencarp_are_obeyed(units: str, tmp_path: Path) -> None:
    source = plain_opencarp(tmp_path, MILLIMETRES[units])
    convert(source, tmp_path / "a.vtp", units=units)
    np.testing.assert_allclose(read_surface(tmp_path / "a.vtp").vertices, marker().vertices, rtol=1e-6)


def test_opencarp_that_is_not_plainly_in_micrometres_is_asked_about(tmp_path: Path) -> None:
    sentence = r"la.pts: states no units, and extends over 0.0754 mm if it is in um.* over 75.4 mm if in mm"
    with pytest.raises(InputError, match=sentence + r"; say --units um or --units mm"):
        convert(plain_opencarp(tmp_path, 1.0), tmp_path / "a.vtp")
    assert not (tmp_path / "a.vtp").exists()
    convert(plain_opencarp(tmp_path, MILLIMETRES["um"]), tmp_path / "a.vtp")
    np.testing.assert_allclose(read_surface(tmp_path / "a.vtp").vertices, marker().vertices, rtol=1e-6)


def test_a_prior_of_opencarp_in_a_case_takes_the_units_of_the_case(tmp_path: Path) -> None:
    for suffix in ("pts", "elem"):
        plain_opencarp(tmp_path, 1.0).with_suffix(f".{suffix}").rename(tmp_path / f"prior.{suffix}")
    settings = {"prior": "prior.pts"}
    with pytest.raises(InputError, match=r"prior\.pts: states no units"):
        case_surfaces.surface_of(Folder(tmp_path, settings, {}), "prior")
    prior = case_surfaces.surface_of(Folder(tmp_path, settings | {"units": "mm"}, {}), "prior")
    np.testing.assert_allclose(prior.surface.vertices, marker().vertices)
    plain_opencarp(tmp_path, MILLIMETRES["um"]).rename(tmp_path / "prior.pts")
    with pytest.raises(
        InputError, match=r"extends over 75418.* mm, as units say, and over 75.4 mm if it is in um"
    ):
        case_surfaces.surface_of(Folder(tmp_path, settings | {"units": "mm"}, {}), "prior")


@pytest.mark.parametrize("space", ["LPS", "RAS"])
def test_markups_keep_names_and_places(space: str, tmp_path: Path) -> None:
    marks = Markups(("LSPV", "RSPV µ"), marker().vertices[:2], space)
    write_markups(tmp_path / "a.mrk.json", marks)
    back = read_markups(tmp_path / "a.mrk.json")
    assert (back.names, back.space) == (marks.names, space)
    np.testing.assert_array_equal(back.xyz, marks.xyz)
    convert(tmp_path / "a.mrk.json", tmp_path / "a.csv", to="LPS")
    convert(tmp_path / "a.csv", tmp_path / "b.mrk.json", to=space)
    np.testing.assert_array_equal(read_markups(tmp_path / "b.mrk.json").xyz, marks.xyz)


def test_markups_of_old_and_new_slicer_are_the_same_places(shared_data: Path) -> None:
    found = [
        read_markups(p).in_space("LPS")
        for p in sorted((shared_data / "formats/samples/slicer_markups").glob("*.*s*"))
    ]
    assert len(found) == 3
    for other in found[1:]:
        assert other.names == found[0].names
        np.testing.assert_allclose(other.xyz, found[0].xyz)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("# columns = id,x,y,z,label\n1,2,3,4,A\n", "states no '# CoordinateSystem.* o3dls convert --frame"),
        (
            "# CoordinateSystem = 2\n# columns = x,y,z,label\n",
            "CoordinateSystem = '2': must be one of 0, 1, RAS",
        ),
        ("# CoordinateSystem =\n# columns = x,y,z,label\n", "CoordinateSystem = '': must be one of"),
        (
            "# CoordinateSystem = LPS\n# columns = id,x,y,z,label\n1,2,x,4,A\n",
            "line 3: coordinate 'x' is not a number",
        ),
        (
            "# CoordinateSystem = LPS\n# columns = id,x,y,z,label\n1,2,1_0,4,A\n",
            "line 3: coordinate '1_0' is not a number",
        ),
        ("# CoordinateSystem = LPS\n# columns = id,x,y,label\n", "must name x, y, z"),
        ('{"markups": []}', "no list 'markups'"),
        ('{"markups": [{"coordinateSystem": "IJK"}]}', "must be LPS or RAS"),
        ('{"markups": [{"coordinateUnits": {"a": 1}}]}', "coordinateUnits .* one of mm"),
        ('{"markups": [{"controlPoints": [{"position": [1, 2]}]}]}', "must be three numbers"),
        ('{"markups": ', "is not JSON"),
    ],
)
def test_wrong_markups_are_refused(text: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "a.fcsv").write_text(text)
    with pytest.raises(InputError, match=sentence):
        read_markups(tmp_path / "a.fcsv")


@pytest.mark.parametrize(("frame", "sign"), [("LPS", 1.0), ("RAS", -1.0)])
def test_the_frame_of_markups_of_slicer_3_is_the_one_that_is_given(
    frame: str, sign: float, tmp_path: Path
) -> None:
    path = tmp_path / "a.fcsv"
    path.write_text("# Fiducial List file a.fcsv\n# columns = label,x,y,z,sel,vis\nLSPV,1.5,2,3,1,1\n")
    with pytest.raises(InputError, match=r"a\.fcsv: states no '# CoordinateSystem"):
        convert(path, tmp_path / "a.csv")
    convert(path, tmp_path / "a.csv", frame=frame, to="LPS")
    table = read_points_table(tmp_path / "a.csv")
    np.testing.assert_array_equal([table.numbers(axis)[0] for axis in "xyz"], [sign * 1.5, sign * 2, 3])
    for number, stated in (("0", "RAS"), ("1", "LPS")):
        path.write_text(f"# CoordinateSystem = {number}\n# columns = label,x,y,z\nLSPV,1.5,2,3\n")
        assert read_markups(path).space == stated
        if frame != stated:
            with pytest.raises(InputError, match=f"states frame {stated}, and {frame} was given"):
                convert(path, tmp_path / "a.csv", frame=frame)


@pytest.mark.parametrize("space", ["LPS", "RAS"])
def test_poses_survive_text_and_itk(space: str, tmp_path: Path) -> None:
    for name in ("a.txt", "a.tfm"):
        write_transform(tmp_path / name, POSE, space)
        matrix, stated = read_transform(tmp_path / name)
        expected = POSE if stated == space else HALF_TURN @ POSE @ HALF_TURN
        np.testing.assert_allclose(matrix, expected, atol=1e-12)
    with pytest.raises(InputError, match="must be LPS or RAS"):
        write_transform(tmp_path / "a.tfm", POSE, "unknown")


@pytest.mark.parametrize("count", ["#Transform {k}", "# Transform"])
def test_several_itk_transforms_are_refused_by_name(count: str, tmp_path: Path) -> None:
    kinds = ("AffineTransform_double_3_3", "ThinPlateSplineKernelTransform_double_3_3")
    parts = [
        f"{count.format(k=k)}\nTransform: {kind}\nParameters: 1 0 0 0 1 0 0 0 1 {k} 0 0\n"
        "FixedParameters: 0 0 0\n"
        for k, kind in enumerate((kinds[0], *kinds))
    ]
    path = tmp_path / "a.tfm"
    head = "#Insight Transform File V1.0\n"
    for chosen, named in (
        (parts[:2], rf"holds {kinds[0]}, {kinds[0]}: must"),
        (parts[2:], rf"holds {kinds[1]}: must"),
    ):
        path.write_text(head + "".join(chosen))
        with pytest.raises(InputError, match=named):
            read_transform(path)


def test_itk_resamples_the_prior_into_the_map_by_our_transform(tmp_path: Path) -> None:
    """ITK's transform takes a point of the map to the prior: the inverse of T_map_prior."""
    sitk = pytest.importorskip("SimpleITK")
    write_transform(tmp_path / "a.tfm", POSE, "LPS")
    found = sitk.ReadTransform(str(tmp_path / "a.tfm"))
    prior = np.array([3.0, -7.0, 11.0])
    np.testing.assert_allclose(
        found.TransformPoint(tuple(POSE[:3, :3] @ prior + POSE[:3, 3])), prior, atol=1e-9
    )


def test_openigtlink_by_golden_bytes(shared_data: Path) -> None:
    from o3dls.io.mapping import igtl

    golden = (shared_data / "formats/samples/openigtlink/synth_sphere_polydata_v1.bin").read_bytes()
    assert igtl.HEADER.unpack(golden[:58])[5] == igtl.crc64(golden[58:])
    n, m = 162, 320
    points = np.frombuffer(golden, ">f4", 3 * n, 98).reshape(n, 3)
    cells = np.frombuffer(golden, ">u4", 4 * m, 98 + 12 * n).reshape(m, 4)
    data = np.frombuffer(golden, ">f4", 4 * n, len(golden) - 16 * n)
    fields = {"Bipolar": data[:n].astype(float), "Normals": data[n:].reshape(n, 3).astype(float)}
    ours = igtl.polydata(Surface(points.astype(float), cells[:, 1:].astype(int), fields), "o3dls_LA")
    assert without_vector_type(ours) == without_vector_type(golden)


def without_vector_type(message: bytes) -> bytes:
    """The body without the types of its attributes: the sample calls its normals type 2, we know a vector
    only.
    """
    body = bytearray(message[58:])
    start = 40 + 12 * 162 + 16 * 320
    body[start] = body[start + 6] = 0
    return bytes(body)


def test_openigtlink_cube_of_the_library(shared_data: Path) -> None:
    from o3dls.io.mapping import igtl

    golden = (shared_data / "formats/samples/openigtlink/polydata_cube_v1.bin").read_bytes()
    assert igtl.crc64(golden[58:]) == 0x73DDDFC80C48C62B == igtl.HEADER.unpack(golden[:58])[5]


def test_openigtlink_arrives_over_a_socket() -> None:
    import socket
    import threading

    from o3dls.io.mapping import igtl

    messages = [igtl.polydata(marker()), igtl.points(("LSPV",), marker().vertices[:1]), igtl.transform(POSE)]
    received: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def listen() -> None:
            connection, _ = server.accept()
            with connection:
                while data := connection.recv(65536):
                    received.append(data)

        listener = threading.Thread(target=listen)
        listener.start()
        sent = igtl.send(messages, "127.0.0.1", server.getsockname()[1])
        listener.join(timeout=5)
        port = server.getsockname()[1]
    stream = b"".join(received)
    assert sent == (len(stream), True)
    kinds = []
    while stream:
        _, kind, _, _, size, crc = igtl.HEADER.unpack(stream[:58])
        body = stream[58 : 58 + size]
        stream = stream[58 + size :]
        assert igtl.crc64(body) == crc
        kinds.append((kind.rstrip(b"\0"), body))
    assert [kind for kind, _ in kinds] == [b"POLYDATA", b"POINT", b"TRANSFORM"]
    assert struct.unpack(">3f", kinds[1][1][100:112]) == pytest.approx(marker().vertices[0])
    assert struct.unpack(">12f", kinds[2][1])[9:] == pytest.approx(POSE[:3, 3])
    with pytest.raises(InputError, match="nobody answers"):
        igtl.send(messages, "127.0.0.1", port, timeout=0.5)


@pytest.mark.parametrize("read", [0, 58], ids=["nothing", "one header"])
def test_an_openigtlink_receiver_that_closes_early_is_an_error(read: int) -> None:
    import socket
    import threading

    from o3dls.io.mapping import igtl

    with socket.create_server(("127.0.0.1", 0)) as server:

        def listen() -> None:
            connection, _ = server.accept()
            with connection:
                if read:
                    connection.recv(read)

        listener = threading.Thread(target=listen)
        listener.start()
        with pytest.raises(InputError, match="the receiver did not read everything"):
            igtl.send([igtl.transform(POSE)] * 3, "127.0.0.1", server.getsockname()[1])
        listener.join(timeout=5)


def test_an_openigtlink_receiver_that_never_closes_is_not_taken_to_have_read() -> None:
    import socket

    from o3dls.io.mapping import igtl

    with socket.create_server(("127.0.0.1", 0)) as server:  # which accepts nobody
        data = igtl.transform(POSE)
        sent = igtl.send([data], "127.0.0.1", server.getsockname()[1], timeout=0.2)
    assert sent == (len(data), False)


def test_a_run_is_sent_in_ras(tmp_path: Path) -> None:
    from o3dls.io.mapping import igtl
    from o3dls.runs.live import messages
    from tests.finished import bulged_case, finished

    run = finished(tmp_path / "run", bulged_case("any"))
    surface, pose, *rest = messages(run)
    n = struct.unpack(">I", surface[58:62])[0]
    sent = np.frombuffer(surface, ">f4", 3 * n, 98).reshape(n, 3)
    estimate = next(iter(sorted((run / "estimates").glob("level_set/surface.ply"))))
    np.testing.assert_allclose(sent, read_surface(estimate).vertices * [-1, -1, 1], atol=1e-4)
    assert igtl.HEADER.unpack(pose[:58])[1].rstrip(b"\0") == b"TRANSFORM"
    assert all(igtl.HEADER.unpack(m[:58])[1].rstrip(b"\0") == b"POINT" for m in rest)
    with pytest.raises(InputError, match="no estimate 'levelset'"):
        messages(run, "levelset")


def test_objects_of_other_libraries_and_back() -> None:
    pytest.importorskip("pyvista")
    import open3d as o3d

    for made in (to_open3d(marker()), to_trimesh(marker()), to_pyvista(marker())):
        surface = surface_of(made)
        same_body(surface.vertices, surface.faces, 0.0)
        np.testing.assert_array_equal(surface.fields["bipolar"], marker().fields["bipolar"])
        np.testing.assert_array_equal(
            points_of(made).xyz if "open3d" not in type(made).__module__ else made.vertex.positions.numpy(),
            marker().vertices,
        )
    legacy = to_open3d(marker()).to_legacy()
    same_body(surface_of(legacy).vertices, surface_of(legacy).faces, 0.0)
    cloud = o3d.geometry.PointCloud(legacy.vertices)
    np.testing.assert_array_equal(points_of(cloud).xyz, marker().vertices)
    np.testing.assert_array_equal(
        points_of(o3d.t.geometry.PointCloud.from_legacy(cloud)).xyz, marker().vertices.astype(np.float32)
    )
    with pytest.raises(InputError, match="is not a surface: must be a mesh of Open3D"):
        surface_of("mesh")


def test_editing_a_mesh_leaves_the_surface_as_it_was() -> None:
    pytest.importorskip("pyvista")
    case, made = marker(), marker()
    to_open3d(case).translate([100.0, 0, 0])
    for mesh, points, fields in [
        (m := to_trimesh(case), m.vertices, m.vertex_attributes),
        (m := to_pyvista(case), m.points, m.point_data),
    ]:
        points += 100.0
        fields["bipolar"][:] = 9.0
        back = surface_of(mesh)
        points += 100.0
        fields["bipolar"][:] = 7.0
        np.testing.assert_array_equal(back.vertices, made.vertices + 100.0)
        np.testing.assert_array_equal(back.fields["bipolar"], 9.0)
    same_body(case.vertices, case.faces, 0.0)
    np.testing.assert_array_equal(case.fields["bipolar"], made.fields["bipolar"])


def test_objects_that_are_no_mesh_are_refused() -> None:
    import open3d as o3d
    import trimesh

    tensor = o3d.t.geometry
    cloud = trimesh.PointCloud(np.zeros((3, 3)))
    for thing in (
        o3d.geometry.PointCloud(),
        tensor.PointCloud(),
        tensor.TriangleMesh(),
        cloud,
        trimesh.Scene(cloud),
    ):
        with pytest.raises(InputError, match=r"is not a surface|mesh is empty|Trimesh: must be one"):
            surface_of(thing)
    assert surface_of(trimesh.primitives.Box()).area == pytest.approx(6.0)
    for thing in (tensor.PointCloud(), trimesh.Scene(), "points"):
        with pytest.raises(InputError, match=r"holds no points|must be one; .* it is empty"):
            points_of(thing)


def test_conversion_says_what_it_needs(tmp_path: Path) -> None:
    path = write_as("off", tmp_path, Surface(marker().vertices / 1000, marker().faces))
    text = path.read_text().replace("SPACE=LPS UNITS=mm", "")
    path.write_text(text)
    out = tmp_path / "o.ply"
    with pytest.raises(InputError, match="if its units are m, say --units m"):
        convert(path, out)
    with pytest.raises(InputError, match="its frame is not known"):
        convert(path, out, units="m", to="RAS")
    with pytest.raises(InputError, match="'label' does not apply to a off file"):
        convert(path, out, units="m", label=3)
    convert(path, out, units="m", frame="RAS", to="LPS")
    file = read_surface_file(out)
    assert (file.units, file.space) == ("mm", "LPS")
    same_body(file.surface.vertices, file.surface.faces, 1e-6, marker().transformed(HALF_TURN))
    with pytest.raises(InputError, match="states units mm, and cm was given"):
        convert(out, tmp_path / "p.ply", units="cm")


def test_units_that_nobody_knows_are_asked_for_and_the_option_wins(tmp_path: Path) -> None:
    write_surface(tmp_path / "a.ply", marker(), units="millimeter")
    (tmp_path / "a.csv").write_text("# units=millimeter\nx,y,z\n0,0,0\n30,40,50\n")
    for name in ("a.ply", "a.csv"):
        with pytest.raises(
            InputError, match=r"states units 'millimeter': must be one of mm, .* say which with --units"
        ):
            convert(tmp_path / name, tmp_path / f"b{name[1:]}")
        convert(tmp_path / name, tmp_path / f"b{name[1:]}", units="mm")
    np.testing.assert_array_equal(read_surface(tmp_path / "b.ply").vertices, marker().vertices)


def test_tables_of_points_keep_columns_and_units(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        '# units=cm\nname,x,y,z,sigma,acq_id\n"#1",1,2,3,.1,007\n"#2",4,15,6,,12345678901234567\n'
    )
    convert(tmp_path / "a.csv", tmp_path / "b.csv", frame="LPS", to="RAS")
    table = read_points_table(tmp_path / "b.csv")
    assert dict(table.notes) == {"space": "RAS", "units": "mm"}
    assert list(table.columns) == ["name", "x", "y", "z", "sigma", "acq_id"]
    assert table.columns["name"] == ["#1", "#2"]
    assert table.columns["acq_id"] == ["007", "12345678901234567"]
    np.testing.assert_allclose(table.numbers("x"), [-10, -40])
    np.testing.assert_allclose(table.numbers("sigma", missing=True), [1, np.nan])
    (tmp_path / "c.csv").write_text("# units=px\nx,y,z\n0,0,0\n30,40,50\n")
    convert(tmp_path / "c.csv", tmp_path / "d.csv")
    assert read_points_table(tmp_path / "d.csv").notes["units"] == "px"
    with pytest.raises(InputError, match=r"Slicer's markups are in mm, and .*c\.csv is in px"):
        convert(tmp_path / "c.csv", tmp_path / "d.mrk.json", frame="LPS")


def test_names_of_places_survive_or_are_refused(tmp_path: Path) -> None:
    marks = Markups(("#1", "#2", "a, b"), marker().vertices[:3], "LPS")
    write_markups(tmp_path / "a.mrk.json", marks)
    convert(tmp_path / "a.mrk.json", tmp_path / "a.csv")
    convert(tmp_path / "a.csv", tmp_path / "b.mrk.json")
    assert read_markups(tmp_path / "b.mrk.json").names == marks.names
    write_markups(tmp_path / "a.mrk.json", Markups(("two\nlines",), np.zeros((1, 3)), "LPS"))
    with pytest.raises(InputError, match=r"c\.csv: column 'name': .* holds a line break"):
        convert(tmp_path / "a.mrk.json", tmp_path / "c.csv")
    (tmp_path / "n.json").write_text(
        '{"markups": [{"controlPoints": [{"label": null, "position": [1, 2, 3]}]}]}'
    )
    assert read_markups(tmp_path / "n.json").names == ("",)


def test_a_pose_takes_no_units(tmp_path: Path) -> None:
    write_transform(tmp_path / "a.txt", POSE, "LPS")
    with pytest.raises(InputError, match="omit --units"):
        convert(tmp_path / "a.txt", tmp_path / "b.txt", units="cm")


def test_capital_suffixes_mean_the_same(tmp_path: Path) -> None:
    for name in ("a.TFM", "b.TXT"):
        write_transform(tmp_path / name, POSE, "LPS")
        convert(tmp_path / name, tmp_path / "back.TXT")
        np.testing.assert_allclose(read_transform(tmp_path / "back.TXT")[0], POSE, atol=1e-9)
    marks = Markups(("a", "b"), marker().vertices[:2], "LPS")
    write_markups(tmp_path / "a.MRK.JSON", marks)
    convert(tmp_path / "a.MRK.JSON", tmp_path / "a.CSV")
    convert(tmp_path / "a.CSV", tmp_path / "b.MRK.JSON")
    np.testing.assert_array_equal(read_markups(tmp_path / "b.MRK.JSON").xyz, marks.xyz)
    (tmp_path / "o.CSV").write_text("x,y\n0,0\n9,0\n9,7\n")
    assert read_surface(tmp_path / "o.CSV").dimension == 2
    write_volume(tmp_path / "v.NRRD", np.ones((3, 3, 3)), lattice(1.0, np.zeros(3)), space="LPS")
    assert read_image(tmp_path / "v.NRRD", (tmp_path / "v.NRRD").read_bytes()).values.shape == (3, 3, 3)


@pytest.mark.parametrize("name", ["broken.stl", "short.stl", "new.nii", "old.mat"])
def test_what_is_no_file_of_ours_is_said_to_be_none(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"solid of ten" if name == "short.stl" else b"\0\1\2" * 60)
    with pytest.raises(InputError, match=rf"{name}: is not a surface, points .* that o3dls knows"):
        convert(tmp_path / name, tmp_path / "o.ply")


def test_outlines_in_2d_are_refused_where_they_have_no_room(tmp_path: Path) -> None:
    (tmp_path / "o.csv").write_text("# units=cm space=RAS\nx,y\n0,0\n6,0\n6,7\n")
    for name in ("o.ply", "o.stl", "o.obj", "o.off", "o.mesh", "o.mat", "o.xml", "o.pts"):
        with pytest.raises(
            InputError, match=f"{name}: .* is for surfaces in 3D; outlines in 2D are written as csv"
        ):
            convert(tmp_path / "o.csv", tmp_path / name)
    with pytest.raises(InputError, match="omit --to"):
        convert(tmp_path / "o.csv", tmp_path / "p.csv", to="LPS")
    convert(tmp_path / "o.csv", tmp_path / "p.csv")
    assert read_surface(tmp_path / "p.csv").volume == pytest.approx(2100)  # mm2


@pytest.mark.parametrize("name", ["carto_mesh", "carto_vtk", "dif", "openep", "opencarp"])
def test_pixels_are_refused_where_the_format_means_millimetres(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="in mm by definition, and the surface is in px"):
        write_surface(tmp_path / f"a.{SUFFIX[name]}", marker(), units="px", format=name)
    with pytest.raises(InputError, match="files of the format"):
        write_surface(tmp_path / "a.ply", marker(), format=name)


def test_conversion_closes_and_decimates(tmp_path: Path) -> None:
    import trimesh

    ball = trimesh.creation.icosphere(4, 30.0)
    opened = Surface(
        np.array(ball.vertices),
        np.array(ball.faces[ball.triangles_center[:, 2] < 25]),
        {"height": ball.vertices[:, 2].copy()},
    )
    path = write_as("ply", tmp_path, opened)
    convert(path, tmp_path / "closed.vtp", cap=True, faces=1000)
    surface = read_surface(tmp_path / "closed.vtp")
    assert surface.watertight
    assert len(surface.faces) <= 1000
    assert surface.volume == pytest.approx(capped(opened).volume, rel=0.01)
    np.testing.assert_allclose(surface.fields["height"], surface.vertices[:, 2], atol=1.0)


def test_the_command_line_converts(tmp_path: Path) -> None:
    path = write_as("ply", tmp_path)
    command = [sys.executable, "-m", "o3dls", "convert", path, tmp_path / "a.vtp", "--to", "RAS"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "frame RAS, units mm" in done.stdout
    failed = subprocess.run([*command[:-1], "XYZ"], capture_output=True, text=True, check=False)
    assert failed.returncode == 2
    assert failed.stderr.strip().endswith("must be one of LPS, RAS")
