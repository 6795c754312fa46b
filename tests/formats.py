"""One marker object and a writer for every format: what the tests of files share."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data_synth.carto import car_file as car_file
from o3dls.geometry.surface import Surface
from o3dls.io.surfaces import write_surface

# Absolute, in mm, for coordinates up to 100: the last digit that each format prints, or float32.
TOLERANCE = {
    "ply": 0.0,
    "vtk": 0.0,
    "vtp": 0.0,
    "off": 5e-7,
    "obj": 5e-7,
    "stl": 1e-5,
    "carto_vtk": 5.1e-5,
    "carto_mesh": 5.1e-4,
    "dif": 5.1e-5,
    "openep": 0.0,
    "opencarp": 1e-9,
}
SUFFIX = {"carto_vtk": "vtk", "carto_mesh": "mesh", "dif": "xml", "openep": "mat", "opencarp": "pts"}
# others cannot state one
SPACE = {
    "ply": "LPS",
    "vtk": "LPS",
    "vtp": "LPS",
    "off": "LPS",
    "obj": "LPS",
    "stl": "LPS",
    "dif": "LPS",
}
FIELDS = {
    "ply": "any",
    "vtk": "any",
    "vtp": "any",
    "carto_mesh": "bipolar",
    "dif": "bipolar",
    "openep": "bipolar",
    "opencarp": "depth",
}


def marker() -> Surface:
    """A tetrahedron without any symmetry, so that a swapped axis, a flip, a shift or a scale shows."""
    vertices = np.array(
        [[10.0, -20.0, 30.0], [47.25, -18.5, 33.0], [12.0, 3.75, 35.5], [14.5, -15.0, 91.125]]
    )
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    fields = {"bipolar": np.array([0.125, np.nan, 2.5, 1.25]), "depth": np.array([1.0, 2.0, 3.0, 4.5])}
    return Surface(vertices, faces, fields)


def write_as(name: str, folder: Path, surface: Surface | None = None) -> Path:
    """The marker, or another surface, as a file of a format, in LPS."""
    path = folder / f"{name}.{SUFFIX.get(name, name)}"
    write_surface(path, surface or marker(), space="LPS", format=name)
    return path


def corners(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Corners of the triangles (m, 9) in an order that does not depend on numbering, but on winding."""
    triangles = np.asarray(vertices, dtype=float)[np.asarray(faces, dtype=int)]
    keys = np.round(triangles, 2)
    first = np.array([min(range(3), key=lambda k: tuple(row[k])) for row in keys])
    turned = triangles[np.arange(len(triangles))[:, None], (first[:, None] + np.arange(3)) % 3].reshape(-1, 9)
    return turned[np.lexsort(np.round(turned, 2).T[::-1])]


def same_body(
    vertices: np.ndarray, faces: np.ndarray, tolerance: float, surface: Surface | None = None
) -> None:
    expected = surface or marker()
    np.testing.assert_allclose(
        corners(vertices, faces),
        corners(expected.vertices, expected.faces),
        rtol=0,
        atol=max(tolerance, 1e-12),
    )


def lattice(spacing: float, origin: np.ndarray) -> np.ndarray:
    """The affine matrix of voxels along the axes, the first at `origin`."""
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = origin
    return affine
