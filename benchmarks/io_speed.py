"""Seconds to write and read a surface of 200 000 vertices in every format: python benchmarks/io_speed.py.
Time and check together.
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path

import numpy as np

from o3dls.geometry.surface import Surface
from o3dls.io.surfaces import FORMATS, read_surface, write_surface

N = 200_000
SUFFIX = {"carto_vtk": ".vtk", "opencarp": ".pts"}


def sphere(n: int) -> Surface:
    """A grid of the sphere with about n vertices and two fields."""
    rows = int(np.sqrt(n / 2))
    columns = 2 * rows
    theta, phi = np.meshgrid(
        (np.arange(rows) + 0.5) * np.pi / rows, np.arange(columns) * 2 * np.pi / columns, indexing="ij"
    )
    xyz = 40 * np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1
    ).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    a = index[:-1].ravel()
    b = index[1:].ravel()
    c = np.roll(index, -1, axis=1)[1:].ravel()
    d = np.roll(index, -1, axis=1)[:-1].ravel()
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return Surface(xyz, faces, {"bipolar": xyz[:, 0] / 10, "lat": xyz[:, 1]})


def main() -> None:
    surface = sphere(N)
    for known in FORMATS:
        if known.write is None and known.name != "opencarp":
            continue
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"a{SUFFIX.get(known.name, known.suffixes[0] if known.suffixes else '')}"
            start = time.perf_counter()
            write_surface(path, surface, format=known.name)
            middle = time.perf_counter()
            back = read_surface(path)
            end = time.perf_counter()
            off = float(np.abs(np.sort(back.vertices, axis=0) - np.sort(surface.vertices, axis=0)).max())
        print(
            json.dumps(
                {
                    "format": known.name,
                    "vertices": len(surface.vertices),
                    "write_s": round(middle - start, 2),
                    "read_s": round(end - middle, 2),
                    "largest_error_mm": off,
                    "faces_kept": len(back.faces) == len(surface.faces),
                }
            )
        )


if __name__ == "__main__":
    main()
