"""What a case folder holds for evaluation: the true surface, held-out places, correspondence, outliers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..arrays import Array
from ..case import Truth
from .case_coordinates import coordinates, surface_in_frame
from .case_settings import Folder
from .case_surfaces import surface_of
from .surfaces import write_surface
from .table import Table, write_table
from .text import integers


def truth_of(folder: Folder, prior: str, frame: str) -> Truth | None:
    """Return what the folder holds for evaluation, in the frame of the points; None where it holds nothing.

    `frame` names the frame of the points, `prior` that of the prior.
    """
    axes = tuple("xyz"[: folder.dimension])
    surface = surface_of(folder, "truth")
    held = folder.table("held_out", axes)
    outliers = folder.table("outliers", ("row",))
    pairs = folder.table("correspondence", _pair_names(axes))
    if all(part is None for part in (surface, held, pairs, outliers)):
        return None
    return Truth(
        surface=None if surface is None else surface_in_frame(surface, frame),
        held_out=None if held is None else coordinates(folder, held, axes, frame),
        unseen=None if held is None or "unseen" not in held.columns else held.numbers("unseen") > 0,
        correspondence=None
        if pairs is None
        else (_read_pair_side(folder, pairs, "p", prior), _read_pair_side(folder, pairs, "t", frame)),
        outliers=None
        if outliers is None
        else integers(outliers.numbers("row"), f"{outliers.path}: column 'row'"),
    )


def _read_pair_side(folder: Folder, pairs: Table, side: str, space: str) -> Array:
    return coordinates(folder, pairs, [side + axis for axis in "xyz"[: folder.dimension]], space)


def write_truth(out: Path, truth: Truth, axes: tuple[str, ...], suffix: str, units: str) -> None:
    """Write whatever the case holds for evaluation."""
    if truth.surface is not None:
        write_surface(out / f"truth.{suffix}", truth.surface, units=units)
    if truth.held_out is not None:
        unseen = {} if truth.unseen is None else {"unseen": truth.unseen.astype(int)}
        write_table(out / "held_out.csv", {**dict(zip(axes, truth.held_out.T, strict=True)), **unseen})
    if truth.correspondence is not None:
        columns = np.concatenate([side.T for side in truth.correspondence])
        write_table(out / "correspondence.csv", dict(zip(_pair_names(axes), columns, strict=True)))
    if truth.outliers is not None:
        write_table(out / "outliers.csv", {"row": truth.outliers})


def _pair_names(axes: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(side + axis for side in "pt" for axis in axes)
