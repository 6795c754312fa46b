"""A finished run as a scene of 3D Slicer: the prior on its image, and the map brought onto it."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...geometry.similarity import apply, inverse
from ...geometry.surface import Surface
from ...quantities import VOLTAGES
from .motion_files import MotionOnGrid, Written, motion_mistake, motion_on_grid
from .placed import lps_pose, placed

if TYPE_CHECKING:
    from ...case import Case, Points
    from ...io.grey.image import GreyImage
    from ...io.scenes.mrml import Colour, Look, Scene
    from ..run import Run

RED, YELLOW, GREEN, BLUE, VIOLET = (
    (0.85, 0.1, 0.1),
    (0.95, 0.85, 0.2),
    (0.2, 0.7, 0.3),
    (0.2, 0.4, 0.9),
    (0.6, 0.25, 0.7),
)
RAINBOW = (RED, YELLOW, GREEN, BLUE, VIOLET)
DARK_TO_LIGHT = ((0.27, 0.0, 0.33), (0.13, 0.57, 0.55), (0.99, 0.91, 0.14))
LAT_SHARE = (2.0, 98.0)  # percent of the activation times between the ends of the colours
# Slicer takes 0.07 s to move one of 1000 control points, 12 s of 20 000; what there is more of is a cloud
MOST_MARKUPS = 1000
DESCRIBED = {"bipolar": "Bipolar", "unipolar": "Unipolar", "lat": "LAT"}  # as SlicerHeart describes a point
MOST_SD = 3.0  # mm, at the light end of the colours of the deviation
PLACED = "on the image, which is the world; what is of the map hangs under 'map onto image'"


def write_scene(path: Path, run: Run, name: str, spacing: float, image: Path | None) -> Written:
    """Write a scene with all that a run has, `.mrb`. Gives facts for the sidecar, and sentences."""
    from ...io.scenes.mrml import Scene

    with tempfile.TemporaryDirectory() as folder:
        scene = Scene(Path(folder))
        motion = None if motion_mistake(run, name) else motion_on_grid(run, name, spacing)
        said = _add_image(scene, run.case, image)
        _fill_scene(scene, run, name, motion)
        path.write_bytes(scene.bundle(path.stem))
    facts: dict[str, Any] = {"nodes": list(scene.nodes.values()), "world": PLACED}
    if motion is None:
        return Written(facts, [*said, "the estimate has no motion but its pose, and so has the scene"], [])
    return Written(facts | motion.facts(), said + motion.sentences(), motion.failures())


def _add_image(scene: Scene, case: Case, given: Path | None) -> list[str]:
    """Add the grey image of the prior: the one that is given, else that of the case, which may have been
    moved since: then a sentence says so. Raises InputError for one that is given and cannot be read.
    """
    from ...io.grey.image import open_image
    from ...io.grey.of_case import open_kept_image

    if given is None and not case.image:
        return []
    try:
        opened = (
            open_kept_image(case)
            if given is None
            else open_image(given, case.prior.vertices, case.prior_frame)
        )
        scene.add_volume("image", *_read_voxels(opened))
    except InputError as error:
        if given:
            raise
        return [f"the image of the case is left out: {error}"]
    gap = opened.gap(case.prior.vertices)
    return [f"the image {gap}"] if gap else []


def _read_voxels(image: GreyImage) -> tuple[Any, Array]:
    """Return the voxels (nx, ny, nz) of an image and their affine (4, 4) in LPS; no text of its header, which
    may name the patient, goes with them. Raises InputError.
    """
    from ...geometry.similarity import TURN

    values = image.volume.slab(0, image.volume.shape[2]).transpose(2, 1, 0)
    small = values.min() >= 0 and values.max() <= 255 and bool((values == np.floor(values)).all())
    turn = TURN if image.frame == "RAS" else np.eye(4)
    return values.astype(np.uint8 if small else np.float32), turn @ image.affine


def _fill_scene(scene: Scene, run: Run, name: str, motion: MotionOnGrid | None) -> None:
    from ...io.scenes.mrml import Marks

    case, estimate = run.case, run.estimates[name]
    turn, turn_map, pose = lps_pose(case, estimate)
    on_prior = placed(run, name, estimate.surface, "prior").surface.transformed(turn)
    on_map = placed(run, name, estimate.surface, "map")
    result = on_map.surface.transformed(turn_map)
    # what hangs under the pose goes to the image's place first, and is bent there
    bend = (
        ""
        if motion is None
        else scene.add_bend("bend onto image", motion.grid.there.values, motion.grid.there.affine)
    )
    under = scene.add_pose("map onto image", inverse(pose), bend)
    looks = {one: _look_of(scene, one, (result, on_prior)) for one in ("bipolar", "unipolar", "lat", "sd_mm")}
    shown = next((look for look in looks.values() if look), None)
    scene.add_model("prior", _vtp(on_prior), _faint(shown))
    scene.add_model("result", _vtp(result), shown or _plain(), under)
    _add_points(scene, on_map.points, turn_map, shown, under)
    marks = case.prior_landmarks
    if marks:
        at = apply(turn, np.array(list(marks.values())))
        scene.add_markups("landmarks of the prior", _named(list(marks), at), Marks((0.1, 0.6, 1.0)))


def _add_points(scene: Scene, points: Points, turn: Array, look: Look | None, under: str) -> None:
    """Add the measured points as a cloud with their values, and where they are few as markups to click on,
    hidden at first; ablation sites and landmarks by name.
    """
    from ...io.scenes.mrml import Marks

    measured = points.of("eam", "inside")
    if len(measured):
        has = look is not None and look.field in measured.columns
        _add_cloud(scene, "points", measured, turn, look if look is not None and has else _plain(), under)
    kinds = (
        ("points as markups", measured, Marks((0.9, 0.9, 0.9), many=True, shown=False)),
        ("ablation sites", points.of("ablation"), Marks(RED, many=True)),
        ("landmarks of the map", points.of("landmark"), Marks((1.0, 0.6, 0.1))),
    )
    for title, some, marks in kinds:
        if 0 < len(some) <= MOST_MARKUPS:
            xyz = apply(turn, some.xyz)
            scene.add_markups(title, _named(_name_rows(some), xyz), marks, _describe_rows(some), under)
        elif len(some) and marks.shown:
            _add_cloud(scene, title, some, turn, replace(_plain(), colour=marks.colour), under)


def _add_cloud(scene: Scene, name: str, points: Points, turn: Array, look: Look, under: str) -> None:
    from ...io.meshes.cloud import Cloud
    from ...io.meshes.vtp import write_cloud

    values = {key: one for key, one in points.columns.items() if one.dtype.kind in "fiu"}
    cloud = Cloud(apply(turn, points.xyz), values, "LPS", "mm")
    scene.add_model(name, write_cloud(cloud), replace(look, points=True), under)


def _name_rows(points: Points) -> list[str]:
    """Return the name of each point, its number where it has none."""
    given = points.columns.get("name", np.full(len(points), ""))
    return [str(one) or str(k) for k, one in enumerate(given, 1)]


def _describe_rows(points: Points) -> list[str]:
    """Return what was measured at each point."""
    known = {word: points.columns[key] for key, word in DESCRIBED.items() if key in points.columns}
    return [
        " / ".join(f"{word} {values[k]:g}" for word, values in known.items() if np.isfinite(values[k]))
        for k in range(len(points))
    ]


def _named(names: list[str], xyz: Array) -> Any:
    from ...io.markups import Markups

    return Markups(tuple(names), xyz, "LPS")


def _vtp(surface: Surface) -> bytes:
    from ...io.meshes.surface_file import SurfaceFile
    from ...io.meshes.vtp import write

    return write(SurfaceFile(surface, "LPS", "mm"))


def _look_of(scene: Scene, key: str, surfaces: tuple[Surface, ...]) -> Look | None:
    """Add the colours of a field, if a surface has values of it; voltages are red below the usual border of
    scar and violet above that of healthy wall.
    """
    from ...io.scenes.mrml import Look

    values = np.concatenate([one.fields[key] for one in surfaces if key in one.fields] or [np.zeros(0)])
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    low, high = VOLTAGES.get(key) or (
        (0.0, MOST_SD) if key == "sd_mm" else tuple(np.percentile(values, LAT_SHARE).tolist())
    )
    high = max(high, low + 1e-3)
    colours = DARK_TO_LIGHT if key == "sd_mm" else RAINBOW
    names = {"sd_mm": "deviation", "lat": "activation"}
    title = f"{names.get(key, key)} {low:.3g} to {high:.3g} {_unit_of(key)}"
    node = scene.add_colours(title, _spread(colours, low, high))
    return Look(field=key, colours=node, limits=(low, high))


def _unit_of(key: str) -> str:
    return {"lat": "ms", "sd_mm": "mm"}.get(key, "mV")


def _spread(colours: tuple[Colour, ...], low: float, high: float) -> list[tuple[float, Colour]]:
    return list(zip(np.linspace(low, high, len(colours)).tolist(), colours, strict=True))


def _plain() -> Look:
    from ...io.scenes.mrml import Look

    return Look()


def _faint(look: Look | None) -> Look:
    """Return the look of the prior: through it one sees the result."""
    return replace(look or _plain(), opacity=0.35)
