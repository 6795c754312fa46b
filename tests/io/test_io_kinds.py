"""Files that are not read are named for what they are, at every entry, and not called damaged."""

from __future__ import annotations

import gzip
import io
import json
import pickle
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from formats import marker

from o3dls.errors import InputError
from o3dls.io.kinds import kind_of
from o3dls.io.meshes.carto import mesh_file
from o3dls.io.meshes.surface_file import SurfaceFile
from o3dls.io.points import read_points
from o3dls.io.surfaces import read_surface
from o3dls.runs.conversion import convert


def of_numpy(packed: bool) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, vertices=np.eye(3)) if packed else np.save(buffer, np.eye(3))
    return buffer.getvalue()


def a_zip(name: str) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        file.writestr(name, "x" * 50)
    return buffer.getvalue()


def gifti() -> bytes:
    import nibabel

    image = nibabel.gifti.GiftiImage()
    image.add_gifti_data_array(nibabel.gifti.GiftiDataArray(np.eye(3, dtype=np.float32), "pointset"))
    return image.to_bytes()


def freesurfer(packed: bool) -> bytes:
    import nibabel

    data = nibabel.MGHImage(np.zeros((5, 6, 7), np.uint8), np.eye(4)).to_bytes()
    return gzip.compress(data) if packed else data


def hdf5() -> bytes:
    h5py = pytest.importorskip("h5py")
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file["minc-2.0/image"] = np.zeros((2, 2))
    return buffer.getvalue()


CARTO = mesh_file.write(SurfaceFile(marker()))
FOREIGN = {
    "a.gii": (gifti(), r"a GIFTI surface \(\.gii\); save it as PLY"),
    "lh.pial": (b"\xff\xff\xfecreated by me\n\n" + bytes(40), "a surface of FreeSurfer; save it as PLY"),
    "a.mgz": (freesurfer(True), r"a volume of FreeSurfer \(\.mgh, \.mgz\); save it as NIfTI"),
    "a.mgh": (freesurfer(False), "a volume of FreeSurfer"),
    "a.glb": (b"glTF" + struct.pack("<II", 2, 400) + bytes(400), r"a glTF binary \(\.glb\); save it as PLY"),
    "a.gltf": (json.dumps({"asset": {"version": "2.0"}}).encode(), "glTF"),
    "a.npy": (of_numpy(False), r"an array of numpy \(\.npy\); give its arrays in Python"),
    "a.npz": (of_numpy(True), r"arrays of numpy \(\.npz\); give its arrays in Python"),
    "a.3mf": (a_zip("3D/3dmodel.model"), r"a document in a zip \(\.3mf"),
    "a.zip": (a_zip("la.ply"), "a zip; unpack it"),
    "a.h5": (hdf5(), r"HDF5 \(\.h5, MINC \.mnc"),
    "a.mnc": (b"CDF\1" + bytes(100), r"netCDF, such as a MINC volume"),
    "a.fbx": (b"Kaydara FBX Binary  \0" + bytes(40), "FBX"),
    "medit.mesh": (b"MeshVersionFormatted 2\n\nDimension 3\n", "a mesh of Medit or Gmsh"),
    "v4.mesh": (CARTO.replace(b"Version2.0", b"Version4.0"), "a CARTO mesh of another version than 2.0"),
    "a.msh": (b"$MeshFormat\n4.1 0 8\n", "a mesh of Gmsh"),
    "a.7z": (b"7z\xbc\xaf\x27\x1c" + bytes(40), "a packed archive"),
    "a.pdf": (b"%PDF-1.7\n", "a PDF"),
    "a.pkl": (pickle.dumps({"vertices": np.eye(3)}), "a pickle of Python"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_what_is_not_read_is_named(name: str, tmp_path: Path) -> None:
    data, words = FOREIGN[name]
    (tmp_path / name).write_bytes(data)
    for read in (read_surface, lambda path: convert(path, tmp_path / "out.ply")):
        with pytest.raises(InputError, match=words) as error:
            read(tmp_path / name)
        assert "damaged" not in str(error.value)
    assert not (tmp_path / "out.ply").exists()
    with pytest.raises(InputError) as error:
        read_points(tmp_path / name)
    binary = b"\0" in data[:4096] and not data.startswith(b"PK")
    assert not binary or kind_of(data) in str(error.value)


def test_what_is_read_is_no_foreign_kind(tmp_path: Path) -> None:
    for data in (CARTO, b"solid x\n", b"x,y,z\n1,2,3\n", b'{"markups": []}', b"", gzip.compress(b"n+1")):
        assert kind_of(data) == ""
    (tmp_path / "a.bin").write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="that o3dls knows; is it damaged"):
        convert(tmp_path / "a.bin", tmp_path / "out.ply")
