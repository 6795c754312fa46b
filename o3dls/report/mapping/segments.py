"""What `o3dls segments` prints and writes: the segments of the last surface of a run, or of a mesh."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...evaluation.segments.coordinates import AtrialCoordinates, find_coordinates
from ...evaluation.segments.division import SEGMENTS, VALVE, divide
from ...evaluation.segments.openings import find_openings
from ...evaluation.segments.sureness import segment_sureness
from ...geometry.surface import Surface
from ...io.markups import read_places
from ...io.meshes.repair import closed_outward
from ...io.surfaces import read_surface_file, write_surface
from ...motion.posterior import wall_posterior
from ...runs.folder import check_not_of_a_run
from ..subject import Subject, read_subject
from .views import in_frame, orientation
from .wall_regions import landmarks_in_map

SAMPLES, SEED = 50, 0
COLUMNS = ("segment", "name", "area, cm²", "share, %", "sure, %")
NOTICE = "Segments by rules that could be read in public. Research use only; not for a patient's record."


@dataclass(frozen=True, eq=False)
class Divided:
    """A divided surface has the fields `segment`, `alpha`, `beta`, `sheet` and, of a run, `segment_sure`; the
    named places (3,) and letters that its borders lead to; its name and the frame that it is in; its
    coordinates.
    """

    name: str
    surface: Surface
    coordinates: AtrialCoordinates
    places: Mapping[str, Array]
    frame: str

    def rows(self) -> list[dict[str, float | int | str | None]]:
        """Return what is said of each segment that is there."""
        fields, area = self.surface.fields, self.surface.vertex_areas
        found = list[dict[str, float | int | str | None]]()
        wall = area @ (fields["segment"] != VALVE)
        for k, name in SEGMENTS.items():
            own = area * (fields["segment"] == k)
            if k == VALVE or own.sum() == 0.0:
                continue
            sure = 100.0 * own @ fields["segment_sure"] / own.sum() if "segment_sure" in fields else None
            row = {"segment": k, "name": name, "area_cm2": own.sum() / 100.0}
            found.append({**row, "share_percent": 100.0 * own.sum() / wall, "sure_percent": sure})
        return found


def divide_source(
    source: Path,
    *,
    landmarks: Path | None = None,
    frame: str | None = None,
    samples: int = SAMPLES,
    seed: int = SEED,
) -> Divided:
    """Divide the last surface of a run folder, or a mesh in mm, whose openings are closed.

    landmarks: a file of named places, and frame: LPS or RAS, for a mesh whose file does not state it. Of a
    run, `samples` of its posterior tell how sure segments are, where it has one. Raises InputError where the
    surface is no closed left atrium.
    """
    if not source.is_dir():
        return _divide_mesh(source, landmarks, frame)
    if landmarks or frame:
        raise InputError(f"{source}: is a run, which has landmarks and a frame of its own: must be without")
    return divide_run(read_subject([source]), samples, seed)


def divide_run(subject: Subject, samples: int, seed: int = SEED) -> Divided:
    """Divide the last surface of a run, as `divide_source` does; without samples it is not said how sure."""
    source = subject.folders[0]
    if subject.case.dimension == 2 or subject.unit != "mm":
        raise InputError(
            f"{source}: is in {subject.case.dimension}D and {subject.unit}: must be in 3D and mm"
        )
    estimate, seen = subject.last.estimate, orientation(subject)
    stated = (
        "unknown" not in (subject.case.frame, subject.case.prior_frame) or subject.case.frame != "unknown"
    )
    axes = np.array([seen.left, seen.front, seen.up]) if stated and seen.patient else None
    found = _divide(
        f"{subject.case.name}: {subject.last.name}", estimate.surface, landmarks_in_map(subject), axes
    )
    if samples and wall_posterior(estimate.motion) is not None:
        sure = segment_sureness(estimate.samples(samples, seed), found.surface.fields["segment"].astype(int))
        fields = {**found.surface.fields, "segment_sure": sure}
        found = replace(found, surface=replace(found.surface, fields=fields))
    return replace(found, frame=subject.case.frame)


def _divide_mesh(path: Path, landmarks: Path | None, frame: str | None) -> Divided:
    file = read_surface_file(path)
    if file.surface.dimension != 3:
        raise InputError(f"{path}: is in 2D: must be in 3D and mm")
    if frame not in (None, "LPS", "RAS"):
        raise InputError(f"frame '{frame}': must be LPS or RAS")
    stated = file.space if file.space != "unknown" else frame or "unknown"
    seen = in_frame(stated)
    axes = None if stated == "unknown" else np.array([seen.left, seen.front, seen.up])
    marks = read_places(landmarks)[0] if landmarks else None
    places = dict(zip(marks.names, marks.xyz, strict=True)) if marks else {}
    closed = closed_outward(file.surface, str(path), cap=True)
    return replace(_divide(path.name, closed, places, axes), frame=stated)


def _divide(name: str, surface: Surface, places: Mapping[str, Array], axes: Array | None) -> Divided:
    openings = find_openings(surface, places, axes)
    division = divide(surface, openings)
    found = find_coordinates(surface, openings, division)
    fields = {"segment": division.segment.astype(np.float64), "alpha": found.alpha, "beta": found.beta}
    fields |= {"sheet": found.sheet.astype(np.float64)}
    divided = replace(surface, fields={**surface.fields, **fields})
    return Divided(name, divided, found, openings.landmarks() | dict(division.places), "unknown")


def as_text(found: Divided) -> str:
    """Write the areas of the segments as a table of text."""
    rows = [list(COLUMNS)]
    for row in found.rows():
        numbers = (row["area_cm2"], row["share_percent"], row["sure_percent"])
        rows.append(
            [str(row["segment"]), str(row["name"]), *("-" if x is None else f"{x:.1f}" for x in numbers)]
        )
    width = [max(len(row[k]) for row in rows) for k in range(len(COLUMNS))]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, width, strict=True)).rstrip() for row in rows]
    return "\n".join([found.name, *lines, NOTICE])


def as_json(found: Divided) -> str:
    """Write the areas of the segments and the named places as JSON."""
    places = {name: np.round(at, 3).tolist() for name, at in found.places.items()}
    about = {"name": found.name, "frame": found.frame, "notice": NOTICE}
    return json.dumps(about | {"segments": found.rows(), "places": places}, indent=1, ensure_ascii=False)


def write_divided(path: Path, found: Divided) -> list[str]:
    """Write the divided surface with its fields, in the format of the suffix, and return what that does not
    keep. Raises InputError where that would replace a file that a run is read from.
    """
    check_not_of_a_run(path)
    return write_surface(path, found.surface, space=found.frame)
