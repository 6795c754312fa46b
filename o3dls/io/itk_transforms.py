"""Linear transforms of ITK as text (`.tfm`, `.txt`) and as ANTs' MATLAB 4 files (`0GenericAffine.mat`)."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..geometry.similarity import similarity
from .matlab.mat4 import read_mat4
from .text import check_numbers

HEAD = "#Insight Transform File V1.0"
KIND = re.compile(r"(\w+)_(?:double|float)_3_3")
COMPOSITE = "CompositeTransform"
LARGEST = 1e9  # mm; also keeps products finite
ROUNDING = 1e-4  # error of a versor's length: files print rounded numbers


@dataclass
class Part:
    """A part is one transform of a file: it has its kind as written, and its numbers by `Parameters` and
    `FixedParameters`.
    """

    kind: str
    numbers: dict[str, Array] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The class of ITK; the kind as written where it is not one of 3D."""
        found = KIND.fullmatch(self.kind)
        return found[1] if found else self.kind


def _affine_matrix(p: Array, _: Array) -> Array:
    return similarity(p[:9].reshape(3, 3), p[9:])


def _euler_matrix(p: Array, fixed: Array) -> Array:
    """Return the matrix of turns about y, x, z in this order, as ITK makes them; about x, y, z where a fourth
    fixed parameter says so.
    """
    from scipy.spatial.transform import Rotation

    order = "xyz" if fixed[3:].any() else "yxz"
    angles = [p["xyz".index(axis)] for axis in order]
    return similarity(Rotation.from_euler(order, angles).as_matrix(), p[3:])


def _versor_matrix(p: Array, _: Array) -> Array:
    """Return the matrix of a versor (the vector part of a unit quaternion), a shift, and one scale or
    none.
    """
    scale = float(p[6]) if len(p) == 7 else 1.0
    return similarity(_rotation_of_versor(p[:3]), p[3:6] if len(p) > 3 else np.zeros(3), scale)


def _scale_versor_matrix(p: Array, _: Array) -> Array:
    """Return the matrix of a versor with scales: ITK adds what these exceed 1 by to the diagonal of the
    rotation.
    """
    return similarity(_rotation_of_versor(p[:3]) + np.diag(p[6:] - 1.0), p[3:6])


def _rotation_of_versor(versor: Array) -> Array:
    from scipy.spatial.transform import Rotation

    square = float(versor @ versor)
    if square > 1.0 + ROUNDING:
        raise ValueError(f"its versor {versor} is longer than 1")
    rotation: Array = Rotation.from_quat([*versor, np.sqrt(max(0.0, 1.0 - square))]).as_matrix()
    return rotation


def _scale_matrix(p: Array, _: Array) -> Array:
    return similarity(np.diag(p), np.zeros(3))


def _shift_matrix(p: Array, _: Array) -> Array:
    return similarity(np.eye(3), p)


def _identity_matrix(_: Array, __: Array) -> Array:
    return np.eye(4)


# class of ITK: how many parameters, how many fixed ones (the centre; Euler's order), and the matrix of them
LINEAR: Mapping[str, tuple[int, tuple[int, ...], Callable[[Array, Array], Array]]] = {
    "AffineTransform": (12, (3,), _affine_matrix),
    "MatrixOffsetTransformBase": (12, (3,), _affine_matrix),
    "Euler3DTransform": (6, (3, 4), _euler_matrix),
    "VersorTransform": (3, (3,), _versor_matrix),
    "VersorRigid3DTransform": (6, (3,), _versor_matrix),
    "Similarity3DTransform": (7, (3,), _versor_matrix),
    "ScaleVersor3DTransform": (9, (3,), _scale_versor_matrix),
    "ScaleTransform": (3, (3,), _scale_matrix),
    "TranslationTransform": (3, (0,), _shift_matrix),
    "IdentityTransform": (0, (0,), _identity_matrix),
}


def read_itk_text(path: Path, text: str) -> Array:
    """Read the matrix (4, 4) of a text file, from the fixed to the moving image in LPS; a composite's last
    part acts first. Raises InputError, by name for what is not linear.
    """
    parts: list[Part] = []
    for at, line in enumerate(text.splitlines(), 1):
        key, _, value = line.partition(":")
        if not line.strip() or line.startswith("#"):
            continue
        if key == "Transform":
            parts.append(Part(value.strip()))
        elif key in ("Parameters", "FixedParameters") and parts and key not in parts[-1].numbers:
            if parts[-1].name in LINEAR:  # a field of displacements may have millions
                parts[-1].numbers[key] = _read_parameters(path, at, key, value.split())
        else:
            raise InputError(
                f"{path}: line {at}: '{line[:40]}' must be one of 'Transform:' and, once each after it, "
                "'Parameters:' and 'FixedParameters:'"
            )
    return _compose_parts(path, parts)


def _read_parameters(path: Path, at: int, key: str, words: Sequence[str]) -> Array:
    check_numbers(words, len(words), f"{path}: line {at}", key)
    return np.array(words, dtype=np.float64)


def read_itk_mat(path: Path, data: bytes) -> Array:
    """Read the matrix (4, 4) of a MATLAB 4 file, which maps as that of `read_itk_text`. Raises InputError."""
    variables = dict(read_mat4(path, data))
    kind, *others = variables
    if others != ["fixed"]:
        raise InputError(
            f"{path}: holds {', '.join(variables)}: must hold one linear transform and then 'fixed'; write "
            "several as .tfm"
        )
    numbers = dict(zip(("Parameters", "FixedParameters"), variables.values(), strict=True))
    if kind.startswith(COMPOSITE):
        raise InputError(f"{path}: holds a {kind} without its parts; write it as .tfm")
    return _compose_parts(path, [Part(kind, numbers)])


def _compose_parts(path: Path, parts: Sequence[Part]) -> Array:
    composite = bool(parts) and parts[0].name == COMPOSITE
    single = parts[1:] if composite else parts
    countable = len(single) > 0 if composite else len(single) == 1
    if not countable or any(part.name not in LINEAR for part in single):
        raise InputError(
            f"{path}: holds {', '.join(part.kind for part in parts) or 'no transform'}: must hold one linear "
            f"transform in 3D ({', '.join(LINEAR)}), or a {COMPOSITE} of such"
        )
    return reduce(np.matmul, [_part_matrix(path, part) for part in single])


def _part_matrix(path: Path, part: Part) -> Array:
    count, fixed_counts, matrix = LINEAR[part.name]
    parameters, fixed = (part.numbers.get(key) for key in ("Parameters", "FixedParameters"))
    if parameters is None or fixed is None or len(parameters) != count or len(fixed) not in fixed_counts:
        there = " and ".join("no" if values is None else str(len(values)) for values in (parameters, fixed))
        raise InputError(
            f"{path}: {part.kind} has {there} Parameters and FixedParameters: must be {count} and "
            f"{' or '.join(map(str, fixed_counts))}"
        )
    if not (np.abs([*parameters, *fixed]) < LARGEST).all():
        raise InputError(f"{path}: {part.kind}: its parameters must be finite and below {LARGEST:g}")
    try:
        found = matrix(parameters, fixed)
    except ValueError as error:
        raise InputError(f"{path}: {part.kind}: {error}") from None
    centre = fixed[:3] if len(fixed) else np.zeros(3)
    return similarity(found[:3, :3], found[:3, 3] + centre - found[:3, :3] @ centre)
