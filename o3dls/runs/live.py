"""A finished run, live: its surface, landmarks, ablation points and pose sent by OpenIGTLink to Slicer or a
research system.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import InputError, did_you_mean
from ..geometry.similarity import TURN, apply
from ..io.mapping import igtl
from ..io.transforms import turned


def messages(folder: str | Path, estimate: str | None = None) -> list[bytes]:
    """POLYDATA, POINT and TRANSFORM messages of an estimate (default: the last), in RAS, which is what
    receivers take them for.

    Raises InputError where the run or the estimate is not there, or the case does not state its frame.
    """
    from ..io.meshes.registry import read_surface
    from .folder import read_run

    run = read_run(folder)
    name = estimate or run.final
    if name not in run.estimates:
        raise InputError(f"{folder}: no estimate '{name}'" + did_you_mean(name, list(run.estimates)))
    if run.case.frame not in ("LPS", "RAS") or run.case.dimension != 3:
        raise InputError(
            f"{folder}: the frame of its case is {run.case.frame}: must be LPS or RAS (and 3D) to be "
            "sent; say it in case.toml"
        )
    to_ras = TURN if run.case.frame == "LPS" else np.eye(4)
    surface = read_surface(Path(folder) / "estimates" / name / "surface.ply").transformed(to_ras)
    pose = run.estimates[name].T_map_prior
    sent = [
        igtl.polydata(surface, name),
        igtl.transform(turned(pose) if run.case.frame == "LPS" else pose, "T_map_prior"),
    ]
    marks = run.case.points.of("landmark", "ablation")
    if len(marks):
        names = marks.columns.get("name", np.full(len(marks), ""))
        labels = [
            str(label) or f"{kind} {k}"
            for k, (label, kind) in enumerate(zip(names, marks.type, strict=True), 1)
        ]
        sent.append(igtl.points(labels, apply(to_ras, marks.xyz), "points"))
    return sent


def send(
    folder: str | Path, *, estimate: str | None = None, host: str = "localhost", port: int = igtl.PORT
) -> tuple[int, bool]:
    """Send a finished run to a listening system: the number of bytes, and whether it closed in order after
    them. Raises InputError as `messages` and `igtl.send` do.
    """
    return igtl.send(messages(folder, estimate), host, port)
