"""ITK's linear transforms in text and MATLAB 4 files: SimpleITK writes them, and moves points as we do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.errors import InputError
from o3dls.geometry.similarity import apply
from o3dls.io.mapping.study import read_study
from o3dls.io.surfaces import read_surface_file
from o3dls.io.transforms import read_transform
from o3dls.runs.conversion import convert

SEED = 81_733
ROUNDING = 1e-9  # mm, of coordinates up to 100 under numbers written with all their digits
HEAD = "#Insight Transform File V1.0\n#Transform 0\n"


def linear(sitk: Any) -> dict[str, Any]:
    """One of each class that we read, none of them near the identity, around a centre of its own."""
    axis, angle, centre, shift = (0.3, -0.5, 0.8), 1.1, (7.0, -3.0, 5.0), (12.0, 4.0, -9.0)
    zyx = sitk.Euler3DTransform(centre, 0.4, -0.7, 1.2, shift)
    zyx.SetComputeZYX(True)
    affine = sitk.AffineTransform((0.9, 0.2, -0.1, 0.1, 1.3, 0.4, -0.2, 0.3, 0.8), shift, centre)
    return {
        "affine": affine,
        "euler": sitk.Euler3DTransform(centre, 0.4, -0.7, 1.2, shift),
        "zyx": zyx,
        "versor": sitk.VersorTransform(axis, angle, centre),
        "versor rigid": sitk.VersorRigid3DTransform(axis, angle, shift, centre),
        "similarity": sitk.Similarity3DTransform(1.2, axis, angle, shift, centre),
        "scale versor": sitk.ScaleVersor3DTransform((1.1, 0.9, 1.3), axis, angle, shift, centre),
        "scale": sitk.ScaleTransform(3, (1.1, 0.9, 1.3)),
        "translation": sitk.TranslationTransform(3, shift),
        "identity": sitk.Transform(3, sitk.sitkIdentity),
    }


def check(path: Path, transform: Any) -> None:
    """ITK maps from the fixed to the moving image; our pose is the inverse."""
    T_map_prior, space = read_transform(path)
    points = np.random.default_rng(SEED).uniform(-100, 100, (20, 3))
    moved = np.array([transform.TransformPoint(tuple(p)) for p in points.tolist()])
    np.testing.assert_allclose(apply(np.linalg.inv(T_map_prior), points), moved, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(apply(T_map_prior, moved), points, rtol=0, atol=ROUNDING)
    assert space == "LPS"


@pytest.mark.parametrize("suffix", [".tfm", ".txt", ".mat"])
def test_every_linear_transform_of_itk_moves_points_as_itk_does(suffix: str, tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    for name, transform in linear(sitk).items():
        path = tmp_path / f"{name}{suffix}"
        sitk.WriteTransform(transform, str(path))
        check(path, transform)


@pytest.mark.parametrize("names", [("euler", "translation", "similarity"), ("affine", "zyx"), ("versor",)])
def test_parts_of_a_composite_act_in_the_order_of_itk(names: tuple[str, ...], tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    parts = linear(sitk)
    composite = sitk.CompositeTransform([parts[name] for name in names])
    path = tmp_path / "a.tfm"
    sitk.WriteTransform(composite, str(path))
    check(path, composite)
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    check(path, composite)


@pytest.mark.parametrize("suffix", [".tfm", ".mat"])
def test_what_is_not_linear_in_3d_is_refused_by_name(suffix: str, tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    bent = {
        "BSplineTransform_double_3_3": sitk.BSplineTransform(3),
        "Euler2DTransform_double_2_2": sitk.Euler2DTransform(),
        "ScaleSkewVersor3DTransform_double_3_3": sitk.ScaleSkewVersor3DTransform(),
    }
    path = tmp_path / f"a{suffix}"
    for name, transform in bent.items():
        sitk.WriteTransform(transform, str(path))
        with pytest.raises(InputError, match=rf"holds {name}: must hold one linear transform in 3D"):
            read_transform(path)
    bspline = bent["BSplineTransform_double_3_3"]
    sitk.WriteTransform(sitk.CompositeTransform([linear(sitk)["euler"], bspline]), str(path))
    named = "Composite.*, Euler.*, BSpline.*: must" if suffix == ".tfm" else "Composite.* without its parts"
    with pytest.raises(InputError, match=named):
        read_transform(path)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("Transform: CompositeTransform_double_3_3\n", "holds CompositeTransform_double_3_3: must hold one"),
        (
            "Transform: Euler3DTransform_double_3_3\nParameters: 1 0 0 0 1\nFixedParameters: 0 0 0\n",
            "Euler3DTransform_double_3_3 has 5 and 3 Parameters and FixedParameters: must be 6 and 3 or 4",
        ),
        ("Transform: TranslationTransform_double_3_3\nParameters: 1 2 3\n", "has 3 and no Parameters"),
        (
            "Transform: TranslationTransform_double_3_3\nParameters: 1 x 3\nFixedParameters:\n",
            "line 4: Parameters 'x' is not a number",
        ),
        (
            "Transform: TranslationTransform_double_3_3\nParameters: 1 nan 3\nFixedParameters:\n",
            "its parameters must be finite",
        ),
        (
            "Transform: VersorTransform_double_3_3\nParameters: 1 1 0\nFixedParameters: 0 0 0\n",
            "its versor .* is longer than 1",
        ),
        (
            "Transform: ScaleTransform_double_3_3\nParameters: 1 0 1\nFixedParameters: 0 0 0\n",
            "cannot be turned around",
        ),
        ("Transform: A_double_3_3\nParametres: 1\n", "line 4: 'Parametres: 1' must be one of 'Transform:'"),
        ("Parameters: 1\n", "line 3: 'Parameters: 1' must be one of"),
    ],
)
def test_a_wrong_transform_is_said_to_be_one(text: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "a.tfm").write_text(HEAD + text)
    with pytest.raises(InputError, match=rf"a\.tfm: .*{sentence}"):
        read_transform(tmp_path / "a.tfm")


def test_an_affine_of_ants_is_converted(tmp_path: Path) -> None:
    """ANTs writes single or double numbers of the one or the other byte order."""
    sitk = pytest.importorskip("SimpleITK")
    affine = linear(sitk)["affine"]
    source = tmp_path / "0GenericAffine.mat"
    sitk.WriteTransform(affine, str(source))
    assert convert(source, tmp_path / "a.tfm")[1].endswith("frame LPS")
    check(tmp_path / "a.tfm", affine)
    data = b""
    for name, values in (
        ("AffineTransform_float_3_3", affine.GetParameters()),
        ("fixed", affine.GetFixedParameters()),
    ):
        numbers = np.array(values, ">f4" if name != "fixed" else ">f8")
        kind = 1010 if name != "fixed" else 1000
        data += np.array([kind, len(numbers), 1, 0, len(name) + 1], ">i4").tobytes()
        data += name.encode() + b"\0" + numbers.tobytes()
    source.write_bytes(data)
    # single numbers have seven digits
    np.testing.assert_allclose(read_transform(source)[0], read_transform(tmp_path / "a.tfm")[0], atol=1e-4)


def test_a_matlab_4_file_without_a_transform_names_its_version(tmp_path: Path) -> None:
    from scipy.io import savemat

    path = tmp_path / "s.mat"
    savemat(path, {"X": np.eye(3), "fixed": np.ones(3)}, format="4")
    with pytest.raises(InputError, match=r"s\.mat: holds X: must hold one linear"):
        read_transform(path)
    for read in (read_surface_file, read_study):
        with pytest.raises(InputError, match=r"s\.mat: is a MATLAB version 4 file \(X, .*save it with -v7"):
            read(path)
    savemat(path, {"AffineTransform_double_3_3": np.ones(12)}, format="4")
    with pytest.raises(
        InputError, match="holds AffineTransform_double_3_3: must hold one linear transform and"
    ):
        read_transform(path)
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(InputError, match="truncated or damaged"):
        read_transform(path)
