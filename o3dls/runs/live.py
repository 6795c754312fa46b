"""A finished run, live: its surface, landmarks, ablation points and pose sent by OpenIGTLink to Slicer or a
research system.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import InputError, did_you_mean
from ..io.mapping import igtl
from .export.placed import On, frame_of, placed, unknown_frame


def messages(folder: str | Path, estimate: str | None = None, on: On = "map") -> list[bytes]:
    """Return POLYDATA, POINT and TRANSFORM messages of an estimate (default: the last), on the map or on the
    prior, in RAS, which is what receivers take them for.

    Raises InputError where the run or the estimate is not there, or the case does not state its frame.
    """
    from .folder import read_run

    run = read_run(folder)
    name = estimate or run.final
    if name not in run.estimates:
        raise InputError(f"{folder}: no estimate '{name}'" + did_you_mean(name, list(run.estimates)))
    if run.case.dimension != 3:
        raise InputError(f"{folder}: its case is 2D: must be 3D to be sent")
    if frame_of(run.case, on) == "unknown":
        raise InputError(f"{folder}: {unknown_frame(on)}; without it nothing can be sent")
    what = placed(run, name, run.estimates[name].surface, on, "RAS")
    sent = [
        igtl.polydata(what.surface, name),
        igtl.transform(what.pose, "T_map_prior" if on == "map" else "T_prior_map"),
    ]
    marks = what.points.of("landmark", "ablation")
    if len(marks):
        names = marks.columns.get("name", np.full(len(marks), ""))
        labels = [
            str(label) or f"{kind} {k}"
            for k, (label, kind) in enumerate(zip(names, marks.type, strict=True), 1)
        ]
        sent.append(igtl.points(labels, marks.xyz, "points"))
    return sent


def send(
    folder: str | Path,
    *,
    estimate: str | None = None,
    on: On = "map",
    host: str = "localhost",
    port: int = igtl.PORT,
) -> tuple[int, bool]:
    """Send a finished run to a listening system: the number of bytes, and whether it closed in order after
    them. Raises InputError as `messages` and `igtl.send` do.
    """
    return igtl.send(messages(folder, estimate, on), host, port)
