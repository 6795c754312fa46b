"""An export of CARTO 3 as a clinic has it, beside the late enhancement image of the same patient: what
docs/tutorial_carto.md begins with. Where the image is enhanced, the voltages are low.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from o3dls import Points, Surface, write_surface

from . import sampling, shapes
from .atrium import atrium
from .grey import SCAR_SIZE, VOXEL, Tissue, late_enhancement, oblique_grid, patchy, save_nifti, scar_middles
from .meshing import mesh
from .motion import wobble
from .pose import frame, under
from .shapes import Array, Shape

MAP = "1-LA"
STREAM = 15_486  # of the random numbers of an export, apart from those of its atrium
COLUMNS = ("unipolar", "bipolar", "lat", "impedance")  # of a `_car.txt`, in its order
UNREADABLE = 0.25  # sd of the logarithm of a voltage: how well a catheter lies against the wall
UNIPOLAR = 1.5, 2.4  # mV: of scar, and more by so many times the bipolar voltage
OHM = 118.0, 7.0  # impedance: mean and sd
BORDER = 3.0  # mm beyond what is enhanced, where a voltage is half of that of healthy wall
RING_NOISE, SHELL_NOISE = 1.0, 0.8  # mm
SECONDS, GRAMS = (12.0, 32.0), (6.0, 22.0)  # of an ablation site
GULLET_RADIUS, GULLET_VALUE, GULLET_GAP = 6.0, 210.0, 3.0  # mm, grey value, mm behind the wall
GULLET_BEYOND = 25.0  # mm above and below the chamber
STUDY = """<?xml version="1.0" encoding="UTF-8"?>
<Study name="synthetic, not for clinical use"><Units Distance="mm" Angle="radian" />
<Maps Count="1"><TagsTable Count="{tags}">
{table}
</TagsTable>
<Map Name="{name}" FileNames="{name}.mesh" Volume="{volume:.6g}"><CartoPoints Count="{count}">
{points}
</CartoPoints></Map></Maps></Study>
"""


@dataclass(frozen=True, eq=False)
class Export:
    """An export: its map's points with the tag of each ('' where it has none), its ablation sites (n, 3) and
    its shell, all in the frame of the system.
    """

    points: Points
    tags: list[str]
    sites: Array
    shell: Surface


def write_carto_study(folder: Path, seed: int = 7, points: int = 400) -> None:
    """Write the export, and in LPS (NIfTI in RAS) `la_labels.nii.gz`, `lge.nii.gz`, `ostia.mrk.json` and
    `oesophagus.stl`; and `true_wall.ply` in the frame of the system, which nothing but the score may see.
    """
    rng = np.random.default_rng((seed, STREAM))
    case = atrium(seed, points=points)
    assert case.truth is not None  # an atrium has one
    assert case.truth.surface is not None
    prior, wall = case.prior, case.truth.surface
    middles = scar_middles(rng, prior)
    to_map = frame(rng)
    voltages = np.min([sampling.voltage(prior, one, SCAR_SIZE + BORDER) for one in middles], axis=0)
    found = _exported(rng, case.points, wall, voltages, to_map)
    grid = oblique_grid(rng, prior, VOXEL)
    gullet = _gullet(prior)
    image, tissue = late_enhancement(prior, grid, patchy(middles)), Tissue()
    inside = image == tissue.blood
    image[(gullet(grid.places()) < 0.0).reshape(grid.shape)] = GULLET_VALUE
    image += tissue.noise * rng.normal(size=grid.shape)

    _write_export(folder / "export", found)
    save_nifti(folder / "la_labels.nii.gz", inside.astype(np.uint8), grid)
    save_nifti(folder / "lge.nii.gz", np.clip(np.round(image), 0, 4095).astype(np.int16), grid)
    _write_markups(folder / "ostia.mrk.json", case.prior_landmarks)
    write_surface(folder / "oesophagus.stl", _meshed(gullet, prior), space="LPS")
    write_surface(folder / "true_wall.ply", wall.with_vertices(under(to_map, wall.vertices)))


def _exported(
    rng: np.random.Generator, measured: Points, wall: Surface, voltages: Array, to_map: Array
) -> Export:
    """What the system exports of a case's points on a wall with a voltage at each vertex: before a vein was
    isolated, points on its ring were taken and tagged.
    """
    mapped, burnt, ostia = (measured.of(kind) for kind in ("eam", "ablation", "landmark"))
    _, face, foot, weights = wall.closest_point.query(burnt.xyz)
    ring = foot + RING_NOISE * rng.normal(size=foot.shape)
    names = ostia.columns["name"]
    nearest = np.linalg.norm(foot[:, None] - ostia.xyz, axis=2).argmin(axis=1)
    xyz = np.vstack([mapped.xyz, ring])
    _, face, _, weights = wall.closest_point.query(xyz)
    bipolar = (voltages[wall.faces[face]] * weights).sum(axis=1)
    bipolar *= np.exp(UNREADABLE * rng.normal(size=len(xyz)))
    lat = np.concatenate([mapped.numbers("lat"), burnt.numbers("lat")])
    points = Points(
        np.round(under(to_map, xyz), 3),
        np.full(len(xyz), "eam"),
        {
            "unipolar": np.round(UNIPOLAR[0] + UNIPOLAR[1] * bipolar, 2),
            "bipolar": np.round(bipolar, 2),
            "lat": np.round(lat),
            "impedance": np.round(rng.normal(*OHM, len(xyz)), 1),
        },
    )
    tags = [""] * len(mapped) + [str(names[k]) for k in nearest]
    shell = wall.with_vertices(under(to_map, wobble(rng, SHELL_NOISE, 8.0, 3)(wall.vertices)))
    shown = replace(shell, fields={"bipolar": voltages})
    return Export(points, tags, np.round(under(to_map, burnt.xyz), 2), shown)


def _write_export(folder: Path, found: Export) -> None:
    """Write the study's XML, the map's points and shell, and VisiTag's sites."""
    (folder / "VisiTagExport").mkdir(parents=True)
    names = sorted(set(found.tags) - {""})
    ids = {name: str(101 + k) for k, name in enumerate(names)}
    table = [f'<Tag ID="{ids[name]}" Short_Name="{name}" Full_Name="{name}" />' for name in names]
    rows = [
        f'<Point Id="{k}" Position3D="{" ".join(f"{v:g}" for v in at)}">'
        + (f'<Tags Count="1">{ids[tag]}</Tags>' if tag else "")
        + "</Point>"
        for k, (at, tag) in enumerate(zip(found.points.xyz.tolist(), found.tags, strict=True), 1)
    ]
    text = STUDY.format(
        tags=len(names),
        table="\n".join(table),
        name=MAP,
        volume=found.shell.volume / 1000.0,
        count=len(rows),
        points="\n".join(rows),
    )
    (folder / "Study 1.xml").write_text(text, encoding="utf-8")
    (folder / f"{MAP}_car.txt").write_bytes(car_file(MAP, found.points))
    write_surface(folder / f"{MAP}.mesh", found.shell, format="carto_mesh")
    rng = np.random.default_rng(len(found.sites))
    head = "Session ChannelID SiteIndex X Y Z DurationTime AverageForce"
    lines = [
        f"1 0 {k} {x:.2f} {y:.2f} {z:.2f} {rng.uniform(*SECONDS):.1f} {rng.uniform(*GRAMS):.1f}"
        for k, (x, y, z) in enumerate(found.sites.tolist(), 1)
    ]
    (folder / "VisiTagExport/Sites.txt").write_text("\r\n".join([head, *lines]) + "\r\n", newline="")


def car_file(map_name: str, points: Points) -> bytes:
    """The points as CARTO exports them, a version 5 `_car.txt` with missing values as -10000."""
    empty = np.full(len(points), np.nan)
    values = np.nan_to_num(np.column_stack([points.columns.get(n, empty) for n in COLUMNS]), nan=-10_000.0)
    zeros = ["0", "0", "0"]
    rest = ["0", "-1", "1", "A", *zeros, "-10000", "-1", *zeros[:2], "-10000", "-10000"]  # columns 14 to 26
    rows = [f"VERSION_5_0 {map_name}"]
    for k, row in enumerate(np.column_stack([points.xyz, np.zeros((len(points), 3)), values]).tolist(), 1):
        rows.append("\t".join(["P", "0", str(k), "0", *(f"{v:g}" for v in row), *rest]) + "\t")
    return ("\r\n".join(rows) + "\r\n").encode("ascii", "replace")


def _write_markups(path: Path, marks: Mapping[str, Array]) -> None:
    """Write named places as a list of points of 3D Slicer."""
    points = [{"label": name, "position": np.round(at, 3).tolist()} for name, at in marks.items()]
    item = {"type": "Fiducial", "coordinateSystem": "LPS", "controlPoints": points}
    path.write_text(json.dumps({"markups": [item]}, indent=1) + "\n", encoding="utf-8")


def _gullet(prior: Surface) -> Shape:
    """An oesophagus: a tube that runs down behind a chamber in LPS, close to its back wall."""
    middle = prior.vertices.mean(axis=0)
    near = np.abs(prior.vertices[:, 0] - middle[0]) < 2.0 * GULLET_RADIUS
    low, high = prior.vertices[near, 2].min(), prior.vertices[near, 2].max()
    heights = np.linspace(high + GULLET_BEYOND, low - GULLET_BEYOND, 9)
    back = prior.vertices[near, 1].max() + GULLET_GAP + GULLET_RADIUS
    share = (heights - middle[2]) / (heights[0] - middle[2])
    centres = np.column_stack([middle[0] - 4.0 + 6.0 * share, back + 3.0 * share**2, heights])
    return shapes.chain(list(centres), [GULLET_RADIUS] * len(centres), blend=1.0)


def _meshed(gullet: Shape, prior: Surface) -> Surface:
    reach = np.array([0.0, 30.0, GULLET_BEYOND + 2.0 * GULLET_RADIUS])
    return mesh(gullet, prior.vertices.min(axis=0) - reach, prior.vertices.max(axis=0) + reach, 2.0)
