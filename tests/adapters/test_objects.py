"""Cases out of objects of other libraries: the same case whoever holds it, and results as objects again."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import open3d as o3d
import pytest
from conftest import ROOT
from tiny import SHIFT, Nudge, ball_case

import o3dls
from o3dls.adapters import objects
from o3dls.adapters.case import case_of
from o3dls.case import Points
from o3dls.errors import InputError
from o3dls.evaluation.interpolation import to_surface
from o3dls.geometry.face_values import at_vertices
from o3dls.geometry.surface import Surface
from o3dls.io.surfaces import read_surface_file

BALL = ball_case(points=40)
TAG = (BALL.prior.vertices[:, 2] > 0).astype(float) + 10.0
PRIOR = Surface(BALL.prior.vertices, BALL.prior.faces, {"tag": TAG})
XYZ = BALL.points.of("eam").xyz
BIPOLAR = np.where(np.arange(len(XYZ)) == 3, np.nan, np.linspace(0.05, 5.0, len(XYZ)))


def vtk_mesh() -> Any:
    """A vtkPolyData that vtk alone made."""
    vtk = pytest.importorskip("vtk")
    from vtkmodules.util.numpy_support import numpy_to_vtk

    mesh, points, cells = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
    for vertex in PRIOR.vertices:
        points.InsertNextPoint(vertex)
    for face in PRIOR.faces:
        cells.InsertNextCell(3, face)
    mesh.SetPoints(points)
    mesh.SetPolys(cells)
    tags = numpy_to_vtk(TAG, deep=True)
    tags.SetName("tag")
    mesh.GetPointData().AddArray(tags)
    return mesh


def meshio_mesh() -> Any:
    meshio = pytest.importorskip("meshio")
    cells = [("vertex", np.zeros((1, 1), int)), ("triangle", PRIOR.faces)]
    return meshio.Mesh(PRIOR.vertices, cells, point_data={"tag": TAG})


def pyvista_mesh() -> Any:
    pytest.importorskip("pyvista")
    return objects.to(PRIOR, "pyvista")


# what makes it, whether it has room for fields, and how exactly it holds a place
MESHES: dict[str, tuple[Callable[[], Any], bool, float]] = {
    "open3d tensor": (lambda: objects.to(PRIOR, "open3d"), True, 0.0),
    "open3d legacy": (lambda: objects.to(PRIOR, "open3d").to_legacy(), False, 0.0),
    "trimesh": (lambda: objects.to(PRIOR, "trimesh"), True, 0.0),
    "pyvista": (pyvista_mesh, True, 0.0),
    "vtk": (vtk_mesh, True, 1e-5),  # vtkPoints are float32
    "meshio": (meshio_mesh, True, 0.0),
    "arrays": (lambda: (PRIOR.vertices.tolist(), PRIOR.faces), False, 0.0),
    "Surface": (lambda: PRIOR, True, 0.0),
}


@pytest.mark.parametrize("kind", MESHES)
def test_a_prior_of_any_library_is_the_same_prior(kind: str) -> None:
    make, fields, rounding = MESHES[kind]
    case = case_of(make(), XYZ)
    np.testing.assert_allclose(case.prior.vertices, PRIOR.vertices, rtol=0, atol=rounding)
    np.testing.assert_array_equal(case.prior.faces, PRIOR.faces)
    if fields:
        np.testing.assert_array_equal(case.prior.fields["tag"], TAG)


def pyvista_cloud() -> Any:
    pyvista = pytest.importorskip("pyvista")
    cloud = pyvista.PolyData(XYZ)
    cloud["Bipolar"] = BIPOLAR
    cloud["type"] = ["eam"] * (len(XYZ) - 1) + ["ablation"]
    return cloud


def tensor_cloud() -> Any:
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor.from_numpy(XYZ.copy()))
    cloud.point["bipolar"] = o3d.core.Tensor.from_numpy(BIPOLAR[:, None].copy())
    return cloud


def meshio_cloud() -> Any:
    meshio = pytest.importorskip("meshio")
    return meshio.Mesh(XYZ, [], point_data={"bip_mv": BIPOLAR})


CLOUDS: dict[str, tuple[Callable[[], Any], bool]] = {
    "open3d tensor": (tensor_cloud, True),
    "open3d legacy": (lambda: o3d.geometry.PointCloud(o3d.utility.Vector3dVector(XYZ)), False),
    "pyvista": (pyvista_cloud, True),
    "meshio": (meshio_cloud, True),
    "columns": (lambda: {**dict(zip("XYZ", XYZ.T, strict=True)), "bipolar": BIPOLAR.tolist()}, True),
    "array": (lambda: XYZ.tolist(), False),
    "Points": (lambda: Points(XYZ, np.full(len(XYZ), "eam"), {"bipolar": BIPOLAR}), True),
}


@pytest.mark.parametrize("kind", CLOUDS)
def test_points_of_any_library_are_the_same_points(kind: str) -> None:
    make, values = CLOUDS[kind]
    points = case_of(PRIOR, make()).points
    np.testing.assert_array_equal(points.xyz, XYZ)
    if values:
        np.testing.assert_array_equal(points.columns["bipolar"], BIPOLAR)
    assert points.type[-1] == ("ablation" if kind == "pyvista" else "eam")
    assert set(points.type[:-1]) == {"eam"}


def test_quads_and_strips_become_triangles() -> None:
    meshio = pytest.importorskip("meshio")
    corners = np.array([[x, y, z] for x in (0, 40) for y in (0, 50) for z in (0, 60)], dtype=float)
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    surface = o3dls.surface_of(meshio.Mesh(corners, [("quad", quads)]))
    assert surface.watertight
    assert surface.volume == pytest.approx(40 * 50 * 60)
    with pytest.raises(InputError, match="is a volume mesh with cells of tetra: give its surface"):
        o3dls.surface_of(meshio.Mesh(corners, [("tetra", [[0, 1, 2, 4]])]))


@pytest.mark.parametrize("kind", ["trimesh", "pyvista", "meshio"])
def test_words_on_a_mesh_are_no_fields(kind: str) -> None:
    pytest.importorskip(kind)
    mesh = objects.to(PRIOR, kind)
    words = np.array(["wall"] * len(TAG))
    if kind == "trimesh":
        mesh.vertex_attributes["word"] = words
    else:
        mesh.point_data["word"] = words
    assert o3dls.surface_of(mesh).fields.keys() == {"tag"}


def with_cells(kind: str, cells: dict[str, np.ndarray]) -> Any:
    """The prior as an object of a library, with values per face."""
    if kind == "vtk":
        from vtkmodules.util.numpy_support import numpy_to_vtk

        mesh = vtk_mesh()
        for name, values in cells.items():
            array = numpy_to_vtk(values, deep=True)
            array.SetName(name)
            mesh.GetCellData().AddArray(array)
        return mesh
    mesh = objects.to(PRIOR, "open3d" if kind == "open3d" else kind)
    for name, values in cells.items():
        if kind == "pyvista":
            mesh.cell_data[name] = values
        elif kind == "trimesh":
            mesh.face_attributes[name] = values
        elif kind == "meshio":
            mesh.cell_data[name] = [values]
        else:
            mesh.triangle[name] = o3d.core.Tensor.from_numpy(values[:, None].copy())
    return mesh


@pytest.mark.parametrize("kind", ["pyvista", "vtk", "trimesh", "meshio", "open3d"])
def test_values_per_face_in_memory_are_carried_as_those_of_a_file(kind: str) -> None:
    """Labels, also in floating point, by majority, and measurements as the mean."""
    pytest.importorskip({"open3d": "numpy"}.get(kind, kind))
    rng = np.random.default_rng(40_733)
    region = rng.choice([2.0, 5.0, 11.0], len(PRIOR.faces))
    lat = np.round(rng.normal(0.0, 40.0, len(PRIOR.faces)))
    found = o3dls.surface_of(with_cells(kind, {"region": region, "lat": lat}))
    assert set(found.fields) == {"tag", "region", "lat"}
    # by its own areas: vtkPoints are float32
    np.testing.assert_array_equal(found.fields["region"], at_vertices(found, region.astype(int)))
    np.testing.assert_array_equal(found.fields["lat"], at_vertices(found, lat))


def test_values_of_polygons_in_memory_stay_with_their_triangles() -> None:
    """Cells that are no faces stand before the quads; the quads are cut in two."""
    pyvista = pytest.importorskip("pyvista")
    grid = pyvista.Plane(i_resolution=4, j_resolution=1)  # quads, from left to right
    values = np.array([9.0, 1.0, 1.0, 6.0, 6.0])  # of a vertex cell and four quads
    mesh = pyvista.PolyData(grid.points, verts=[1, 0], faces=grid.faces)
    mesh.cell_data["region"] = values
    surface = o3dls.surface_of(mesh)
    x = surface.vertices[:, 0]
    np.testing.assert_array_equal(surface.fields["region"][x < -0.01], 1.0)
    np.testing.assert_array_equal(surface.fields["region"][x > 0.01], 6.0)


def test_labels_in_floating_point_in_a_file_are_no_means(tmp_path: Path) -> None:
    """vtk writes what openCARP and others keep as floats."""
    pytest.importorskip("pyvista")
    mesh = objects.to(Surface(PRIOR.vertices, PRIOR.faces), "pyvista")
    region = np.where(PRIOR.vertices[PRIOR.faces].mean(axis=1)[:, 0] > 0, 1.0, 32.0)
    mesh.cell_data["elemTag"], mesh.cell_data["force"] = region, region
    mesh.save(tmp_path / "la.vtp")
    file = read_surface_file(tmp_path / "la.vtp")
    assert set(np.unique(file.surface.fields["elemTag"])) == {1.0, 32.0}
    assert len(np.unique(file.surface.fields["force"])) > 2
    assert "cell data 'elemTag' are carried to the points: the label with the largest area" in file.notes[0]


def test_what_stands_in_memory_is_checked_as_a_file_is() -> None:
    faces = PRIOR.faces
    broken = XYZ.copy()
    broken[2, 1] = np.inf
    columns = dict(zip("xyz", XYZ.T, strict=True))
    for prior, points, sentence in (
        ((PRIOR.vertices, faces + 1), XYZ, r"prior: triangle \d+ names vertices .* counted from 0"),
        ((PRIOR.vertices, faces[1:]), XYZ, "prior: is open"),
        ((PRIOR.vertices, PRIOR.vertices[:, :2]), XYZ, "prior: vertices have shape"),
        (("a", "b"), XYZ, "prior: a pair must hold vertices and faces"),
        (PRIOR, broken, "points: 1 points are not finite; remove them"),
        (PRIOR, XYZ[:5], "points: 5 points of type eam: at least 10"),
        (PRIOR, XYZ[:, 0], "points: have shape"),
        (
            PRIOR,
            {"x": XYZ[:, 0], "bipolar": BIPOLAR},
            "points: columns are x, bipolar: there must be x, y, z",
        ),
        (PRIOR, columns | {"bipolar": ["high"] * len(XYZ)}, "column 'bipolar' holds .*: must be numbers"),
        (
            PRIOR,
            columns | {"force": np.full(len(XYZ), -9000.0)},
            "row 0, column 'force': -9000 cannot have been measured",
        ),
        (PRIOR, columns | {"y": XYZ[1:, 1]}, r"x, y, z have shapes .*: must be columns of one length"),
        (PRIOR, columns | {"z": [[1], [1, 2]]}, "points: a column is not an array"),
        (PRIOR, columns | {"lat": BIPOLAR[1:]}, "column 'lat' has shape"),
        (o3d, XYZ, "prior: an object of type builtins.module is not a surface: must be a mesh of Open3D"),
        (PRIOR, o3d, "points: an object of type builtins.module holds no points: must be a cloud of Open3D"),
    ):
        with pytest.raises(InputError, match=sentence):
            case_of(prior, points)
    with pytest.raises(InputError, match=r"'label' does not apply to .*Surface, only to label volumes"):
        case_of(PRIOR, XYZ, label=1)
    with pytest.raises(InputError, match="no setting 'unit' of a case: did you mean 'units'"):
        o3dls.register(PRIOR, XYZ, unit="m")
    with pytest.raises(
        InputError, match=r"prior of type TriangleMesh: must be Surface; o3dls\.case_of takes"
    ):
        o3dls.Case("a", objects.to(PRIOR, "open3d"), BALL.points)


MASKED = np.isin(np.arange(len(XYZ)), (0, 7))


def masked_points(kind: str) -> Any:
    """The points with two rows that are masked, whose numbers are those of a fill value."""
    xyz = np.ma.array(np.where(MASKED[:, None], -9999.0, XYZ))
    xyz[MASKED] = np.ma.masked
    if kind == "one axis":
        xyz.mask[:, :2] = False
    if kind == "rows":
        return list(xyz)
    if kind == "columns":
        return {**dict(zip("XYZ", xyz.T, strict=True)), "bipolar": BIPOLAR}
    return xyz


@pytest.mark.parametrize("kind", ["array", "one axis", "rows", "columns"])
def test_masked_rows_are_no_points(kind: str) -> None:
    points = objects.points_of(masked_points(kind))
    np.testing.assert_array_equal(points.xyz, XYZ[~MASKED])
    assert points.notes[0] == f"2 of {len(XYZ)} rows are masked, and are left out"
    if kind == "columns":
        np.testing.assert_array_equal(points.columns["bipolar"], BIPOLAR[~MASKED])


def test_a_masked_value_is_missing_and_rows_keep_their_numbers() -> None:
    columns = {**masked_points("columns"), "lat": np.ma.array(np.arange(40), mask=np.arange(40) == 9)}
    assert np.flatnonzero(np.isnan(objects.points_of(columns).columns["lat"])).tolist() == [7]
    columns["force"] = np.where(np.arange(40) == 9, 7000.0, 20.0)
    with pytest.raises(InputError, match="points: row 9, column 'force': 7000 cannot have been measured"):
        objects.points_of(columns)


def test_nothing_that_is_masked_is_taken_for_a_number() -> None:
    xyz, vertices = masked_points("array"), np.ma.array(PRIOR.vertices)
    vertices[5] = np.ma.masked
    pose = np.ma.array(np.eye(4), mask=np.eye(4, k=1) > 0)
    for make, sentence in (
        (lambda: Points(xyz, np.full(len(xyz), "eam")), "point 0 is not finite"),
        (lambda: Surface(vertices, PRIOR.faces), "vertices or faces are masked"),
        (lambda: case_of((vertices, PRIOR.faces), XYZ), "prior: vertex 5 is not finite"),
        (lambda: case_of(PRIOR, XYZ, init=pose), "init is not a pose"),
        (lambda: case_of(PRIOR, XYZ, landmarks={"LAA": (vertices[5], XYZ[0])}), "must be 3 finite numbers"),
    ):
        with pytest.raises(InputError, match=sentence):
            make()
    values = np.ma.array(np.where(MASKED, -9999.0, 1.0), mask=MASKED)
    assert np.isnan(Points(XYZ, np.full(40, "eam"), {"bipolar": values}).numbers("bipolar")[MASKED]).all()
    assert np.nanmin(to_surface(XYZ, values, PRIOR)) == pytest.approx(1.0)


@pytest.mark.parametrize("role", ["prior", "points"])
def test_metres_are_asked_about_and_taken_where_they_are_said(role: str) -> None:
    small = (PRIOR.vertices / 1000, PRIOR.faces), XYZ / 1000
    given = (small[0], XYZ) if role == "prior" else (PRIOR, small[1])
    with pytest.raises(
        InputError, match=rf"{role}: extends over 0.0\d+ mm; if its units are m, say units='m'"
    ):
        case_of(*given)
    marks = {"a": (np.array([0.02, 0, 0]), np.array([0.021, 0, 0]))}
    pose = np.eye(4)
    pose[0, 3] = 0.005
    case = case_of(*small, units="m", landmarks=marks, init=pose)
    np.testing.assert_allclose(case.prior.vertices, PRIOR.vertices, atol=1e-12)
    np.testing.assert_allclose(case.points.of("eam").xyz, XYZ, atol=1e-12)
    np.testing.assert_allclose(case.prior_landmarks["a"], [20.0, 0, 0])
    np.testing.assert_allclose(case.points.of("landmark").xyz, [[21.0, 0, 0]])
    assert case.init is not None
    assert case.init[0, 3] == pytest.approx(5.0)
    with pytest.raises(InputError, match="units = 'km': must be one of mm"):
        case_of(*small, units="km")


def volume() -> np.ndarray:
    """Labels (nx, ny, nz) of a ball and a smaller one, in voxels of 2 x 2 x 3 mm."""
    index = np.stack(np.meshgrid(*map(np.arange, (30, 32, 24)), indexing="ij"), axis=-1) * [2.0, 2, 3]
    labels = np.zeros(index.shape[:3], np.uint8)
    labels[np.linalg.norm(index - [30, 32, 36], axis=-1) < 22] = 1
    labels[np.linalg.norm(index - [30, 32, 36], axis=-1) < 12] = 7
    return labels


def sitk_image(values: np.ndarray) -> Any:
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.GetImageFromArray(values.transpose(2, 1, 0))
    image.SetSpacing([2.0, 2.0, 3.0])
    image.SetOrigin([-40.0, 10.0, 5.0])
    image.SetDirection([0.0, 1, 0, -1, 0, 0, 0, 0, 1])
    return image


def test_label_volumes_lie_where_their_files_lie(tmp_path: Path) -> None:
    sitk, nibabel = pytest.importorskip("SimpleITK"), pytest.importorskip("nibabel")
    image = sitk_image(volume())
    sitk.WriteImage(image, str(tmp_path / "a.nii.gz"))
    known = read_surface_file(tmp_path / "a.nii.gz", label=1).surface
    for thing in (image, nibabel.load(tmp_path / "a.nii.gz")):
        surface = o3dls.surface_of(thing, label=1)
        np.testing.assert_allclose(surface.vertices, known.vertices, atol=1e-4)
        turned = o3dls.surface_of(thing, label=1, frame="RAS")
        np.testing.assert_allclose(turned.vertices, known.vertices * [-1, -1, 1], atol=1e-4)
        case = case_of(thing, known.vertices[::40] * [-1, -1, 1], label=1, frame="RAS")
        assert (case.frame, case.prior_frame) == ("RAS", "RAS")
        np.testing.assert_allclose(case.prior.vertices, turned.vertices)
        # nobody said the frame of the points, and the volume says its own
        case = case_of(thing, known.vertices[::40], label=1)
        assert (case.frame, case.prior_frame) == ("unknown", "LPS")
        np.testing.assert_allclose(case.prior.vertices, known.vertices, atol=1e-4)
        with pytest.raises(InputError, match=r"prior: holds 2 labels; say label= \(there are 1, 7\)"):
            case_of(thing, XYZ)


def test_phases_of_a_cine_in_memory_are_chosen_by_number() -> None:
    sitk, nibabel = pytest.importorskip("SimpleITK"), pytest.importorskip("nibabel")
    phases = [np.roll(volume(), k, axis=0) for k in range(3)]
    affine = np.diag([2.0, 2, 3, 1])
    things = [
        nibabel.Nifti1Image(np.stack(phases, axis=-1), affine),
        sitk.JoinSeries([sitk_image(phase) for phase in phases]),
        sitk.Compose([sitk_image(phase) for phase in phases]),
    ]
    for thing in things:
        first, last = (o3dls.surface_of(thing, label=7, layer=k).vertices.mean(axis=0) for k in (0, 2))
        assert np.linalg.norm(last - first) == pytest.approx(4.0, abs=1e-3)
        with pytest.raises(InputError, match="label 7 is in 3 layers; say layer="):
            o3dls.surface_of(thing, label=7)


def test_segments_of_slicer_keep_their_names_in_memory() -> None:
    image = sitk_image(volume())
    for k, (name, label) in enumerate((("LA", 1), ("core", 7))):
        for key, value in (("Name", name), ("LabelValue", str(label)), ("Layer", "0")):
            image.SetMetaData(f"Segment{k}_{key}", value)
    core = o3dls.surface_of(image, part="core")
    np.testing.assert_array_equal(core.vertices, o3dls.surface_of(image, label=7).vertices)


def test_a_nifti_in_memory_without_a_form_asks_for_the_frame() -> None:
    nibabel = pytest.importorskip("nibabel")
    image = nibabel.Nifti1Image(volume(), None)
    image.header.set_zooms([2.0, 2, 3])
    with pytest.raises(InputError, match="mesh: its header has neither qform nor sform"):
        o3dls.surface_of(image, label=1)
    surface = o3dls.surface_of(image, label=1, frame="LPS")
    np.testing.assert_allclose(surface.vertices.mean(axis=0), [30, 32, 36], atol=0.5)


@pytest.mark.parametrize("kind", ["open3d", "trimesh", "pyvista", "meshio"])
def test_results_come_back_as_objects_with_their_fields(kind: str) -> None:
    pytest.importorskip(kind)
    marks = {name: (20.0 * axis, 20.0 * axis + SHIFT) for name, axis in zip("abc", np.eye(3), strict=True)}
    columns = {**dict(zip("xyz", XYZ.T, strict=True)), "bipolar": BIPOLAR}
    found = o3dls.register(PRIOR, columns, landmarks=marks, stages=[Nudge(share=0.0)])
    mesh = found.to(kind)
    assert type(mesh).__module__.split(".")[0] == kind
    back = o3dls.surface_of(mesh)
    np.testing.assert_allclose(back.vertices, PRIOR.vertices + SHIFT, atol=1e-9)
    np.testing.assert_array_equal(back.fields["tag"], TAG)
    assert {"distance_to_nearest_point_mm", "displacement_mm", "prior_only", "bipolar"} <= back.fields.keys()
    assert isinstance(found.surface, o3d.geometry.TriangleMesh)
    with pytest.raises(InputError, match="no kind of mesh 'trimsh': did you mean 'trimesh'"):
        found.to("trimsh")


def test_no_library_is_imported_that_is_not_in_use() -> None:
    code = (
        "import sys, numpy as np, o3dls\n"
        "corners = np.array([[0, 0, 0], [60, 0, 0], [0, 60, 0], [0, 0, 60.0]])\n"
        "faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])\n"
        "o3dls.case_of((corners, faces), np.random.default_rng(3).normal(size=(20, 3)) * 20)\n"
        "print([n for n in ('open3d', 'trimesh', 'pyvista', 'vtkmodules', 'meshio', 'SimpleITK', 'nibabel')"
        " if n in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_example_of_the_documentation_runs() -> None:
    pytest.importorskip("SimpleITK")
    page = (ROOT / "docs" / "registration.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    found: dict[str, Any] = {}
    exec(code, found)
    np.testing.assert_allclose(found["result"].transformation[:3, 3], [4.0, 0.0, 2.0], atol=0.3)
