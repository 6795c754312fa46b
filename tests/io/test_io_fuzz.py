"""Damaged files: every reader answers with an error that names the file, or with a sound surface; never a
crash, a hang or a flood.

O3DLS_FUZZ says how many damaged files each reader is given (default 60; 2000 were run before release).
"""

from __future__ import annotations

import os
import re
import time
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from formats import TOLERANCE, car_file, lattice, write_as

from o3dls.case import Points
from o3dls.errors import InputError
from o3dls.geometry.surface import Surface
from o3dls.io import points
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.io.images.volumes import write_volume
from o3dls.io.mapping import carto_points, ensite
from o3dls.io.mapping.archive import Archive
from o3dls.io.mapping.carto_study import find_study
from o3dls.io.mapping.study import read_study
from o3dls.io.markups import Markups, read_markups, write_markups
from o3dls.io.matlab import openep
from o3dls.io.points import read_points, write_points
from o3dls.io.surfaces import FORMATS, read_surface_file
from o3dls.io.transforms import read_transform, write_transform

FILES = int(os.environ.get("O3DLS_FUZZ", "60"))
SLOWEST = 5.0  # seconds of this process for one file
Mutation = Callable[[bytes, np.random.Generator], bytes]


def truncate(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: rng.integers(len(data))]


def flip_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    out = np.frombuffer(data, np.uint8).copy()
    out[rng.integers(len(out), size=rng.integers(1, 9))] = rng.integers(256)
    return out.tobytes()


def drop_block(data: bytes, rng: np.random.Generator) -> bytes:
    a, b = sorted(rng.integers(len(data), size=2))
    return data[:a] + data[b:]


def double_block(data: bytes, rng: np.random.Generator) -> bytes:
    a, b = sorted(rng.integers(len(data), size=2))
    return data[:b] + data[a:b] + data[b:]


def garbage(data: bytes, rng: np.random.Generator) -> bytes:
    a = rng.integers(len(data))
    return data[:a] + rng.bytes(int(rng.integers(1, 400))) + data[a:]


def line_ends(data: bytes, rng: np.random.Generator) -> bytes:
    return data.replace(b"\r\n", b"\n") if rng.random() < 0.5 else data.replace(b"\n", b"\r\n")


def drop_line(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.split(b"\n")
    del lines[rng.integers(len(lines))]
    return b"\n".join(lines)


def double_line(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.split(b"\n")
    k = rng.integers(len(lines))
    return b"\n".join(lines[: k + 1] + lines[k:])


def swap_word(data: bytes, rng: np.random.Generator) -> bytes:
    """One number becomes another thing: not finite, huge, negative, with a comma, a word, or two words."""
    found = list(re.finditer(rb"[-+]?\d[-+.\deE]*", data))
    if not found:
        return data
    spot = found[rng.integers(len(found))]
    words = [
        b"nan",
        b"inf",
        b"-1",
        b"99999999999",
        b"1e308",
        b"1,5",
        b"x",
        b"",
        b"0",
        b"7 7",
        b"2147483648",
        b"1.5",
        b"-10000",
    ]
    return data[: spot.start()] + words[rng.integers(len(words))] + data[spot.end() :]


MUTATIONS: tuple[Mutation, ...] = (
    truncate,
    flip_bytes,
    drop_block,
    double_block,
    garbage,
    line_ends,
    drop_line,
    double_line,
    swap_word,
    swap_word,
    swap_word,
)


def body() -> Surface:
    import trimesh

    ball = trimesh.creation.icosphere(1, 25.0)
    fields = {"bipolar": ball.vertices[:, 0] / 10, "depth": ball.vertices[:, 2].copy()}
    return Surface(ball.vertices + np.array([10.0, -20, 30]), np.array(ball.faces), fields)


def check(name: str, path: Path, data: bytes, read: Callable[[Path], object]) -> None:
    """Damage the file FILES times and read it each time."""
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    for k in range(FILES):
        damaged = data
        for _ in range(rng.integers(1, 4)):
            damaged = MUTATIONS[rng.integers(len(MUTATIONS))](damaged, rng) or b"\0"
        path.write_bytes(damaged)
        start = time.process_time()
        try:
            sentence = answer(read, path)
        except Exception as error:
            path.with_suffix(".kept").write_bytes(damaged)
            raise AssertionError(f"{name}, file {k} ({path.with_suffix('.kept')}): {error!r}") from error
        assert sentence is None or path.stem in sentence, (
            f"{name}, file {k}: the error names no file: {sentence}"
        )
        assert time.process_time() - start < SLOWEST, (
            f"{name}, file {k} took {time.process_time() - start:.1f} s"
        )


def answer(read: Callable[[Path], object], path: Path) -> str | None:
    """The sentence of the error, or None where the file was read and what came out is sound."""
    try:
        sound(read(path))
    except InputError as error:
        return str(error)
    return None


def sound(result: object) -> None:
    """What is read must hold together: a surface says so itself when it is made; points must be finite."""
    for xyz in (getattr(result, "xyz", None), getattr(getattr(result, "surface", None), "vertices", None)):
        assert xyz is None or np.isfinite(xyz).all()


@pytest.mark.parametrize("name", [*TOLERANCE, "ascii ply", "ascii stl", "ascii vtk", "raw vtp"])
def test_surfaces(name: str, tmp_path: Path) -> None:
    path = write_as(name.split()[-1], tmp_path, body())
    check_reader(name, path, other_encoding(name, path) if " " in name else path.read_bytes())


def check_reader(name: str, path: Path, data: bytes) -> None:
    """Damage a surface's file, read by its content and by the format that the name ends in."""
    known = {f.name: f for f in FORMATS}[name.split()[-1]]
    check(name, path, data, read_surface_file)
    # as if the first bytes were always in order
    check(name + " by name", path, data, lambda p: known.read(p, p.read_bytes()))


def other_encoding(name: str, path: Path) -> bytes:
    """The same body as other programs write it."""
    import trimesh

    if name.endswith(("ply", "stl")):
        mesh = trimesh.Trimesh(body().vertices, body().faces)
        made = (
            mesh.export(file_type="ply", encoding="ascii")
            if name.endswith("ply")
            else mesh.export(file_type="stl_ascii")
        )
        return made if isinstance(made, bytes) else made.encode()
    vtk = pytest.importorskip("vtk")
    from o3dls.adapters.objects import to_pyvista

    writer = vtk.vtkXMLPolyDataWriter() if name.endswith("vtp") else vtk.vtkPolyDataWriter()
    writer.SetInputData(to_pyvista(body()))
    writer.SetFileName(str(path))
    if name.endswith("vtp"):
        writer.SetDataModeToAppended()
        writer.SetEncodeAppendedData(False)
    writer.Write()
    return path.read_bytes()


def test_text_that_goes_on_in_another_line_or_with_lists(tmp_path: Path) -> None:
    from test_io_meshes import PLY, binary

    text = write_as("obj", tmp_path, body()).read_text()
    check_reader("continued obj", tmp_path / "a.obj", text.replace(" ", " \\\n").encode())
    check_reader("lists ply", tmp_path / "a.ply", PLY.encode())
    check_reader("binary lists ply", tmp_path / "b.ply", binary(PLY))


def test_triangles_with_something_behind(tmp_path: Path) -> None:
    data = write_as("stl", tmp_path, body()).read_bytes()
    check_reader("filled stl", tmp_path / "a.stl", data + bytes(428))


@pytest.mark.parametrize("form", ["42 ASCII", "51 Binary", "xml Ascii", "xml Appended"])
@pytest.mark.parametrize("what", ["cells", "solids"])
def test_cells_of_vtk(what: str, form: str, tmp_path: Path) -> None:
    from test_io_meshes import saved, with_cell_data
    from test_io_solids import ball

    path = saved(with_cell_data() if what == "cells" else ball(), tmp_path / "a.vtk", form)
    check_reader(f"{what} {form} {'vtp' if form.startswith('xml') else 'vtk'}", path, path.read_bytes())


def test_lz4(tmp_path: Path) -> None:
    vtk = pytest.importorskip("vtk")
    pytest.importorskip("lz4")
    from o3dls.adapters.objects import to_pyvista

    writer = vtk.vtkXMLPolyDataWriter()
    writer.SetCompressor(vtk.vtkLZ4DataCompressor())
    writer.SetBlockSize(256)  # several blocks, the last one not full
    writer.SetInputData(to_pyvista(body()))
    writer.SetFileName(str(tmp_path / "a.vtp"))
    writer.Write()
    np.testing.assert_array_equal(
        read_surface_file(tmp_path / "a.vtp").surface.fields["depth"], body().fields["depth"]
    )
    check_reader("lz4 vtp", tmp_path / "a.vtp", (tmp_path / "a.vtp").read_bytes())


@pytest.mark.parametrize("suffix", ["nii", "nii.gz", "nrrd", "mha"])
def test_label_volumes(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"labels.{suffix}"
    if suffix == "mha":
        sitk = pytest.importorskip("SimpleITK")
        sitk.WriteImage(sitk.GetImageFromArray(block().astype(np.uint8)), str(path))
    else:
        write_volume(path, block(), lattice(1.5, np.zeros(3)), space="LPS")
    check(suffix, path, path.read_bytes(), read_surface_file)


@pytest.mark.parametrize("name", ["Nifti2Image", "Nifti1Pair", "no form", "cine", "spacings", "series"])
def test_label_volumes_of_other_kinds(name: str, tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    path = tmp_path / ("labels.hdr" if name == "Nifti1Pair" else "labels.nii")
    values = np.stack([block()] * 3, axis=-1) if name == "cine" else block()
    image = getattr(nibabel, name if name.startswith("N") else "Nifti1Image")(
        values.astype(np.uint8), np.eye(4)
    )
    if name == "no form":
        image.header.set_sform(None)
    nibabel.save(image, path)
    data = path.read_bytes()
    if name == "series":
        sitk = pytest.importorskip("SimpleITK")
        phase = sitk.GetImageFromArray(block().astype(np.uint8))
        sitk.WriteImage(sitk.JoinSeries([phase] * 3), str(tmp_path / "made.mha"))
        data = (tmp_path / "made.mha").read_bytes()
    if name == "spacings":
        head = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 9 10 11\nspacings: 1.5 1.5 2\nencoding: raw\n\n"
        data = head + block().tobytes(order="F")
    choice = {"layer": 1} if name in ("cine", "series") else {}
    check(name, path, data, lambda p: read_surface_file(p, frame="RAS", **choice))


@pytest.mark.parametrize("kind", ["BINARY", "LABELMAP"])
def test_dicom_segmentations(kind: str, tmp_path: Path) -> None:
    pytest.importorskip("highdicom")
    from test_io_dicom import labels, segmentation, series

    path = segmentation(tmp_path / "seg.dcm", labels(), ["LA", "LV"], series(np.eye(3)), kind)
    check(kind, path, path.read_bytes(), lambda p: read_surface_file(p, part="LA"))


def block() -> np.ndarray:
    mask = np.zeros((9, 10, 11), bool)
    mask[2:7, 3:8, 2:8] = True
    return mask


def test_points(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    rng = np.random.default_rng(7_351)
    kinds = np.array(["eam", "ablation", "inside", "landmark"] * 5)
    write_points(
        path,
        Points(
            rng.normal(size=(20, 3)),
            kinds,
            {"bipolar": np.abs(rng.normal(size=20)), "name": np.array(["a", "b c"] * 10)},
        ),
    )
    check("points", path, path.read_bytes(), read_points)
    assert points.NUMBERS


@pytest.mark.parametrize("name", ["car", "sites", "dxl", "lesions", "openep", "openep export"])
def test_points_of_the_systems(name: str, tmp_path: Path) -> None:
    from test_io_study import DXL, SITES

    rng = np.random.default_rng(9_178)
    measured = Points(rng.normal(size=(20, 3)), np.full(20, "eam"), {"bipolar": np.abs(rng.normal(size=20))})
    electric = {
        "egmX": measured.xyz,
        "voltages": {"bipolar": np.abs(rng.normal(size=20))},
        "sampleFrequency": 1000.0,
    }
    data, read = {
        "car": (
            car_file("1-Map", measured),
            lambda p: carto_points.read_car(p, p.read_bytes())[0],
        ),
        "sites": (SITES.encode(), lambda p: carto_points.read_sites(p, p.read_bytes())),
        "dxl": (DXL.encode(), lambda p: ensite.read_map(p, p.read_bytes())[0]),
        "lesions": (
            b"Text,x,y,z,Diameter\nL1,1.5,2.5,3.5,4\nL2,1,2,3,4\nEOF\n",
            lambda p: ensite.read_lesions(p, p.read_bytes()),
        ),
        "openep": (openep.save({"electric": electric}), lambda p: openep.read_points(p, p.read_bytes())),
        "openep export": (
            openep.encode(body(), replace(measured, columns=measured.columns | {"lat": rng.normal(size=20)})),
            lambda p: openep.read_points(p, p.read_bytes()),
        ),
    }[name]
    check(name, tmp_path / f"{name}.bin", data, read)


def test_study_xml(tmp_path: Path) -> None:
    from test_io_study import CARTO_XML

    def read(path: Path) -> object:
        study = find_study(Archive.open(path))
        return study and study.map("1-Map")

    # a file stands for its folder here, and errors may name the one or the other
    (tmp_path / "study").mkdir()
    check("xml", tmp_path / "study/study.xml", CARTO_XML.format(volume=20.0).encode(), read)


def test_study_zips(tmp_path: Path) -> None:
    from test_io_study import carto_folder, zipped

    (tmp_path / "study").mkdir()
    data = zipped(carto_folder(tmp_path / "s"), tmp_path / "whole.zip").read_bytes()
    check("zip", tmp_path / "study/study.zip", data, lambda p: read_study(p, "1-Map").points)


def test_markups_and_poses(tmp_path: Path) -> None:
    path = tmp_path / "marks.json"
    write_markups(path, Markups(("A", "B"), np.arange(6.0).reshape(2, 3), "LPS"))
    check("markups", path, path.read_bytes(), read_markups)
    text = (
        b"# Markups fiducial file version = 5.0\n# CoordinateSystem = LPS\n# columns = "
        b"id,x,y,z,label\n1,1.5,2,3,A\n2,4,5,6.5,B\n"
    )
    check("fcsv", path, text, read_markups)
    old = text.replace(b"# CoordinateSystem = LPS\n", b"")
    check("old fcsv", path, old, lambda p: read_markups(p, "RAS"))
    for suffix in ("txt", "tfm"):
        path = tmp_path / f"pose.{suffix}"
        write_transform(path, np.eye(4) + 0.25, "LPS") if suffix == "txt" else write_transform(
            path, np.diag([2.0, 2, 2, 1]), "LPS"
        )
        check(suffix, path, path.read_bytes(), read_transform)


@pytest.mark.parametrize("suffix", ["tfm", "mat"])
def test_transforms_of_itk(suffix: str, tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    turn = sitk.Euler3DTransform((1, 2, 3), 0.1, 0.2, 0.3, (4, 5, 6))
    several = sitk.CompositeTransform([turn, sitk.TranslationTransform(3, (1, 2, 3))])
    path = tmp_path / f"itk.{suffix}"
    sitk.WriteTransform(several if suffix == "tfm" else turn, str(path))
    check(f"itk {suffix}", path, path.read_bytes(), lambda p: finite(read_transform(p)[0]))


def finite(matrix: np.ndarray) -> None:
    assert np.isfinite(matrix).all()


def test_case_toml(tmp_path: Path) -> None:
    from test_io_case import case

    write_case(tmp_path / "c", case())
    for name in ("case.toml", "init.csv", "prior_landmarks.csv", "held_out.csv"):
        path = tmp_path / "c" / name
        whole = path.read_bytes()

        def read(_: Path, path: Path = path) -> object:
            try:
                return read_case(tmp_path / "c").points
            except InputError as error:
                # a setting may be answered by another file of the case
                raise InputError(f"{path}: {error}") from None

        check(name, path, whole, read)
        path.with_suffix(".kept").unlink(missing_ok=True)
        path.write_bytes(whole)


def test_a_shortened_data_set_is_refused(tmp_path: Path) -> None:
    path = write_as("openep", tmp_path, body())
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(InputError, match="truncated or damaged"):
        read_surface_file(path)


def test_matlab_73(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "whole.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["userdata/surface/triRep/X"] = body().vertices.T
        file["userdata/surface/triRep/Triangulation"] = body().faces.T + 1.0
        file["userdata/surface/act_bip"] = np.vstack(
            [np.zeros(len(body().vertices)), body().fields["bipolar"]]
        )
    data = b"MATLAB 7.3 MAT-file".ljust(512, b"\0") + path.read_bytes()[512:]
    check("mat 7.3", tmp_path / "damaged.mat", data, read_surface_file)
