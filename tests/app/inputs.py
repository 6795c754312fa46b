"""The files of the four ways that docs/app.md fixes, made of the small atrium of `o3dls demo`."""

from __future__ import annotations

import zipfile
from pathlib import Path

import nibabel
import numpy as np

from o3dls.arrays import Array
from o3dls.case import Case, Points
from o3dls.geometry.surface import Surface
from o3dls.io.case_reader import read_case
from o3dls.io.matlab import openep
from o3dls.io.matlab.openep_points import electric_of
from o3dls.io.surfaces import write_surface
from o3dls.levelset.grid.distance import filled_distance
from o3dls.resources import demo_case
from tests.formats import car_file

AWAY = (260.0, -40.0, 30.0)  # mm


def atrium() -> Case:
    return read_case(demo_case())


def carto_zip(folder: Path, points: Points, *, maps: int = 2) -> Path:
    """A zipped study of CARTO with these points as map 1-LA, and ten of them as another."""
    few = Points(points.xyz[:10], points.type[:10], {k: v[:10] for k, v in points.columns.items()})
    held = {"1-LA": points, **({"2-RA": few} if maps > 1 else {})}
    named = "".join(
        f'<Map Name="{name}" FileNames="{name}.mesh" Volume="0"><CartoPoints Count="{len(of)}">'
        + "".join(f'<Point Id="{k}" />' for k in range(1, len(of) + 1))
        + "</CartoPoints></Map>"
        for name, of in held.items()
    )
    head = '<Study name="S"><Units Distance="mm" Angle="radian" />'
    path = folder / "study.zip"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("S/Study 1.xml", f'{head}<Maps Count="{len(held)}">{named}</Maps></Study>')
        for name, of in held.items():
            file.writestr(f"S/{name}_car.txt", car_file(name, of))
    return path


def label_volume(path: Path, prior: Surface) -> Path:
    """The prior as label 1 of a volume, and a small ball as label 2."""
    found = filled_distance(prior.vertices, prior.faces, 1.0, 3)
    labels = np.zeros(found.band.shape, dtype=np.uint8)
    labels[tuple(found.band.nodes[found.phi < 0.0].T)] = 1
    labels[:3, :3, :3] = 2
    affine = np.diag([-1.0, -1.0, 1.0, 1.0])
    affine[:3, 3] = np.array([-1.0, -1.0, 1.0]) * found.band.origin
    nibabel.save(nibabel.Nifti1Image(labels, affine), path)
    return path


def layered_volume(path: Path, prior: Surface) -> Path:
    """The prior as label 1 in each of two layers of a NIfTI, a voxel apart."""
    found = filled_distance(prior.vertices, prior.faces, 1.0, 3)
    labels = np.zeros((*found.band.shape, 2), dtype=np.uint8)
    labels[(*found.band.nodes[found.phi < 0.0].T, 0)] = 1
    labels[..., 1] = np.roll(labels[..., 0], 1, axis=2)
    nibabel.save(nibabel.Nifti1Image(labels, np.diag([-1.0, -1.0, 1.0, 1.0])), path)
    return path


def bare_volume(path: Path, prior: Surface) -> Path:
    """The prior as a NRRD that does not say how its axes lie."""
    found = filled_distance(prior.vertices, prior.faces, 1.0, 3)
    labels = np.zeros(found.band.shape, dtype=np.uint8)
    labels[tuple(found.band.nodes[found.phi < 0.0].T)] = 1
    sizes = " ".join(map(str, labels.shape))
    head = f"NRRD0004\ntype: uchar\ndimension: 3\nsizes: {sizes}\nencoding: raw\nspacings: 1 1 1\n\n"
    path.write_bytes(head.encode() + labels.tobytes(order="F"))
    return path


def german_table(path: Path, points: Points) -> Path:
    """A table as a German Excel saves it: semicolons, decimal commas, cp1252, headings that say no axis."""
    rows = ["Nr;Länge;Breite;Höhe;Bipolare Spannung (mV)"]
    for k, (xyz, bipolar) in enumerate(zip(points.xyz, points.columns["bipolar"], strict=True), 1):
        rows.append(";".join([str(k), *(f"{one:.2f}" for one in (*xyz, bipolar))]).replace(".", ","))
    path.write_bytes("\r\n".join(rows).encode("cp1252"))
    return path


def tagged_openep(path: Path, case: Case) -> Path:
    """The mapping points as a data set of OpenEP, with the landmarks as tags of points at their places."""
    eam, marks = case.points.of("eam"), case.points.of("landmark")
    xyz = np.vstack([eam.xyz, marks.xyz])
    columns = {key: np.append(eam.columns[key], np.full(len(marks), np.nan)) for key in ("bipolar",)}
    measured = Points(xyz, np.full(len(xyz), "eam"), columns)
    tags = np.full((len(xyz), 1), "", dtype=object)
    tags[len(eam) :, 0] = marks.columns["name"]
    path.write_bytes(openep.save({"electric": electric_of(measured) | {"tags": tags}}))
    return path


def moved_prior(path: Path, prior: Surface, turn: Array | None = None) -> Path:
    """The prior far away, and turned."""
    turned = prior.vertices @ (np.eye(3) if turn is None else turn).T
    write_surface(path, prior.with_vertices(turned + AWAY))
    return path
