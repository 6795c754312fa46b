"""Unstructured grids: their faces, or the boundary of their solids, with the values that belong to them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_io_meshes import FORMS, saved

from o3dls.errors import InputError
from o3dls.geometry.surface import Surface
from o3dls.io.surfaces import read_surface, read_surface_file

ROUNDING = 1e-12  # relative: of sums over faces
TEXT = 1e-6  # relative: VTK writes so many digits
CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
# VTK's number of the kind, the corners of a unit cube that make the cell, and its volume
CELLS = {
    "tetrahedron": (10, [0, 1, 2, 4], 1 / 6),
    "tetrahedron wound inwards": (10, [1, 0, 2, 4], 1 / 6),
    "hexahedron": (12, [0, 1, 2, 3, 4, 5, 6, 7], 1.0),
    "wedge": (13, [0, 1, 3, 4, 5, 7], 1 / 2),
    "pyramid": (14, [0, 1, 2, 3, 4], 1 / 3),
}


def grid(cells: list[tuple[int, list[int]]], places: np.ndarray) -> Any:
    pyvista = pytest.importorskip("pyvista")
    flat = np.concatenate([[len(corners), *corners] for _, corners in cells])
    return pyvista.UnstructuredGrid(flat, np.array([kind for kind, _ in cells], dtype=np.uint8), places)


def ball() -> Any:
    """Tetrahedra in a ball, with values at their points and their cells."""
    places = np.random.default_rng(20_771).normal(size=(200, 3))
    places[:120] *= 25.0 / np.linalg.norm(places[:120], axis=1, keepdims=True)
    mesh = pytest.importorskip("pyvista").PolyData(places).delaunay_3d()
    mesh.point_data["height"] = mesh.points[:, 2].astype(float)
    mesh.cell_data["side"] = (mesh.cell_centers().points[:, 0] > 0).astype(np.int32)
    return mesh


@pytest.mark.parametrize("name", list(CELLS))
@pytest.mark.parametrize("form", ["42 Binary", "xml Binary"])
def test_the_boundary_of_a_solid_is_closed_and_wound_outward(name: str, form: str, tmp_path: Path) -> None:
    kind, corners, volume = CELLS[name]
    surface = read_surface(saved(grid([(kind, corners)], CORNERS), tmp_path / "a.vtu", form))
    assert surface.watertight
    assert surface.volume == pytest.approx(volume, rel=ROUNDING)
    assert len(surface.vertices) == len(corners)


@pytest.mark.parametrize("form", FORMS)
def test_tetrahedra_become_their_boundary_with_its_data(form: str, tmp_path: Path) -> None:
    mesh = ball()
    file = read_surface_file(saved(mesh, tmp_path / "a.vtu", form))
    surface, expected = file.surface, mesh.extract_surface(algorithm="dataset_surface")
    assert surface.watertight
    assert len(surface.faces) == expected.n_cells
    assert len(surface.vertices) == expected.n_points < mesh.n_points
    assert surface.volume == pytest.approx(mesh.volume, rel=TEXT)
    np.testing.assert_allclose(surface.fields["height"], surface.vertices[:, 2], rtol=TEXT)
    far = np.abs(surface.vertices[:, 0]) > 15.0  # where all cells are of one side
    np.testing.assert_array_equal(surface.fields["side"][far], surface.vertices[far, 0] > 0)
    assert f"of {mesh.n_cells} solid cells their boundary is taken" in file.notes


@pytest.mark.parametrize("form", ["51 ASCII", "xml Ascii"])
def test_faces_beside_solids_are_left_out_and_said(form: str, tmp_path: Path) -> None:
    mesh = grid([(3, [0, 1]), (5, [0, 1, 2]), (10, [0, 1, 2, 4])], CORNERS)
    mesh.cell_data["region"] = np.array([1, 2, 3], dtype=np.int32)
    file = read_surface_file(saved(mesh, tmp_path / "a.vtu", form))
    assert file.surface.watertight
    np.testing.assert_array_equal(file.surface.fields["region"], [3, 3, 3, 3])
    assert "1 faces beside the solid cells are left out" in file.notes
    assert "1 cells that are points or lines are left out" in file.notes


@pytest.mark.parametrize("form", FORMS)
def test_a_grid_of_faces_is_a_surface(form: str, tmp_path: Path) -> None:
    mesh = grid([(5, [0, 1, 2]), (6, [4, 5, 7, 6]), (9, [0, 3, 7, 4]), (7, [1, 2, 6, 5])], CORNERS)
    mesh.cell_data["region"] = np.array([6, 5, 4, 3], dtype=np.int64)
    surface = read_surface(saved(mesh, tmp_path / "a.vtu", form))
    assert len(surface.faces) == 7
    assert surface.area == pytest.approx(3.5, rel=ROUNDING)
    assert set(surface.fields["region"]) <= {3.0, 4.0, 5.0, 6.0}


def test_pieces_of_a_volume_meet_in_their_places(tmp_path: Path) -> None:
    path = saved(grid([(10, [0, 1, 2, 4])], CORNERS[[0, 1, 2, 3, 4]]), tmp_path / "a.vtu", "xml Ascii")
    other = saved(grid([(10, [0, 1, 2, 3])], CORNERS[[0, 2, 3, 4]]), tmp_path / "b.vtu", "xml Ascii")
    piece = other.read_text().split("<UnstructuredGrid>")[1].split("</UnstructuredGrid>")[0]
    path.write_text(path.read_text().replace("</UnstructuredGrid>", piece + "</UnstructuredGrid>"))
    surface = read_surface(path)
    assert len(surface.faces) == 6  # the two faces between them are inside
    assert surface.volume == pytest.approx(1 / 3, rel=ROUNDING)


def test_meshio_writes_what_we_read(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    cells = [("tetra", np.array([[0, 1, 2, 4], [0, 2, 3, 4]]))]
    mesh = meshio.Mesh(CORNERS, cells, cell_data={"region": [np.array([4, 9])]})
    for name, options in (("a.vtu", {}), ("b.vtu", {"binary": False}), ("c.vtk", {})):
        mesh.write(tmp_path / name, **options)
        surface = read_surface(tmp_path / name)
        assert isinstance(surface, Surface)
        assert surface.volume == pytest.approx(1 / 3, rel=ROUNDING)
        assert set(surface.fields["region"]) == {4.0, 9.0}


@pytest.mark.parametrize("suffix", ["vtu", "vtk"])
def test_cells_that_are_not_read_are_named(suffix: str, tmp_path: Path) -> None:
    form = "xml Ascii" if suffix == "vtu" else "42 ASCII"
    path = saved(grid([(22, [0, 1, 2, 3, 4, 5])], CORNERS), tmp_path / f"a.{suffix}", form)
    with pytest.raises(InputError, match=rf"a\.{suffix}: holds cells of VTK's type 22: only triangles"):
        read_surface(path)


HEAD = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\n"
GRID = f"{HEAD}POINTS 4 float\n0 0 0 1 0 0 0 1 0 0 0 1\n"


@pytest.mark.parametrize(
    ("cells", "sentence"),
    [
        ("CELLS 1 5\n4 0 1 2 3\n", "CELL_TYPES must follow"),
        ("CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 2\n10 10\n", "there are 2 CELL_TYPES and 1 CELLS"),
        ("CELLS 1 5\n4 0 1 2 4\nCELL_TYPES 1\n10\n", "a cell names vertex 4: there are 4, counted from 0"),
        ("CELLS 1 4\n3 0 1 2\nCELL_TYPES 1\n10\n", "of VTK's type 10 has 3 corners: must be 4"),
        ("CELLS 1 5\n4 0 1 2 3\nCELLS 1 5\n4 0 1 2 3\n", "CELLS appear twice"),
    ],
)
def test_grids_that_do_not_hold_together_are_refused(cells: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "a.vtk"
    path.write_text(GRID + cells)
    with pytest.raises(InputError, match=rf"a\.vtk: .*{sentence}"):
        read_surface(path)
