"""What the tags of a study's points mean: landmarks, ablation, and places that are not on the wall."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Mask
from ...case import Points
from ...geometry.surface import Surface
from ...registration.landmark_names import is_known

BETWEEN = " + "  # tags of one point in a cell
# kind: tags of that kind, short and in full, as CARTO's own table has them and as OpenEP keeps them
KINDS: Mapping[str, Sequence[str]] = {
    "ablation": ("ABL", "Ablation", "SIA", "Short Interval Ablation", "RF", "RF Ablation"),
    "in the blood": ("EOS", "End of Sheath"),
    "in the blood or on the wall": ("LO", "Location Only"),
}
KIND_OF = {tag.casefold(): kind for kind, tags in KINDS.items() for tag in tags}
DEEP = 5.0  # mm inside the shell: nearer to it a point may touch the wall


def has_meaning(tag: str) -> bool:
    """Return whether a tag is in the table, or names a landmark."""
    return tag.strip().casefold() in KIND_OF or is_known(tag)


def sorted_by_tags(points: Points, shell: Surface | None) -> tuple[Points, dict[str, Array], list[str]]:
    """Return points with the types that their column `tags` says, the landmarks, and sentences on what became
    of those that are not on the wall.

    A landmark is the mean of the places with its tag. Ends of sheaths, and places without a signal deep
    inside the shell, bound the wall from inside; ends of sheaths outside of it, or without a shell to tell
    by, are left out.
    """
    rows = [[tag for tag in str(cell).split(BETWEEN) if tag] for cell in points.columns.get("tags", [])]
    if not any(rows):
        columns = {name: values for name, values in points.columns.items() if name != "tags"}
        return replace(points, columns=columns), {}, []
    names = sorted({tag for row in rows for tag in row if is_known(tag)})
    landmarks = {name: points.xyz[np.array([name in row for row in rows])].mean(axis=0) for name in names}
    ablation, blood, either = (_of_kind(rows, kind) for kind in KINDS)
    inside = _deep_inside(points.xyz, shell)
    kinds = np.where(ablation, "ablation", np.where((blood | either) & inside, "inside", points.type))
    said = []
    if (moved := kinds == "inside").any():
        said.append(
            f"{moved.sum()} points tagged {_tags_at(rows, moved)} are of type inside, not on the wall"
        )
    lost = blood & ~inside & ~ablation
    if lost.any():
        said.append(
            f"{lost.sum()} points tagged {_tags_at(rows, lost)}, which are not on the wall: left out, since "
            f"{'no shell says that they are' if shell is None else 'they do not lie'} inside"
        )
    return replace(points, type=kinds).select(~lost), landmarks, said


def _of_kind(rows: Sequence[Sequence[str]], kind: str) -> Mask:
    return np.array([any(KIND_OF.get(tag.strip().casefold()) == kind for tag in row) for row in rows], bool)


def _tags_at(rows: Sequence[Sequence[str]], mask: NDArray[np.bool_]) -> str:
    found = {tag for row, at in zip(rows, mask, strict=True) for tag in row if at}
    return ", ".join(sorted(tag for tag in found if tag.strip().casefold() in KIND_OF))


def _deep_inside(xyz: Array, shell: Surface | None) -> Mask:
    """Return which places (n, 3) lie inside a shell and far from it; none without one."""
    if shell is None:
        return np.zeros(len(xyz), dtype=bool)
    squared, face, foot, weights = shell.closest_point.query(xyz)
    outward = np.einsum("nk,nkd->nd", weights, shell.vertex_normals[shell.faces[face]])
    inside = ((xyz - foot) * outward).sum(axis=1) < 0.0
    return np.asarray(inside & (squared > DEEP**2))
